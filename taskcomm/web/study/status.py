"""How a study stands, from what is on disk, whether it is being served or not."""

from collections import Counter
from dataclasses import dataclass

from taskcomm.web.study.assignment import Participant
from taskcomm.web.study.folder import StudyFolder
from taskcomm.web.study.pages import pages
from taskcomm.web.study.sessions import consented, declined, lines_of
from taskcomm.web.study.trialstatus import TrialStatus, trial_status


@dataclass(frozen=True, kw_only=True)
class ParticipantStatus:
    """A participant: the page that is next (`at`; "done" or "declined" at the end), number `page` of `of`.

    `consent` is the version of the words agreed to.
    """

    id: str
    operator: str | None
    page: int
    of: int
    at: str
    consent: str | None
    torn: bool
    problem: str | None
    trials: tuple[TrialStatus, ...]

    @property
    def counted(self) -> tuple[TrialStatus, ...]:
        """The trials that are no practice."""
        return tuple(trial for trial in self.trials if not trial.practice)


@dataclass(frozen=True, kw_only=True)
class StudyStatus:
    """`server` counts what the server wrote down: starts, stops, torn lines that it mended, rooms stopped."""

    name: str
    simulated: bool
    participants: tuple[ParticipantStatus, ...]
    server: dict[str, int]
    problems: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def trials(self) -> tuple[TrialStatus, ...]:
        """All that are no practice."""
        return tuple(trial for person in self.participants for trial in person.counted)


def study_status(folder: StudyFolder) -> StudyStatus:
    """Read every session, every trial and the server's own log."""
    people = tuple(_participant(folder, participant) for participant in folder.participants)
    lines, torn, problem = lines_of(folder.server_log)
    found = [problem] if problem else []
    found += [f"{folder.server_log.name}: torn last line"] if torn else []
    for line in lines:
        if line.get("kind") == "torn":
            found.append(f"{line.get('file')}: a torn last line was cut off ({line.get('bytes')} bytes)")
        elif line.get("kind") == "stopped":
            found.append(f"{line.get('participant')}: stopped: {line.get('reason')}")
    for person in people:
        found += _problems(person)
    asked = folder.design.consent.version
    other = [
        f"{p.id} agreed to version {p.consent} of the consent, which is now {asked}"
        for p in people
        if p.consent not in (None, asked) and p.at != "done"
    ]
    return StudyStatus(
        name=folder.design.name,
        simulated=folder.design.simulated,
        participants=people,
        server=dict(Counter(str(line.get("kind")) for line in lines)),
        problems=tuple(found),
        warnings=(*folder.warnings, *other),
    )


def _participant(folder: StudyFolder, participant: Participant) -> ParticipantStatus:
    specs = pages(folder.design, folder.texts, participant)
    lines, torn, problem = lines_of(folder.session_of(participant.id))
    done = [line for line in lines if line.get("type") == "page" and isinstance(line.get("page"), int)]
    page = min(1 + max((line["page"] for line in done), default=-1), len(specs) - 1)
    at = "declined" if declined(done) else "done" if specs[page].kind == "thanks" else specs[page].name
    return ParticipantStatus(
        id=participant.id,
        operator=participant.operator,
        page=page,
        of=len(specs),
        at=at if done else "not begun",
        consent=consented(done),
        torn=torn,
        problem=problem,
        trials=tuple(trial_status(folder.log_of(plan), plan) for plan in participant.trials),
    )


def _problems(person: ParticipantStatus) -> list[str]:
    found = [person.problem] if person.problem else []
    found += [f"{person.id}.jsonl: torn last line"] if person.torn else []
    for trial in person.trials:
        found += [trial.problem] if trial.problem else []
        found += [f"{trial.trial_id}.jsonl: torn last line"] if trial.torn else []
    return found
