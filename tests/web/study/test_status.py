"""How a study stands, from its files: who is where, what was lost, whatever state the files are in."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskcomm.logs import trial_bytes
from taskcomm.operators import ScriptedOperator
from taskcomm.simulate import SimulatedTeacher, run_trial
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial
from taskcomm.web.study.assignment import TrialPlan, assign
from taskcomm.web.study.design import Design, Operators
from taskcomm.web.study.folder import StudyFolder
from taskcomm.web.study.pages import pages
from taskcomm.web.study.status import StudyStatus, study_status
from taskcomm.web.study.structure import HUMAN, ROBOT
from taskcomm.web.study.trialstatus import trial_status

SMALL = Design(
    name="small", seed=3, teachers=3, operators=Operators(draw=1), conditions=(ROBOT, HUMAN), practice="pomdp"
)


@pytest.fixture
def study(tmp_path: Path) -> StudyFolder:
    return StudyFolder.new(tmp_path / "study", SMALL)


def simulated(plan: TrialPlan, seed: int = 1) -> Trial:
    """A trial of a simulated teacher with a scripted operator, as the plan has it."""
    world = SMALL.ball_world
    teacher = SimulatedTeacher(world, TeacherModel.intuitive(), plan.task)
    trial = run_trial(ScriptedOperator(world), teacher, np.random.default_rng(seed), trial_id=plan.trial_id)
    return replace(trial, participant_id=plan.participant_id, condition=plan.condition)


def do_pages(study: StudyFolder, name: str, count: int, **values: Any) -> None:
    """Write the first `count` pages of a participant as done."""
    specs = pages(study.design, study.texts, study.participant(name))
    lines = [
        {"seq": n, "type": "page", "page": n, "kind": spec.kind, "name": spec.name, "values": values}
        for n, spec in enumerate(specs[:count])
    ]
    study.session_of(name).write_text("".join(json.dumps(line) + "\n" for line in lines))


def at(status: StudyStatus) -> list[str]:
    return [person.at for person in status.participants]


def test_nobody_has_begun(study: StudyFolder) -> None:
    status = study_status(study)
    assert at(status) == ["not begun"] * 3
    assert {trial.state for trial in status.trials} == {"not begun"}
    assert len(status.trials) == 6
    assert (status.problems, status.warnings) == ((), ())


def test_everyone_is_at_the_first_page_that_is_not_done(study: StudyFolder) -> None:
    specs = pages(study.design, study.texts, study.participant("P01"))
    for count in range(1, len(specs)):
        do_pages(study, "P01", count)
        person = study_status(study).participants[0]
        wanted = "done" if count == len(specs) - 1 else specs[count].name
        assert (person.at, person.page, person.of) == (wanted, count, len(specs))


def test_who_agreed_to_other_words_than_those_of_now_is_said(study: StudyFolder) -> None:
    do_pages(study, "P01", 1, agreed=True, version="1")
    do_pages(study, "P02", 1, agreed=True, version="0")
    status = study_status(study)
    assert [person.consent for person in status.participants] == ["1", "0", None]
    assert status.warnings == ("P02 agreed to version 0 of the consent, which is now 1",)


def test_who_declined_is_nowhere_else(study: StudyFolder) -> None:
    do_pages(study, "P02", 1, agreed=False)
    assert at(study_status(study)) == ["not begun", "declined", "not begun"]


def test_what_was_lost_is_counted(study: StudyFolder) -> None:
    first, counted, _ = study.participant("P01").trials
    trial = simulated(counted)
    pressed, lost = sum(step.pressed is True for step in trial.steps), 0
    steps = list(trial.steps)
    for t in range(0, len(steps), 7):
        pressed -= steps[t].pressed is True
        steps[t], lost = replace(steps[t], pressed=None, timing={"late_ms": float(t)}), lost + 1
    clock = {"kind": "clock", "role": "teacher", "rtt_ms": 12.5, "seq": 1}
    told = replace(trial, steps=tuple(steps), events=(clock, {"type": "resume", "seq": 3}))
    study.log_of(counted).write_bytes(trial_bytes(told))
    study.log_of(first).write_bytes(trial_bytes(simulated(first)))
    status = study_status(study)
    found = status.participants[0].counted[0]
    assert found.state == trial.reason
    assert found.correct == trial.correct
    assert (found.steps, found.presses, found.lost, found.resumes) == (len(steps), pressed, lost, 1)
    assert found.defaults == sum(step.action_source == "default" for step in trial.steps)
    assert found.timings.late_ms_max == 7.0 * (lost - 1)
    assert found.timings.rtt_ms == 12.5
    assert [t.practice for t in status.participants[0].trials] == [True, False, False]


def test_a_torn_line_is_reported_wherever_it_is(study: StudyFolder) -> None:
    plan = study.participant("P02").trials[1]
    content = trial_bytes(simulated(plan))
    study.log_of(plan).write_bytes(content[: len(content) // 2])
    do_pages(study, "P03", 2)
    with study.session_of("P03").open("a") as file:
        file.write('{"seq": 2, "ty')
    study.server_log.write_text(
        '{"kind": "start"}\n{"kind": "torn", "file": "P01-1.jsonl", "bytes": 9}\n{"ki'
    )
    status = study_status(study)
    assert status.problems == (
        "server.jsonl: torn last line",
        "P01-1.jsonl: a torn last line was cut off (9 bytes)",
        "P02-1.jsonl: torn last line",
        "P03.jsonl: torn last line",
    )
    assert status.participants[1].counted[0].state == "unfinished"
    assert status.participants[2].at == "instructions"
    assert status.server == {"start": 1, "torn": 1}


def test_a_line_that_is_none_is_named_and_the_rest_counted(study: StudyFolder) -> None:
    plan = study.participant("P01").trials[1]
    lines = trial_bytes(simulated(plan)).splitlines(keepends=True)
    study.log_of(plan).write_bytes(b"".join([*lines[:2], b"\x00\xff\n", *lines[2:]]))
    status = study_status(study)
    assert status.problems == ("P01-1.jsonl:3: not a JSON object",)
    assert status.participants[0].counted[0].steps == len(simulated(plan).steps)


PLAN = assign(SMALL)[0].trials[1]
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=9), inner, max_size=3),
    max_leaves=6,
)
KEYS = ("type", "kind", "press", "timing", "rtt_ms", "role", "reason", "missed", "action_source", "correct")
LINES = st.dictionaries(
    st.sampled_from(KEYS), JSON | st.sampled_from(["step", "event", "trial_end", "timing"])
)


@given(
    content=st.lists(LINES.map(lambda line: json.dumps(line).encode()) | st.binary(max_size=20), max_size=8)
)
def test_any_file_has_a_status(tmp_path_factory: pytest.TempPathFactory, content: list[bytes]) -> None:
    path = tmp_path_factory.mktemp("any") / "P01-1.jsonl"
    path.write_bytes(b"\n".join(content))
    status = trial_status(path, PLAN)
    assert status.lost + status.presses <= status.steps
    assert status.state in ("not begun", "unfinished", "final", "timeout", "aborted")
