"""Long checks of the planner: deeper trees, and the time of every decision of the study."""

import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import models
from trees import assert_equals_the_whole_tree, situations

from learn import fit
from taskcomm.belief import Belief
from taskcomm.logs import read_trials
from taskcomm.planner import EntropyPlanner
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial
from taskcomm.world import BallWorld

pytestmark = pytest.mark.verify
STUDY = Path(__file__).parents[2] / "datasets" / "simulated-study"
STEP = 0.5


@settings(max_examples=300)
@given(situations(max_steps=12), st.sampled_from([1.0, 0.7]))
def test_equals_the_whole_tree_on_any_world_three_steps_deep(
    situation: tuple[Belief, object], gamma: float
) -> None:
    assert_equals_the_whole_tree(*situation, 3, gamma)


@settings(max_examples=30)
@given(situations(max_balls=2, max_steps=8))
def test_equals_the_whole_tree_four_steps_deep(situation: tuple[Belief, object]) -> None:
    assert_equals_the_whole_tree(*situation, 4, 1.0)


@settings(max_examples=5)
@given(models(max_states=2), st.integers(0, 2**32 - 1))
def test_equals_the_whole_tree_five_steps_deep(model: TeacherModel, seed: int) -> None:
    world, rng = BallWorld(2, 1), np.random.default_rng(seed)
    belief, state = Belief.initial(world, model), world.start()
    for _ in range(6):
        actions = world.actions(state)
        state = world.step(state, actions[int(rng.integers(len(actions)))])
        belief = belief.update(state, bool(rng.random() < 0.4))
    assert_equals_the_whole_tree(belief, state, 5, 1.0)


def decision_seconds(planner: EntropyPlanner, trial: Trial) -> list[float]:
    """Wall time of the decision before each step of a logged trial, under the planner's model."""
    belief, state, times = Belief.initial(trial.world, planner.model), trial.world.start(), []
    for reached, step in zip(trial.states, trial.steps, strict=True):
        started = time.perf_counter()
        planner.plan(belief, state)
        times.append(time.perf_counter() - started)
        belief, state = belief.update(reached, step.pressed), reached
    return times


def test_every_decision_of_the_study_is_made_within_the_step() -> None:
    trials = read_trials(STUDY / "trials.jsonl")
    assert len(trials) == 44
    learned = fit(trials, world=trials[0].world, initial=TeacherModel.intuitive()).model
    for name, model in (("intuitive", TeacherModel.intuitive()), ("learned", learned)):
        planner = EntropyPlanner(trials[0].world, model, horizon=5)
        planner.warm_up()
        times = np.concatenate([decision_seconds(planner, trial) for trial in trials])
        print(
            f"{name}: {len(times)} decisions, share of the step used:"
            f" median {np.median(times) / STEP:.3f}, p99 {np.quantile(times, 0.99) / STEP:.3f},"
            f" max {times.max() / STEP:.3f}"
        )
        assert times.max() < STEP
