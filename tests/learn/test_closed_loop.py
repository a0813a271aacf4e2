"""The closed loop: common random numbers, whatever the number of processes, and what is made of it."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tinyworld import menu

from learn.calibration import calibration
from learn.closed_loop import ClosedLoop, Design, Outcome, outcome_of, run_closed_loop
from learn.decisions import disagreement
from taskcomm.belief import Belief
from taskcomm.planner import EntropyPlanner
from taskcomm.robot import Robot
from taskcomm.simulate import SimulatedTeacher, run_trial
from taskcomm.teacher import ModelError, TableTop, TeacherModel
from taskcomm.world import BallWorld

WORLD, EAGER = menu()
(APPROVES,) = EAGER.approvals
LAZY = replace(EAGER, mistake=0.005, approvals={APPROVES: TableTop("pointed_at", 0.1, 2.0, 2.0)})


def same(one: Outcome, two: Outcome) -> bool:
    arrays = all(
        np.array_equal(getattr(one, name), getattr(two, name)) for name in ("entropy", "highest", "right")
    )
    return arrays and (one.steps, one.correct, one.presses) == (two.steps, two.correct, two.presses)


def test_arms_with_one_model_have_one_luck_and_so_one_outcome() -> None:
    loop = run_closed_loop(WORLD, {"a": EAGER, "b": EAGER}, LAZY, 6, horizon=2, jobs=1)
    assert all(same(a, b) for a, b in zip(loop.outcomes["a"], loop.outcomes["b"], strict=True))
    assert len({outcome.steps for outcome in loop.outcomes["a"]}) > 1
    assert loop.time_ratio("a", "b").estimate == 1.0
    assert loop.difference("a", "b", "time").high == 0.0


def test_outcomes_depend_on_the_seed_but_not_on_the_number_of_processes_or_of_trials() -> None:
    arms = {"lazy": LAZY, "eager": EAGER}
    alone = run_closed_loop(WORLD, arms, EAGER, 5, horizon=2, seed=7, jobs=1)
    shared = run_closed_loop(WORLD, arms, EAGER, 5, horizon=2, seed=7, jobs=2)
    longer = run_closed_loop(WORLD, arms, EAGER, 8, horizon=2, seed=7, jobs=1)
    other = run_closed_loop(WORLD, arms, EAGER, 5, horizon=2, seed=8, jobs=1)
    for arm in arms:
        for n in range(5):
            assert same(alone.outcomes[arm][n], shared.outcomes[arm][n])
            assert same(alone.outcomes[arm][n], longer.outcomes[arm][n])
    assert not all(same(alone.outcomes["eager"][n], other.outcomes["eager"][n]) for n in range(5))


def test_an_outcome_says_what_its_trial_came_to() -> None:
    robot = Robot(WORLD, EAGER, EntropyPlanner(WORLD, EAGER, horizon=2))
    trial = run_trial(robot, SimulatedTeacher(WORLD, EAGER, WORLD.tasks[2]), np.random.default_rng(0))
    found = outcome_of(trial, EAGER)
    assert (found.steps, found.correct, found.presses) == (
        trial.num_steps,
        trial.displayed == trial.task,
        sum(bool(step.pressed) for step in trial.steps),
    )
    assert len(found.entropy) == len(found.highest) == len(found.right) == trial.num_steps + 1
    assert found.highest[-1] == robot.belief.marginal().max()
    assert found.entropy[0] == pytest.approx(np.log(len(WORLD.tasks)))


def test_a_trial_cut_short_is_a_timeout_not_correct_and_counted_at_its_length() -> None:
    loop = run_closed_loop(WORLD, {"a": LAZY}, LAZY, 4, horizon=1, max_steps=3, jobs=1)
    assert loop.timeout("a").all()
    assert not loop.correct("a").any()
    assert (loop.time("a") == 1.5).all()


def test_several_truths_take_turns_and_are_resampled_whole() -> None:
    loop = run_closed_loop(WORLD, {"a": EAGER}, [EAGER, LAZY], 4, horizon=1, max_steps=20, jobs=1)
    assert loop.groups == (0, 1, 0, 1)
    assert loop.mean("a", "time").groups == 2


def test_robots_of_the_ball_world_run_too() -> None:
    model = TeacherModel.intuitive()
    loop = run_closed_loop(BallWorld(2, 2), {"a": model}, model, 2, horizon=3, max_steps=40, jobs=1)
    assert all(len(outcome.entropy) == outcome.steps + 1 for outcome in loop.outcomes["a"])
    assert (loop.presses("a") > 0).any()


def test_arms_may_differ_in_how_far_they_look() -> None:
    arms = {"near": Design(EAGER, 1), "far": Design(EAGER, 3), "timed": Design(EAGER, 3, deadline=1000.0)}
    loop = run_closed_loop(WORLD, arms, LAZY, 6, jobs=1)
    for arm, horizon in (("near", 1), ("far", 3), ("timed", 3)):
        alone = run_closed_loop(WORLD, {arm: EAGER}, LAZY, 6, horizon=horizon, jobs=1)
        assert all(same(a, b) for a, b in zip(loop.outcomes[arm], alone.outcomes[arm], strict=True))
    assert not all(same(a, b) for a, b in zip(loop.outcomes["near"], loop.outcomes["far"], strict=True))
    assert loop.settings["horizons"] == {"near": 1, "far": 3, "timed": 3}
    assert loop.settings["deadlines"] == {"near": None, "far": None, "timed": 1000.0}


def test_what_cannot_run_is_refused() -> None:
    with pytest.raises(ValueError, match="0 arms, 1 truths, 3 trials"):
        run_closed_loop(WORLD, {}, EAGER, 3)
    with pytest.raises(ModelError, match=r"dt: the closed loop has models with 0\.25 s, 0\.5 s"):
        run_closed_loop(WORLD, {"a": EAGER}, EAGER.with_dt(0.25), 3)


def outcome(steps: int, highest: list[float], right: list[bool], correct: bool = True) -> Outcome:
    return Outcome(steps, correct, False, 1, np.zeros(len(highest)), np.array(highest), np.array(right))


def test_calibration_takes_the_first_moment_past_the_threshold() -> None:
    outcomes = [
        outcome(2, [0.5, 0.99, 0.7], [False, True, False]),
        outcome(2, [0.5, 0.985, 0.999], [False, False, True]),
        outcome(1, [0.5, 0.98], [True, True]),
    ]
    found = calibration(outcomes)
    assert (found.trials, found.sure, found.right.estimate) == (3, 2, 0.5)
    assert found.said == pytest.approx(0.9875)
    last = found.rows[-1]
    assert (last["above"], last["to"], last["steps"]) == (0.98, 1.0, 3)
    assert last["right"] == pytest.approx(2 / 3)
    assert sum(row["steps"] for row in found.rows) == 8


def test_a_robot_with_the_true_model_is_calibrated() -> None:
    loop = run_closed_loop(WORLD, {"true": EAGER}, EAGER, 80, horizon=1, jobs=1)
    rows = calibration(loop.outcomes["true"]).rows
    said = sum(row["said"] * row["steps"] for row in rows)
    right = sum(row["right"] * row["steps"] for row in rows)
    steps = sum(row["steps"] for row in rows)
    assert abs(said - right) / steps < 0.06


def test_a_model_disagrees_with_itself_nowhere_and_loses_nothing() -> None:
    trials = [
        run_trial(
            Robot(WORLD, EAGER, EntropyPlanner(WORLD, EAGER, horizon=1)),
            SimulatedTeacher(WORLD, EAGER, WORLD.tasks[n]),
            np.random.default_rng(n),
        )
        for n in range(3)
    ]
    people = ["a", "b", "a"]
    same_model = disagreement(trials, people, lambda n: EAGER, lambda n: EAGER, horizon=2, sample=None)
    steps = sum(trial.num_steps for trial in trials)
    assert len(same_model.differs) + same_model.walking == steps
    assert not same_model.differs.any()
    assert same_model.loss.max() < 1e-9
    found = disagreement(trials, people, lambda n: LAZY, lambda n: EAGER, horizon=2, sample=10, seed=1)
    assert len(found.differs) + found.walking == 10
    assert (found.loss[~found.differs] < 1e-9).all()
    assert (found.loss[found.differs] > 1e-9).all()
    assert found.differs.any()


def test_the_loss_of_a_decision_is_the_excess_of_its_value_under_the_reference() -> None:
    trial = run_trial(
        Robot(WORLD, EAGER, EntropyPlanner(WORLD, EAGER, horizon=1)),
        SimulatedTeacher(WORLD, EAGER, WORLD.tasks[0]),
        np.random.default_rng(5),
        max_steps=6,
    )
    found = disagreement([trial], ["a"], lambda n: LAZY, lambda n: EAGER, horizon=2, sample=None)
    assert found.walking == 0
    state, mine, theirs = WORLD.start(), Belief.initial(WORLD, LAZY), Belief.initial(WORLD, EAGER)
    for t, step in enumerate(trial.steps):
        action = EntropyPlanner(WORLD, LAZY, horizon=2).plan(mine, state).action
        values = EntropyPlanner(WORLD, EAGER, horizon=2).plan(theirs, state, exact_values=True).values
        assert found.loss[t] == pytest.approx(values[action] - min(values.values()), abs=1e-12)
        state = WORLD.step(state, str(step.action))
        mine, theirs = mine.update(state, step.pressed), theirs.update(state, step.pressed)


def test_rows_hold_every_trial_of_every_arm() -> None:
    loop = ClosedLoop(
        {"a": (outcome(4, [0.5], [True]),), "b": (outcome(6, [0.5], [True], correct=False),)}, (0,), 0.5
    )
    assert [(row["arm"], row["time_s"], row["correct"]) for row in loop.rows()] == [
        ("a", 2.0, 1),
        ("b", 3.0, 0),
    ]
    assert loop.time_ratio("b", "a").estimate == 1.5
    assert loop.difference("b", "a", "correct").estimate == -1.0


@pytest.mark.parametrize("jobs", [1, 2])
def test_the_search_is_compiled_before_it_is_needed_in_several_processes(
    jobs: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []

    def mapped(work: Any, items: Any, *_: Any) -> list[Any]:
        done.append("map")
        return [work(item) for item in items]

    for module in ("learn.closed_loop", "learn.decisions"):
        monkeypatch.setattr(f"{module}.map_in_order", mapped)
    monkeypatch.setattr(EntropyPlanner, "warm_up", lambda _: done.append("warm"))
    run_closed_loop(WORLD, {"eager": EAGER}, EAGER, 1, horizon=1, jobs=jobs)
    trial = run_trial(
        Robot(WORLD, EAGER, EntropyPlanner(WORLD, EAGER, horizon=1)),
        SimulatedTeacher(WORLD, EAGER, WORLD.tasks[0]),
        np.random.default_rng(0),
    )
    disagreement([trial], ["a"], lambda n: EAGER, lambda n: EAGER, horizon=1, jobs=jobs)
    assert done == (["map"] if jobs == 1 else ["warm", "map"]) * 2
