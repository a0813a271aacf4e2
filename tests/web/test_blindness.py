"""Nothing that comes to the teacher's page tells who controls the robot, but the robot's actions."""

import asyncio
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from web.loading import undecided
from web.rehearsing import OPERATOR, everybody, study
from web.traffic import Floats, Wire, beginning, features, form, offsets, order, told_apart

from taskcomm.web.serverprocess import ServerProcess
from taskcomm.web.study.folder import StudyFolder
from taskcomm.web.study.structure import CERTAIN, Condition, Timing

Trials = Mapping[str, list[list[tuple[float, bytes]]]]


def overheard(folder: StudyFolder, presses: float) -> Trials:
    """A rehearsal in real time: what came to the teachers in their trials, by condition, in one order."""
    wires = {person.id: Wire() for person in folder.participants}
    server = ServerProcess(folder.path, folder.path / "server.err", lockstep=False)
    server.start()
    try:
        model = undecided(folder.design.timing.step, presses)
        rehearsal = everybody(folder, server.address, model, heard=wires, at_once=99)
        asyncio.run(rehearsal.run())
        server.stop()
    finally:
        server.kill()
    trials: dict[str, list[Any]] = {"pomdp": [], "operator": []}
    for person in folder.participants:
        for plan, trial in zip(person.trials, wires[person.id].trials(), strict=True):
            trials[plan.condition].append(trial)
    return trials


def planned(path: Path, teachers: int, step: float, limit: float) -> StudyFolder:
    timing = Timing(step=step, limit=limit, countdown=1.0)
    conditions = (Condition(name="pomdp", controller="planner", horizon=4, threshold=CERTAIN), OPERATOR)
    return study(path, teachers, operators=teachers, conditions=conditions, timing=timing)


def forms(trials: Trials, condition: str) -> set[Any]:
    return set().union(*(form(trial) for trial in trials[condition]))


def orders(trials: Trials, condition: str) -> set[Any]:
    return set().union(*(order(trial) for trial in trials[condition]))


def test_messages_of_both_conditions_have_one_form_and_come_at_one_moment_of_the_step(tmp_path: Path) -> None:
    trials = overheard(planned(tmp_path / "study", 4, 0.1, 3.0), 0.1)
    assert forms(trials, "pomdp") == forms(trials, "operator")
    assert {size for *_, size in forms(trials, "pomdp")} == {0, 512}
    assert orders(trials, "pomdp") == orders(trials, "operator")
    for condition in trials:
        late = np.concatenate([offsets(trial, 0.1) for trial in trials[condition]])
        assert np.median(late) < 25.0


@pytest.mark.verify
def test_a_classifier_over_sizes_and_timings_cannot_tell_the_conditions(tmp_path: Path) -> None:
    step = 0.25
    trials = overheard(planned(tmp_path / "study", 16, step, 20.0), 0.02)
    both = [[beginning(trial, 40) for trial in trials[name]] for name in ("pomdp", "operator")]
    pairs = [(features(a, step), features(b, step)) for a, b in zip(*both, strict=True) if a and b]
    assert len(pairs) >= 12
    share, chance = told_apart(pairs, np.random.default_rng(1))
    print(f"told apart: {share:.0%} of {len(pairs)} pairs, as often by chance in {chance:.3f} of exchanges")
    assert chance > 0.001


@pytest.mark.parametrize("leak", ["a frame's size", "two milliseconds", "a longer wait"])
def test_the_classifier_finds_a_leak(leak: str) -> None:
    """Sixteen pairs of made-up trials that differ by noise, and by the leak."""
    rng = np.random.default_rng(2)
    shift = {"a frame's size": 6, "two milliseconds": 1, "a longer wait": 10}[leak]

    def trial(leaks: bool) -> Floats:
        numbers = np.array([1, 2, 4, 1.0, 1.0, 0.5, 512, 300, 2, 1, 0.3, 0.01])
        numbers[[0, 1, 2, 3, 4, 10, 11]] += np.array([0.5, 1, 2, 1, 0.5, 0.1, 0.005]) * rng.standard_normal(7)
        numbers[shift] += leaks * {6: 8.0, 1: 2.0, 10: 0.2}[shift]
        return numbers

    share, chance = told_apart([(trial(True), trial(False)) for _ in range(16)], rng)
    assert share > 0.8
    assert chance < 0.01


def test_the_classifier_finds_nothing_where_there_is_nothing() -> None:
    rng = np.random.default_rng(3)
    chances = []
    for _ in range(40):
        pairs = [(rng.standard_normal(5), rng.standard_normal(5)) for _ in range(16)]
        chances.append(told_apart(pairs, rng, exchanges=300)[1])
    assert np.mean(np.array(chances) < 0.05) <= 0.2
