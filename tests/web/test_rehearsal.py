import asyncio
from pathlib import Path
from typing import Any

import pytest
from web.rehearsing import everybody, logs, run_through, study

from taskcomm.logs import read_trials, validate
from taskcomm.web.rehearsal import Rehearsal, RehearsalError
from taskcomm.web.serverprocess import ServerError, ServerProcess
from taskcomm.web.study.structure import Timing

WALL_CLOCK = {"utc", "started_utc", "at", "server_ms", "rtt_ms", "offset_ms"}


@pytest.fixture(scope="module")
def rehearsal(tmp_path_factory: pytest.TempPathFactory) -> Rehearsal:
    return run_through(study(tmp_path_factory.mktemp("first") / "study", 2, operators=2), after=labelled)


def labelled(rehearsal: Rehearsal) -> None:
    rehearsal.labels = asyncio.run(rehearsal.label())  # type: ignore[attr-defined]


def test_every_trial_of_a_rehearsed_study_ends_and_validates(rehearsal: Rehearsal) -> None:
    folder = rehearsal.folder
    report = validate([folder.trials_dir])
    assert report.ok, report.problems[:3]
    trials = read_trials([folder.trials_dir])
    assert {trial.trial_id for trial in trials} == {"P01-1", "P01-2", "P02-1", "P02-2"}
    assert {trial.condition for trial in trials} == {"pomdp", "operator"}
    assert sum(bool(trial.correct) for trial in trials) >= 2


def test_logs_of_programs_say_that_they_are_simulated(rehearsal: Rehearsal) -> None:
    for name, lines in logs(rehearsal.folder).items():
        assert lines[0]["source"] == "simulated", name


def test_logged_presses_are_those_that_the_teacher_meant(rehearsal: Rehearsal) -> None:
    folder = rehearsal.folder
    trials = {trial.trial_id: trial for trial in read_trials([folder.trials_dir])}
    for person in folder.participants:
        for plan, lesson in zip(person.trials, rehearsal.teachers[person.id].lessons, strict=True):
            trial = trials[plan.trial_id]
            assert [m.pressed for m in lesson.moments] == list(trial.presses)
            assert [m.state for m in lesson.moments] == list(trial.states)
            assert lesson.task == trial.task == plan.task
            assert lesson.final == trial.displayed


def test_every_press_is_labelled_with_its_true_reason(rehearsal: Rehearsal) -> None:
    reasons = rehearsal.reasons()
    trials = read_trials([rehearsal.folder.trials_dir])
    assert {trial.trial_id: trial.reasons for trial in trials} == reasons
    assert sum(map(len, reasons.values())) > 10


def test_the_same_seed_gives_the_same_logs_but_for_wall_clock_fields(
    rehearsal: Rehearsal, tmp_path: Path
) -> None:
    again = run_through(study(tmp_path / "study", 2, operators=2), after=labelled)
    first, second = (
        {name: timeless(lines) for name, lines in logs(done.folder).items()} for done in (rehearsal, again)
    )
    assert first == second


def timeless(lines: list[dict[str, Any]]) -> list[list[dict[str, Any]]]:
    """The lines of a log without times; what several people did within one step in an order of its own."""
    steps: list[list[dict[str, Any]]] = [[]]
    for line in lines:
        steps[-1].append({key: value for key, value in line.items() if key not in WALL_CLOCK | {"seq"}})
        if line["type"] == "step":
            steps.append([])
    return [sorted(step, key=str) for step in steps]


def test_a_study_that_does_not_get_on_is_given_up_with_where_everybody_is(tmp_path: Path) -> None:
    folder = study(tmp_path / "study", 1, operators=0, timing=Timing(limit=60.0, countdown=20.0))
    server = ServerProcess(folder.path, tmp_path / "server.err", lockstep=False)
    server.start()
    try:
        with pytest.raises(RehearsalError, match=r"nobody got on for 1 s: P01 at page 3, step 0"):
            asyncio.run(everybody(folder, server.address, stall=1.0).run())
    finally:
        server.kill()


def test_a_server_that_cannot_start_says_why(tmp_path: Path) -> None:
    server = ServerProcess(tmp_path / "nothing", tmp_path / "server.err", lockstep=False)
    with pytest.raises(ServerError, match="is no folder of a study"):
        server.start()
