"""`taskcomm study status`: who is where, how the trials went, what was lost."""

from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import Any

from taskcomm.commands.terminal import Terminal
from taskcomm.web.study.folder import StudyFolder
from taskcomm.web.study.status import ParticipantStatus, StudyStatus, study_status

COLUMNS = (
    "teacher",
    "operator",
    "at",
    "page",
    "trials",
    "aborted",
    "lost",
    "default",
    "cuts",
    "late ms",
    "rtt ms",
)
LEGEND = (
    "lost: steps whose key was not recorded; default: steps in which the planner was too late;",
    "cuts: how often a trial went on after a crash; late: 99% of ticks by no more, in the worst trial;",
    "rtt: to the teacher's page and back.",
)


def run(folder: Path, json: bool) -> int:
    """Print how the study stands; 3 where a file of it cannot be."""
    terminal = Terminal(json)
    status = study_status(StudyFolder(folder))
    terminal.document({"command": "study status", "folder": str(folder), **document(status)})
    called = f"{status.name} (simulated)" if status.simulated else status.name
    terminal.table(called, COLUMNS, [row(person) for person in status.participants])
    for line in LEGEND:
        terminal.line(line)
    terminal.line(summary(status))
    for problem in status.problems:
        terminal.line(f"problem: {problem}")
    for warning in status.warnings:
        terminal.message(f"warning: {warning}")
    return 0


def row(person: ParticipantStatus) -> list[Any]:
    """A participant's line of the table; a practice counts for what was lost, not among the trials."""
    trials = person.trials
    ended = [trial for trial in person.counted if trial.state in ("final", "timeout")]
    late = [t.timings.late_ms_p99 for t in trials if t.timings.late_ms_p99 is not None]
    trips = [t.timings.rtt_ms for t in trials if t.timings.rtt_ms is not None]
    return [
        person.id,
        person.operator or "",
        place(person),
        f"{person.page + 1}/{person.of}",
        f"{len(ended)}/{len(person.counted)}",
        sum(trial.state == "aborted" for trial in person.counted) or "",
        sum(trial.lost for trial in trials) or "",
        sum(trial.defaults for trial in trials if trial.controller == "planner") or "",
        sum(trial.resumes for trial in trials) or "",
        f"{max(late):.1f}" if late else "",
        f"{max(trips):.0f}" if trips else "",
    ]


def place(person: ParticipantStatus) -> str:
    """The page that is next, without the participant's id: card 1, trial 1, rating 1."""
    name = f"trial-{person.at}" if person.at.startswith(person.id) else person.at
    return name.replace(f"{person.id}-", "").replace("-", " ")


def summary(status: StudyStatus) -> str:
    """One line on all trials."""
    states = Counter(trial.state for trial in status.trials)
    said = [f"{states[state]} {state}" for state in dict.fromkeys(trial.state for trial in status.trials)]
    done = sum(person.at == "done" for person in status.participants)
    missed = sum(trial.timings.missed for person in status.participants for trial in person.trials)
    late = f"; ticks late by a step or more: {missed}" if missed else ""
    return f"{done} of {len(status.participants)} participants done; trials: {', '.join(said)}{late}"


def document(status: StudyStatus) -> dict[str, Any]:
    """All of it, for --json."""
    return asdict(status)
