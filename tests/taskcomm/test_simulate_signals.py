"""Simulated teachers whose key errs and who show more than a key."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from signalled import gazing

from taskcomm.belief import Belief
from taskcomm.logs import read_trials, trial_bytes, write_trials
from taskcomm.observation import Observer, Signals
from taskcomm.operators import ScriptedOperator
from taskcomm.replay import belief_path, press_reasons
from taskcomm.robot import Final, Robot
from taskcomm.simulate import SimulatedTeacher, run_trial
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial
from taskcomm.world import NOA, BallWorld

WORLD = BallWorld(2, 1)


class Waiter:
    """A controller that lights ball 1, waits, and keeps what it hears."""

    source, dt, description = "default", 0.5, {"condition": "other"}
    world = WORLD

    def __init__(self, steps: int) -> None:
        self.steps = steps

    def reset(self, rng: np.random.Generator | None = None) -> None:
        self.heard: list[Any] = []

    def act(self, pressed: bool | None, signals: Signals | None = None) -> Any:
        self.heard.append((pressed, signals))
        if len(self.heard) > self.steps:
            return Final(WORLD.tasks[0])
        return WORLD.actions(WORLD.start())[1] if len(self.heard) == 1 else NOA


def _trial(model: TeacherModel, seed: int, steps: int = 40, controller: Any = None) -> Trial:
    teacher = SimulatedTeacher(WORLD, model, WORLD.tasks[0])
    return run_trial(controller or Waiter(steps), teacher, np.random.default_rng(seed))


def test_key_and_signals_follow_the_mental_state_by_the_model() -> None:
    """All steps of 60 simulated trials, each share within four standard errors."""
    model = gazing(miss=0.3, false_press=0.05)
    steps = [step for seed in range(60) for step in _trial(model, seed).steps]
    tables = Observer(WORLD, model).tables["gaze"]
    for column, state in enumerate(model.mental_states[:3]):
        own = [step for step in steps if step.mental_state == state]
        press = 0.05 if state == "waiting" else 0.7
        _within([step.pressed for step in own], press)
        for value, table in tables.items():
            _within([(step.signals or {})["gaze"] == value for step in own], table[0, column])


def _within(happened: list[Any], p: float) -> None:
    share = sum(map(bool, happened)) / len(happened)
    assert share == pytest.approx(p, abs=4 * float(np.sqrt(p * (1 - p) / len(happened))))


def test_mental_states_are_the_same_with_and_without_signals_up_to_the_numbers_drawn() -> None:
    """A model whose key says it all draws one number a step, as it always did."""
    first = SimulatedTeacher(WORLD, TeacherModel.intuitive(), WORLD.tasks[0])
    rng, own = np.random.default_rng(3), np.random.default_rng(3)
    for _ in range(20):
        first.observe(WORLD.start(), rng)
        own.random()
    assert rng.random() == own.random()
    assert first.signals is None


def test_what_is_heard_is_what_is_logged_and_read_again(tmp_path: Path) -> None:
    controller = Waiter(15)
    trial = _trial(gazing(miss=0.1), 1, controller=controller)
    assert controller.heard[0] == (None, None)
    assert controller.heard[1:] == [(step.pressed, step.signals) for step in trial.steps]
    assert trial.channels == ("gaze",)
    write_trials([trial], tmp_path / "log.jsonl")
    (again,) = read_trials(tmp_path / "log.jsonl")
    assert again == trial
    assert trial_bytes(again) == trial_bytes(trial)


def test_a_controller_that_takes_no_signals_gets_none() -> None:
    world = BallWorld()
    teacher = SimulatedTeacher(world, gazing(), world.tasks[0])
    trial = run_trial(ScriptedOperator(world), teacher, np.random.default_rng(0))
    assert trial.channels == ("gaze",)


def test_a_teacher_meets_the_same_luck_whichever_robot_it_teaches() -> None:
    """The same key and the same looks as long as both robots act alike."""
    world, model = BallWorld(), gazing()
    deaf, seeing = (Robot(world, m, _Still(world, m)) for m in (TeacherModel.intuitive(), model))
    trials = [
        run_trial(
            robot, SimulatedTeacher(world, model, world.tasks[3]), np.random.default_rng(5), max_steps=25
        )
        for robot in (deaf, seeing)
    ]
    assert [step.signals for step in trials[0].steps] == [step.signals for step in trials[1].steps]
    assert trials[0].presses.tolist() == trials[1].presses.tolist()


class _Still:
    """A planner that does nothing."""

    def __init__(self, world: BallWorld, model: TeacherModel) -> None:
        self.world, self.model, self.horizon = world, model, 1

    def plan(self, belief: Belief, state: Any) -> Any:
        return type("Decision", (), {"action": NOA})()


def test_a_replay_believes_what_the_robot_believed() -> None:
    world, model = BallWorld(), gazing(miss=0.1, false_press=0.02)
    robot = Robot(world, model, _Still(world, model))
    teacher = SimulatedTeacher(world, model, world.tasks[7])
    trial = run_trial(robot, teacher, np.random.default_rng(2), max_steps=30)
    path = belief_path(trial, model)
    assert path.marginal[-1] == pytest.approx(robot.belief.marginal(), rel=1e-9)
    assert path.to_json()["pressed"] == [step.pressed for step in trial.steps]


def test_a_replay_under_a_model_without_the_channel_is_that_of_the_key_alone() -> None:
    trial = _trial(gazing(), 4)
    keys = Trial("b", WORLD, None, tuple(type(s)(s.action, s.pressed) for s in trial.steps))
    intuitive = TeacherModel.intuitive()
    assert (belief_path(trial, intuitive).marginal == belief_path(keys, intuitive).marginal).all()


def test_reasons_believed_at_once_are_those_of_key_and_look() -> None:
    """A look at what is approved of makes the approval likelier; a false press is put down to waiting."""
    model = gazing(false_press=0.02)
    found = [
        (step, reason)
        for seed in range(6)
        for trial in [_trial(model, seed)]
        for reason in press_reasons(trial, model)
        for step in [trial.steps[reason.step]]
    ]
    by_look: dict[bool, list[float]] = {True: [], False: []}
    for step, reason in found:
        assert list(reason.at_once) == list(model.mental_states)
        assert sum(reason.at_once.values()) == pytest.approx(1, rel=1e-9)
        by_look[(step.signals or {})["gaze"] == "1"].append(reason.at_once["that_mov"])
    assert np.mean(by_look[True]) > np.mean(by_look[False])
