"""A replayed trial: its belief is the robot's, and the reasons of its presses are the exact ones."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import cue_columns, joint, paths
from tinyworld import menu

from taskcomm.replay import belief_path, press_reasons, situation
from taskcomm.robot import Robot
from taskcomm.simulate import SimulatedTeacher, run_trial
from taskcomm.teacher import ModelError, TeacherModel
from taskcomm.trials import Step, Trial
from taskcomm.world import BallWorld

WORLD, MODEL = BallWorld(2, 2), TeacherModel.intuitive()


def wandering_trial(seed: int, steps: int, presses: tuple[int, ...], world: BallWorld = WORLD) -> Trial:
    rng, state, done = np.random.default_rng(seed), world.start(), []
    for t in range(steps):
        actions = world.actions(state)
        action = actions[int(rng.integers(len(actions)))]
        state = world.step(state, action)
        done.append(Step(action, pressed=t in presses))
    return Trial(f"wander-{seed}", world, world.tasks[0], tuple(done))


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6), presses=st.sets(st.integers(0, 6), max_size=3).map(tuple))
def test_belief_over_time_is_that_of_all_mental_state_paths(seed: int, presses: tuple[int, ...]) -> None:
    trial = wandering_trial(seed, 7, presses)
    path = belief_path(trial, MODEL)
    prior = [1 / len(WORLD.tasks)] * len(WORLD.tasks)
    for t in range(trial.num_steps + 1):
        weights = np.array(joint(WORLD, MODEL, trial.states[:t], trial.presses[:t].tolist(), prior))
        np.testing.assert_allclose(path.marginal[t], weights / weights.sum(), atol=1e-12)


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6), presses=st.sets(st.integers(0, 6), min_size=1, max_size=3).map(tuple))
def test_reason_of_a_press_at_once_and_at_the_end_is_that_of_all_paths(
    seed: int, presses: tuple[int, ...]
) -> None:
    trial = wandering_trial(seed, 7, presses)
    for reason in press_reasons(trial, MODEL):
        for until, told in ((reason.step + 1, reason.at_once), (trial.num_steps, reason.at_end)):
            expected = dict.fromkeys(told, 0.0)
            for task in range(len(WORLD.tasks)):
                cues = cue_columns(WORLD, MODEL, trial.states[:until], task)
                for way, weight in paths(MODEL, cues, trial.presses[:until].tolist()).items():
                    expected[way[reason.step]] += weight
            total = sum(expected.values())
            assert told == pytest.approx({state: p / total for state, p in expected.items()}, abs=1e-12)


def test_replay_of_a_robots_own_trial_ends_where_the_robot_was_sure() -> None:
    world, model = menu()
    robot = Robot(world, model)
    trial = run_trial(robot, SimulatedTeacher(world, model, world.tasks[1]), np.random.default_rng(3))
    path = belief_path(trial, model)
    assert trial.reason == "final"
    np.testing.assert_array_equal(path.marginal[-1], robot.belief.marginal())
    assert path.highest[-1] > 0.98
    assert (path.highest[:-1] <= 0.98).any()
    assert isinstance(trial.displayed, str)
    assert path.fields == ()
    assert set(path.to_json()["marginals"]["task"]) == set(world.tasks)


def test_marginals_of_the_parts_of_a_task_add_up_and_json_holds_them_all() -> None:
    trial = wandering_trial(4, 12, (3, 8))
    path = belief_path(trial, MODEL)
    document = json.loads(json.dumps(path.to_json()))
    assert list(document["marginals"]) == ["mov", "wrt", "dist"]
    for field, columns in document["marginals"].items():
        np.testing.assert_allclose(np.sum(list(columns.values()), axis=0), 1.0)
        np.testing.assert_allclose(columns["1"], path.marginal_of(field)[1])
    assert document["entropy"][0] == pytest.approx(np.log(len(WORLD.tasks)))
    assert path.press_times.tolist() == [2.0, 4.5]


def test_a_situation_is_the_belief_and_the_world_before_its_step() -> None:
    trial = wandering_trial(4, 12, (3, 8))
    path = belief_path(trial, MODEL)
    for step, reached in enumerate((WORLD.start(), *trial.states[:-1])):
        belief, state = situation(trial, MODEL, step)
        np.testing.assert_array_equal(belief.marginal(), path.marginal[step])
        assert state == reached
    for step in (-1, 12):
        with pytest.raises(ValueError, match=f"wander-4 has 12 steps, from 0; there is no step {step}"):
            situation(trial, MODEL, step)
    with pytest.raises(ModelError, match="dt"):
        situation(trial, MODEL.with_dt(0.25), 3)


def test_the_task_card_and_the_labels_of_a_trial_change_no_belief() -> None:
    trial = wandering_trial(5, 10, (2, 7))
    other = replace(trial, task=None, steps=tuple(replace(s, mental_state="mistake") for s in trial.steps))
    np.testing.assert_array_equal(belief_path(trial, MODEL).marginal, belief_path(other, MODEL).marginal)
    for one, two in zip(press_reasons(trial, MODEL), press_reasons(other, MODEL), strict=True):
        assert one.at_end == pytest.approx(two.at_end, abs=1e-14)
        assert (one.noted, two.noted) == (None, "mistake")


def test_a_prior_is_where_the_belief_begins() -> None:
    prior = np.arange(1.0, len(WORLD.tasks) + 1)
    path = belief_path(wandering_trial(6, 3, ()), MODEL, prior / prior.sum())
    np.testing.assert_allclose(path.marginal[0], prior / prior.sum())


def test_a_model_with_another_step_is_refused() -> None:
    trial = wandering_trial(7, 3, (1,))
    for replay in (belief_path, press_reasons):
        with pytest.raises(
            ModelError, match=r"dt: the model is for steps of 0\.25 s, trial wander-7 has 0\.5 s"
        ):
            replay(trial, MODEL.with_dt(0.25))


def test_a_trial_without_steps_or_presses_has_a_replay() -> None:
    empty = Trial("empty", WORLD, None, ())
    assert belief_path(empty, MODEL).time.tolist() == [0.0]
    assert press_reasons(empty, MODEL) == ()
    assert press_reasons(wandering_trial(8, 4, ()), MODEL) == ()
