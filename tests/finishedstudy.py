"""The folder of a study as it is when participants have been through it, with everything that can go on."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from ratedstudy import of_condition, rated

from taskcomm.logs import trial_bytes
from taskcomm.trials import Trial
from taskcomm.web.study.assignment import Participant, TrialPlan
from taskcomm.web.study.design import Design
from taskcomm.web.study.folder import StudyFolder
from taskcomm.web.study.structure import HUMAN, ROBOT, Operators

TEACHERS = 4
DECLINED = "P04"


def finished(path: Path, simulated: bool = False) -> StudyFolder:
    """Two teachers who are through, one in the midst of it, one who declined."""
    design = Design(
        name="two-ways", title="Two ways", teachers=TEACHERS, simulated=simulated, conditions=(ROBOT, HUMAN),
        operators=Operators(draw=1), practice="pomdp",
    )  # fmt: skip
    folder = StudyFolder.new(path, design)
    for number, participant in enumerate(folder.participants):
        session = sessions(participant, folder.design.consent.version)
        if participant.id == DECLINED:
            session = session[:1]
            session[0]["values"]["agreed"] = False
        folder.session_of(participant.id).write_bytes(as_lines(session))
        for plan in participant.trials if participant.id != DECLINED else ():
            folder.log_of(plan).write_bytes(trial_bytes(as_planned(plan, number, simulated)))
    last = folder.participants[2]
    torn = folder.log_of(last.trials[-1])
    torn.write_bytes(torn.read_bytes()[:-400])
    folder.log_of(folder.participants[3].trials[0]).write_bytes(b"")
    folder.server_log.write_text('{"seq":0,"type":"start"}\n', encoding="utf-8")
    return folder


def as_planned(plan: TrialPlan, number: int, simulated: bool) -> Trial:
    """A trial of the simulated study under the names of this one, with events and labels among its lines."""
    trial = of_condition(rated(), plan.condition)[number]
    steps = trial.steps if simulated else tuple(replace(step, mental_state=None) for step in trial.steps)
    named = replace(
        trial, trial_id=plan.trial_id, participant_id=plan.participant_id, operator_id=plan.operator_id,
        trial_index=plan.index, session="two-ways", started_utc="2026-11-22T10:00:00Z", steps=steps,
        source="simulated" if simulated else "human", ratings=() if plan.practice else scaled(trial),
    )  # fmt: skip
    first = int(named.presses.argmax())
    at = {"t": first, "server_ms": 500.0 * first + 120.25}
    events: tuple[dict[str, Any], ...] = (
        {"kind": "focus", "on": True, "seq": 1},
        {"kind": "press", **at, "n": 1, "at": 1.7e12, "rtt_ms": 3.5, "seq": first + 3},
        {"type": "resume", "steps": first, "seq": first + 4},
    )
    named = replace(named, events=events)
    label = {"press_seq": named.step_seqs[first], "mental_state": "that_mov"}
    return replace(named, labels=({**label, "annotator": "ann"}, {**label, "annotator": "bob"}))


def scaled(trial: Trial) -> tuple[dict[str, Any], ...]:
    """Ratings with scales as the pages write them."""
    low_high, choices = {"low": 1, "high": 10}, {"choices": ["yes", "no"]}
    scales = {"intelligence": low_high, "right": choices}
    return tuple({**line, "scale": scales[line["item"]]} for line in trial.ratings)


def sessions(participant: Participant, version: str) -> list[dict[str, Any]]:
    """The pages done by one who went through to the end."""
    pages: list[tuple[str, str, dict[str, Any]]] = [
        ("consent", "consent", {"agreed": True, "version": version}),
        ("form", "questionnaire", {"age": 22, "familiarity": 3}),
        ("text", "instructions", {}),
    ]
    for plan in participant.trials:
        pages += [("card", f"card-{plan.trial_id}", {}), ("trial", plan.trial_id, {"reason": "final"})]
        if not plan.practice:
            pages.append(("form", f"rating-{plan.trial_id}", {"intelligence": 9, "right": "yes"}))
    return [
        {"seq": seq, "type": "page", "page": seq, "kind": kind, "name": name, "values": values}
        | {"utc": "2026-11-22T10:00:00Z"}
        for seq, (kind, name, values) in enumerate(pages)
    ]


def as_lines(lines: list[dict[str, Any]]) -> bytes:
    return "".join(json.dumps(line) + "\n" for line in lines).encode()
