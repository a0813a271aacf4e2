"""Kill -9 at random moments of a rehearsed study, start again, go on: what was acknowledged is there."""

import asyncio
from pathlib import Path

import numpy as np
import pytest
from web.rehearsing import everybody, lines, logs, run_through, study

from taskcomm.logs import read_trials, validate
from taskcomm.web.rehearsal import Rehearsal
from taskcomm.web.serverprocess import ServerProcess
from taskcomm.web.study.folder import StudyFolder


async def drilled(folder: StudyFolder, kills: int, rng: np.random.Generator) -> tuple[Rehearsal, int]:
    """A rehearsal whose server is killed so many times, or until the study is over; how many times it was."""
    server = ServerProcess(folder.path, folder.path / "server.err", lockstep=True)
    server.start()
    rehearsal = everybody(folder, server.address, at_once=4)
    study_over = asyncio.create_task(rehearsal.run())
    killed = 0
    try:
        while killed < kills:
            await asyncio.wait({study_over}, timeout=float(rng.uniform(0.02, 1.0)))
            if study_over.done():
                break
            server.kill()
            killed += 1
            await asyncio.to_thread(server.start)
        await study_over
        server.stop()
    finally:
        study_over.cancel()
        server.kill()
    return rehearsal, killed


def check(rehearsal: Rehearsal) -> None:
    """What was acknowledged is on disk, every log is whole, everybody came to the end."""
    folder, trials = rehearsal.folder, logs(rehearsal.folder)
    for trial_id, seq in rehearsal.saved.items():
        assert seq < len(trials[trial_id]), f"{trial_id}: line {seq} was said to be on disk"
    for trial_id, written in trials.items():
        assert [line["seq"] for line in written] == list(range(len(written)))
        assert sum(line["type"] == "trial_end" for line in written) == 1, trial_id
    for person in folder.participants:
        bot = rehearsal.teachers[person.id]
        done = {line["page"] for line in lines(folder.session_of(person.id))}
        assert bot.acknowledged["answer"] <= done
        of_person = [line for plan in person.trials for line in trials[plan.trial_id]]
        presses = [line["n"] for line in of_person if line["type"] == "event" and line["kind"] == "press"]
        assert bot.acknowledged.get("press", set()) <= set(presses)
        assert len(presses) == len(set(presses))
    report = validate([folder.trials_dir])
    assert report.ok, report.problems[:3]
    assert report.notices == ()


def steps(folder: StudyFolder) -> dict[str, list[tuple[str, bool | None]]]:
    """What happened in the planner's trials, which nothing but the seed decides."""
    trials = read_trials([folder.trials_dir])
    return {
        trial.trial_id: [(str(step.action), step.pressed) for step in trial.steps]
        for trial in trials
        if trial.condition == "pomdp"
    }


def drill(path: Path, kills: int, seed: int) -> None:
    rng, killed, number, resumed = np.random.default_rng(seed), 0, 0, 0
    whole: dict[str, list[tuple[str, bool | None]]] = {}
    while killed < kills:
        folder = study(path / f"drilled-{number}", 4, operators=2, seed=number)
        rehearsal, times = asyncio.run(drilled(folder, kills - killed, rng))
        check(rehearsal)
        resumed += sum(line["type"] == "resume" for log in logs(folder).values() for line in log)
        if number == 0:
            whole = steps(run_through(study(path / "whole", 4, operators=2)).folder)
            assert steps(folder) == whole
        killed, number = killed + times, number + 1
    assert resumed >= kills / 2


def test_ten_kills_lose_nothing_and_change_no_step_of_the_planners_trials(tmp_path: Path) -> None:
    drill(tmp_path, 10, seed=1)


@pytest.mark.verify
def test_a_hundred_kills_lose_nothing_and_change_no_step_of_the_planners_trials(tmp_path: Path) -> None:
    drill(tmp_path, 100, seed=2)
