"""The belief where resets go unseen, or more than the key is seen: exact, and pruned within its bound."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import observed_paths
from signalled import gazing, observation_models, signals_of, total_variation
from strategies import models, walks, worlds

from taskcomm.belief import Belief, ImpossibleObservation
from taskcomm.channels import NormalChannel, ObservationModel, PlainChannel
from taskcomm.smoother import smooth
from taskcomm.teacher import TableTop, TeacherModel
from taskcomm.trials import Step, Trial
from taskcomm.world import Action, BallWorld

INTUITIVE = TeacherModel.intuitive()
Seen = list[tuple[bool | None, Any]]


@st.composite
def observed_walks(draw: st.DrawFn, max_steps: int = 4) -> tuple[BallWorld, TeacherModel, Any, Seen]:
    world, model = draw(worlds(max_balls=2, max_distances=2)), draw(models(max_states=2))
    model = replace(model, observation=draw(observation_models(model)))
    walk = draw(walks(world, max_steps))
    keys = [draw(st.sampled_from([True, False, None])) for _ in walk]
    return world, model, walk, [(key, draw(signals_of(model.observation, world.num_balls))) for key in keys]


@settings(max_examples=60)
@given(observed_walks())
def test_the_filter_is_the_sum_over_all_mental_paths(case: tuple[BallWorld, TeacherModel, Any, Seen]) -> None:
    world, model, walk, seen = case
    belief = Belief.initial(world, model)
    for (_, state), (key, signals) in zip(walk, seen, strict=True):
        belief = belief.update(state, key, signals)
    states = [state for _, state in walk]
    joint = np.array(
        [sum(observed_paths(world, model, states, seen, task).values()) for task in range(len(world.tasks))]
    )
    assert belief.marginal() == pytest.approx(joint / joint.sum(), rel=1e-9)


@settings(max_examples=40)
@given(observed_walks(), st.data())
def test_what_a_belief_expects_is_what_its_paths_hold(
    case: tuple[BallWorld, TeacherModel, Any, Seen], data: st.DataObject
) -> None:
    """P(task, M_t, observation of the next step) against the paths that are one step longer."""
    world, model, walk, seen = case
    if len(walk) < 2:
        return
    belief = Belief.initial(world, model)
    for (_, state), (key, signals) in zip(walk[:-1], seen[:-1], strict=True):
        belief = belief.update(state, key, signals)
    states = [state for _, state in walk]
    expected = np.zeros((len(world.tasks), len(model.mental_states)))
    for task in range(len(world.tasks)):
        for path, weight in observed_paths(world, model, states, seen, task).items():
            expected[task, model.mental_states.index(path[-1])] += weight
    joint = belief.mental_joint(states[-1], *seen[-1])
    assert joint / joint.sum() == pytest.approx(expected / expected.sum(), rel=1e-9, abs=1e-12)
    press = belief.mental_joint(states[-1], True)
    assert belief.press_probability(states[-1]) == pytest.approx(press.sum(), rel=1e-12)
    assert belief.press_joint(states[-1]) == pytest.approx(press[:, 1:], rel=1e-12)


@settings(max_examples=30)
@given(observed_walks(max_steps=6))
def test_filter_and_smoother_agree_on_tasks_and_likelihood(
    case: tuple[BallWorld, TeacherModel, Any, Seen],
) -> None:
    """Levels as memory here, last resets as memory there; an unrecorded key begins no rest in either."""
    world, model, walk, seen = case
    belief, log_likelihood = Belief.initial(world, model), 0.0
    steps = []
    for (action, state), (key, signals) in zip(walk, seen, strict=True):
        log_likelihood += float(np.log(belief.mental_joint(state, key, signals).sum()))
        belief = belief.update(state, key, signals)
        steps.append(Step(action, key, signals=signals))
    smoothed = smooth(Trial("a", world, None, tuple(steps), model.dt), model)
    assert smoothed.log_likelihood == pytest.approx(log_likelihood, abs=1e-9)
    assert smoothed.task == pytest.approx(belief.marginal(), abs=1e-9)


def _walk(world: BallWorld, steps: int, rng: np.random.Generator) -> list[Any]:
    state, states = world.start(), []
    for _ in range(steps):
        actions = world.actions(state)
        state = world.step(state, actions[rng.integers(len(actions))])
        states.append(state)
    return states


def _lit_walk(world: BallWorld, steps: int, rng: np.random.Generator) -> list[Any]:
    """Every ball is lit and one held, then lights go on and off: levels of every kind."""
    state, states = world.start(), []
    for step in range(steps):
        actions = [a for a in world.actions(state) if a.name not in ("release", "slide")]
        early = [a for a in actions if a.name in ("light_on", "pick_up")]
        choice = early if step < world.num_balls + 1 else actions
        state = world.step(state, choice[rng.integers(len(choice))])
        states.append(state)
    return states


def test_a_key_that_was_not_recorded_is_the_mixture_of_a_press_and_none() -> None:
    world = BallWorld()
    state = world.step(world.start(), Action.parse("light_on(1)"))
    belief = Belief.initial(world, INTUITIVE).update(state, False)
    p = belief.press_probability(state)
    mixed = p * belief.update(state, True).marginal() + (1 - p) * belief.update(state, False).marginal()
    assert belief.update(state, None).marginal() == pytest.approx(mixed, rel=1e-12)
    assert belief.update(state, None).marginal() == pytest.approx(belief.marginal(), rel=1e-12)


def test_signals_of_channels_that_the_model_lacks_change_nothing() -> None:
    world = BallWorld()
    belief = Belief.initial(world, INTUITIVE)
    for key in (True, False, None):
        with_it = belief.update(world.start(), key, {"gaze": "1", "weather": 3.5})
        assert (with_it.weight == belief.update(world.start(), key).weight).all()


def test_a_look_at_a_ball_moves_the_belief_as_bayes_says() -> None:
    """gaze alone: P(1 | mov = 1) : P(1 | wrt = 1) : P(1 | other = 1), all while waiting."""
    world, model = BallWorld(3, 1), gazing()
    belief = Belief.initial(world, model).update(world.start(), None, {"gaze": "1"})
    expected = np.array([{1: 0.2}.get(t.mov, 0.15) for t in world.tasks])
    assert belief.marginal() == pytest.approx(expected / expected.sum(), rel=1e-9)


def test_numbers_far_from_every_mean_are_weighed_all_the_same() -> None:
    """Densities of 1e-400 are no floats; their ratios are."""
    loud = {state: 1.0 if state == "waiting" else 2.0 for state in INTUITIVE.mental_states}
    sd = dict.fromkeys(INTUITIVE.mental_states, 1.0)
    model = replace(INTUITIVE, observation=ObservationModel(channels={"loudness": NormalChannel(loud, sd)}))
    world = BallWorld()
    state = world.step(world.start(), Action.parse("light_on(1)"))
    far = Belief.initial(world, model).update(state, None, {"loudness": 60.0})
    pressed = Belief.initial(world, INTUITIVE).update(state, True)
    assert far.marginal() == pytest.approx(pressed.marginal(), rel=1e-9)


def test_an_impossible_signal_is_an_error_that_names_it() -> None:
    never = PlainChannel({state: {"smile": 1.0, "frown": 0.0} for state in INTUITIVE.mental_states})
    model = replace(INTUITIVE, observation=ObservationModel(channels={"face": never}))
    with pytest.raises(ImpossibleObservation, match=r"^pressed=True with \{'face': 'frown'\} has prob"):
        Belief.initial(BallWorld(), model).update(BallWorld().start(), True, {"face": "frown"})


# Pruning

SLOW = replace(  # levels that no two resets leave alike
    gazing(miss=0.2, false_press=0.01),
    approvals={
        "that_mov": TableTop("mov_lit", 0.12, 3.1, 4.3),
        "that_wrt": TableTop("wrt_lit", 0.1, 2.7, 3.7),
        "that_dist": TableTop("mov_held", 0.1, 2.3, 2.9),
    },
)


@pytest.mark.parametrize("prune", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_what_pruning_drops_is_bounded_by_dropped(prune: float, seed: int) -> None:
    """Total variation of the belief over tasks and memories, and so over tasks, at every step."""
    world, rng = BallWorld(3, 1), np.random.default_rng(seed)
    exact, pruned = Belief.initial(world, SLOW), Belief.initial(world, SLOW, prune=prune)
    rows = [0, 0]
    for state in _lit_walk(world, 20, rng):
        p = exact.press_probability(state)
        key = None if rng.random() < 0.2 else bool(rng.random() < p)
        gaze = {"gaze": str(rng.choice(["1", "2", "3", "none"]))} if rng.random() < 0.8 else None
        exact, pruned = exact.update(state, key, gaze), pruned.update(state, key, gaze)
        assert _variation(exact, pruned) <= pruned.dropped + 1e-12
        assert total_variation(exact.marginal(), pruned.marginal()) <= pruned.dropped + 1e-12
        assert pruned.dropped < 1e4 * prune
        rows = [rows[0] + len(exact.weight), rows[1] + len(pruned.weight)]
    assert rows[1] < rows[0]
    assert exact.dropped == 0


def _variation(exact: Belief, other: Belief) -> float:
    def rows(belief: Belief) -> dict[Any, float]:
        keys = zip(belief.task.tolist(), belief.level.tolist(), strict=True)
        weights = belief.weight.tolist()
        return {(task, tuple(level)): w for (task, level), w in zip(keys, weights, strict=True)}

    ours, theirs = rows(exact), rows(other)
    assert set(theirs) <= set(ours)
    return sum(abs(weight - theirs.get(row, 0.0)) for row, weight in ours.items()) / 2


def test_a_belief_that_loses_nothing_prunes_nothing() -> None:
    world = BallWorld()
    belief = Belief.initial(world, INTUITIVE, prune=1e-9)
    for state in _walk(world, 6, np.random.default_rng(0)):
        belief = belief.update(state, False)
    assert belief.dropped == 0


def test_rows_stay_few_over_a_long_trial_with_a_key_that_misses() -> None:
    world, rng = BallWorld(), np.random.default_rng(4)
    belief = Belief.initial(world, SLOW, prune=1e-9)
    most = 0
    for state in _lit_walk(world, 60, rng):
        belief = belief.update(state, bool(rng.random() < belief.press_probability(state)))
        most = max(most, len(belief.weight))
    assert most < 4000
    assert belief.dropped < 1e-3


@pytest.mark.parametrize("prune", [-1e-9, 1.0, float("nan")])
def test_a_share_to_prune_that_cannot_be_is_named(prune: float) -> None:
    with pytest.raises(ValueError, match=r"^prune: must be at least 0 and below 1, not"):
        Belief.initial(BallWorld(), INTUITIVE, prune=prune)
