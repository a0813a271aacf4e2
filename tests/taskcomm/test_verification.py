"""A log run again: what the robot it names did is as logged, and anything else is found where it begins."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from taskcomm.logs import read_trials, write_trials
from taskcomm.operators import ScriptedOperator
from taskcomm.planner import EntropyPlanner
from taskcomm.robot import Controller, Final, Robot
from taskcomm.simulate import SimulatedTeacher, run_trial
from taskcomm.tasks import Task
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Step, Trial
from taskcomm.verification import UnverifiableTrial, verify
from taskcomm.world import NOA, Action, BallWorld, InvalidAction

STUDY = Path(__file__).parents[2] / "datasets" / "simulated-study"
MODEL = TeacherModel.intuitive()
WORLD = BallWorld(3, 2)


def planner(world: BallWorld = WORLD, horizon: int = 2, **settings: Any) -> EntropyPlanner:
    return EntropyPlanner(world, MODEL, horizon=horizon, **settings)


def played(controller: Controller, seed: int = 0) -> Trial:
    rng = np.random.default_rng(seed)
    world = controller.world
    return run_trial(controller, SimulatedTeacher(world, MODEL, world.tasks[seed % len(world.tasks)]), rng)


@pytest.fixture(scope="module")
def trial() -> Trial:
    """One that the planner controlled."""
    return played(Robot(WORLD, MODEL, planner()), seed=3)


@pytest.fixture(scope="module")
def operated() -> Trial:
    return played(ScriptedOperator(WORLD), seed=1)


def changed(trial: Trial, t: int, **fields: Any) -> Trial:
    steps = list(trial.steps)
    steps[t] = replace(steps[t], **fields)
    return replace(trial, steps=tuple(steps))


def cut(trial: Trial, steps: int) -> Trial:
    return replace(trial, steps=trial.steps[:steps], reason=None, displayed=None)


def other_actions(trial: Trial, t: int) -> list[Action]:
    """Actions that the world allows instead of that of step t."""
    state = (trial.world.start(), *trial.states)[t]
    return [action for action in trial.world.actions(state) if action != trial.steps[t].action]


@pytest.mark.parametrize("seed", range(4))
def test_what_a_robot_did_is_found_as_logged(seed: int) -> None:
    trial = played(Robot(WORLD, MODEL, planner(), threshold=0.9), seed)
    found = verify(trial)
    assert found.same
    assert (found.decisions, found.defaults) == (trial.num_steps + 1, 0)
    assert found.unverified == ()


def test_trials_of_the_kept_study_are_as_logged() -> None:
    trials = sorted(read_trials(STUDY), key=lambda trial: trial.num_steps)
    for condition in ("pomdp", "operator"):
        for trial in [trial for trial in trials if trial.condition == condition][:2]:
            assert verify(trial).difference is None


@pytest.mark.verify
def test_every_trial_of_the_kept_study_is_as_logged() -> None:
    trials = read_trials(STUDY)
    assert sum(trial.planner is not None for trial in trials) == 22
    assert [str(verify(trial).difference) for trial in trials] == ["None"] * len(trials)


def test_another_action_is_found_in_its_step(trial: Trial) -> None:
    for t in range(trial.num_steps):
        for action in other_actions(trial, t)[:2]:
            found = verify(cut(changed(trial, t, action=action), t + 1)).difference
            assert found is not None
            assert (found.step, found.logged) == (t, str(action))
            assert str(trial.steps[t].action) in found.due


def test_a_changed_action_in_a_whole_trial_is_found_in_its_step(trial: Trial) -> None:
    found = 0
    for t in range(trial.num_steps):
        for action in other_actions(trial, t):
            tampered = changed(trial, t, action=action)
            try:
                assert len(tampered.states) == trial.num_steps
            except InvalidAction:
                continue
            difference = verify(tampered).difference
            assert difference is not None
            assert difference.step == t
            found += 1
    assert found > 3


def test_a_changed_press_is_found_where_the_robot_takes_another_course() -> None:
    trial = played(Robot(WORLD, MODEL, planner()), seed=5)
    t = int(np.flatnonzero(trial.presses)[0])
    tampered = changed(trial, t, pressed=False)
    robot = Robot(WORLD, MODEL, planner())
    pressed: bool | None = None
    same = 0
    for seen in tampered.steps:
        if robot.act(pressed) != seen.action:
            break
        pressed, same = seen.pressed, same + 1
    difference = verify(tampered).difference
    assert difference is not None
    assert difference.step == same > t


def test_late_decisions_stand_and_the_run_goes_on_from_them() -> None:
    robot, world = Robot(WORLD, MODEL, planner()), WORLD
    rng, task = np.random.default_rng(8), WORLD.tasks[4]
    teacher = SimulatedTeacher(world, MODEL, task)
    belief, state, steps = robot.belief, world.start(), list[Step]()
    while True:
        choice, source = robot.choose(belief, state), "planner"
        if len(steps) in (0, 5, 6) or (isinstance(choice, Final) and steps[-1].action_source == "planner"):
            choice, source = NOA, "default"
        if isinstance(choice, Final):
            break
        state = world.step(state, choice)
        pressed = teacher.observe(state, rng)
        seen = None if len(steps) in (3, 4, 9) else pressed
        steps.append(Step(choice, seen, source))
        belief = belief.update(state, seen)
    head = replace(played(robot), trial_id="late", task=task, steps=tuple(steps))
    trial = replace(head, reason="final", displayed=choice.task)
    found = verify(trial)
    assert found.difference is None
    assert (found.defaults, found.decisions) == (4, len(steps) - 3)
    called = verify(changed(trial, 0, action_source="planner")).difference
    assert called is not None
    assert (called.step, called.logged) == (0, "noa")


@pytest.mark.parametrize(
    ("tampered", "step", "due"),
    [
        (lambda trial: replace(trial, displayed=other_task(trial)), 0, r"the robot shows Final for"),
        (lambda trial: replace(trial, reason="timeout", displayed=None), 0, r"the robot shows Final for"),
        (lambda trial: replace(trial, steps=(*trial.steps, Step(NOA, False))), 0, r"the robot shows Final"),
        (lambda trial: replace(trial, steps=trial.steps[:-1]), -1, r"the (robot|planner) does"),
    ],
    ids=["another task", "a timeout", "a step too late", "a step too soon"],
)
def test_final_is_compared_with_its_step_and_its_task(
    trial: Trial, tampered: Callable[[Trial], Trial], step: int, due: str
) -> None:
    found = verify(tampered(trial)).difference
    assert found is not None
    assert found.step == trial.num_steps + step
    assert due.split("(")[0] in found.due


def other_task(trial: Trial) -> Task:
    return next(task for task in WORLD.tasks if task != trial.displayed)


def test_a_timeout_at_which_final_may_have_been_too_late_is_said(trial: Trial) -> None:
    last = trial.num_steps - 1
    timed = changed(trial, last, timing={"onset": 0.0, "late_ms": 0.1})
    found = verify(replace(timed, reason="timeout", displayed=None))
    assert found.same
    assert "Final was due" in found.unverified[0]


def test_trials_that_broke_off_or_were_aborted_are_compared_as_far_as_they_go(trial: Trial) -> None:
    for reason in (None, "aborted"):
        found = verify(replace(cut(trial, 4), reason=reason))
        assert found.same
        assert found.decisions == 4


def test_of_an_operator_source_and_end_are_compared(operated: Trial) -> None:
    found = verify(operated)
    assert found.same
    assert found.decisions + found.defaults == operated.num_steps + 1
    wrong = verify(replace(operated, displayed=other_task(operated))).difference
    assert wrong is not None
    assert wrong.step == operated.num_steps
    assert "the world does not show this task" in wrong.due
    other = verify(changed(operated, 7, action_source="planner")).difference
    assert other is not None
    assert (other.step, other.due) == (7, "chosen by the planner, where the operator controls the robot")


def test_a_model_is_known_by_its_parameters_and_asked_for_where_missing(trial: Trial) -> None:
    learned = replace(MODEL, mistake=0.01)
    told = played(Robot(WORLD, learned, EntropyPlanner(WORLD, learned, horizon=2)), seed=2)
    assert verify(told, (learned,)).same
    with pytest.raises(UnverifiableTrial, match=learned.sha256):
        verify(told)
    claimed = {"name": "intuitive", "sha256": learned.sha256}
    assert not verify(replace(trial, robot_model=claimed), (learned,)).same


def test_a_model_that_was_converted_to_the_step_of_the_trial_is_found() -> None:
    slow = MODEL.with_dt(1.0)
    robot = Robot(WORLD, slow, EntropyPlanner(WORLD, slow, horizon=2))
    trial = run_trial(robot, SimulatedTeacher(WORLD, slow, WORLD.tasks[3]), np.random.default_rng(1))
    assert trial.dt == 1.0
    assert verify(trial).same
    with pytest.raises(UnverifiableTrial, match=r"steps of 0\.5 s"):
        verify(replace(trial, dt=0.5))


@pytest.mark.parametrize("settings", [{"horizon": None}, {"horizon": 0}, {"threshold": 2.0}, {"gamma": "x"}])
def test_a_planner_that_is_not_described_is_one_error(trial: Trial, settings: dict[str, Any]) -> None:
    described = {**(trial.planner or {}), **settings}
    with pytest.raises(UnverifiableTrial, match=f"trial {trial.trial_id}: .* that can be run again"):
        verify(replace(trial, planner=described))


def test_of_random_ties_it_is_said_that_the_draw_is_not_compared() -> None:
    drawn = played(Robot(WORLD, MODEL, planner(ties="random")), seed=6)
    found = verify(drawn)
    assert found.same
    assert found.unverified == ("which of equally good actions was drawn",)
    first = {key: value for key, value in (drawn.planner or {}).items() if key != "ties"}
    difference = verify(replace(drawn, planner=first)).difference
    assert difference is not None
    assert "the first of those as good" in difference.due


def test_of_a_deadline_only_what_the_robot_is_sure_of_is_compared() -> None:
    timed = played(Robot(WORLD, MODEL, planner(horizon=3), deadline=0.2), seed=4)
    found = verify(timed)
    assert found.same
    assert 0 < found.decisions < timed.num_steps
    assert "deadline" in found.unverified[0]
    assert not verify(replace(timed, displayed=other_task(timed))).same
    early = replace(timed, steps=timed.steps[:2])
    assert "not sure" in str(verify(early).difference)


def test_discounting_planners_are_run_again_with_their_discount(tmp_path: Path) -> None:
    trial = played(Robot(WORLD, MODEL, planner(horizon=3, gamma=0.5)), seed=7)
    write_trials([trial], tmp_path / "one.jsonl")
    (again,) = read_trials(tmp_path)
    assert verify(again).same
