"""The tree over key and signals: the whole tree's values, and the laws that tie it to the key's own tree."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import branching_tree
from signalled import gazing, observation_models, signals_of
from strategies import models, walks
from trees import EXACT, assert_decides_as

from taskcomm.belief import Belief, entropy
from taskcomm.branching import BranchingTree
from taskcomm.channels import NormalChannel, ObservationModel, PlainChannel, TargetChannel
from taskcomm.observation import Observer
from taskcomm.planner import EntropyPlanner, UnplannedChannel
from taskcomm.robot import Robot
from taskcomm.teacher import TeacherModel
from taskcomm.world import Action, BallWorld

INTUITIVE = TeacherModel.intuitive()


@st.composite
def signalled_situations(draw: st.DrawFn, max_steps: int = 5) -> tuple[Belief, Any]:
    """A belief after a random walk with random keys and signals, and the world state reached."""
    world, model = BallWorld(2, draw(st.integers(1, 2))), draw(models(max_states=2))
    model = replace(model, observation=draw(observation_models(model, numbers=False)))
    belief, walk = Belief.initial(world, model), draw(walks(world, max_steps))
    for _, state in walk:
        signals = draw(signals_of(model.observation, 2))
        belief = belief.update(state, draw(st.sampled_from([True, False, None])), signals)
    return belief, walk[-1][1]


@settings(max_examples=8)
@given(signalled_situations(), st.sampled_from([1.0, 0.9]))
def test_the_planner_decides_as_the_whole_tree_over_key_and_signals(
    situation: tuple[Belief, Any], gamma: float
) -> None:
    belief, state = situation
    oracle = branching_tree(belief, state, 2, gamma)
    assert_decides_as(oracle, EntropyPlanner(belief.world, belief.model, 2, gamma=gamma), belief, state)


@pytest.mark.verify
@settings(max_examples=4)
@given(signalled_situations(max_steps=3), st.sampled_from([1.0, 0.9]))
def test_three_steps_ahead_too(situation: tuple[Belief, Any], gamma: float) -> None:
    belief, state = situation
    oracle = branching_tree(belief, state, 3, gamma)
    assert_decides_as(oracle, EntropyPlanner(belief.world, belief.model, 3, gamma=gamma), belief, state)


@pytest.mark.verify
def test_a_model_whose_key_errs_and_whose_teacher_gazes_is_planned_three_steps_ahead() -> None:
    world, model = BallWorld(2, 1), gazing(miss=0.1, false_press=0.02)
    belief, state = Belief.initial(world, model), world.start()
    for text, key, gaze in (("light_on(1)", True, "1"), ("pick_up(1)", False, "2")):
        state = world.step(state, Action.parse(text))
        belief = belief.update(state, key, {"gaze": gaze})
    assert_decides_as(branching_tree(belief, state, 3), EntropyPlanner(world, model, 3), belief, state)


def _values(world: BallWorld, model: TeacherModel, horizon: int, steps: Any = ()) -> dict[Any, float]:
    """Q of every action after these (action, key) from the start; no signals seen."""
    belief, state = Belief.initial(world, model), world.start()
    for text, key in steps:
        state = world.step(state, Action.parse(text))
        belief = belief.update(state, key)
    return EntropyPlanner(world, model, horizon).plan(belief, state, exact_values=True).values


STEPS = [("light_on(1)", False), ("pick_up(1)", True), ("light_on(2)", False)]


@pytest.mark.parametrize("steps", [STEPS[:n] for n in range(4)])
def test_a_channel_that_says_nothing_changes_no_value(steps: Any) -> None:
    """Equal under every mental state and role: the tree of the key alone, by the compiled search."""
    silent = PlainChannel({state: {"smile": 0.3, "frown": 0.7} for state in INTUITIVE.mental_states})
    row = {"mov": 0.2, "wrt": 0.2, "other": 0.2, "none": 0.4}
    idle = TargetChannel(dict.fromkeys(INTUITIVE.mental_states, row))  # three balls, alike
    model = replace(INTUITIVE, observation=ObservationModel(channels={"face": silent, "gaze": idle}))
    ours, theirs = (_values(BallWorld(), m, 3, steps) for m in (model, INTUITIVE))
    assert list(ours) == list(theirs)
    assert list(ours.values()) == pytest.approx(list(theirs.values()), abs=EXACT)


def test_the_tree_of_an_exact_key_is_that_of_the_compiled_search() -> None:
    """The default world and model, at the start, against the reference values of the model's text too."""
    world = BallWorld()
    found = BranchingTree(world, INTUITIVE).search(Belief.initial(world, INTUITIVE), world.start(), 4, 1.0)
    assert found is not None
    assert found.bound[[0, 1, 4]] == pytest.approx([12.651607215, 12.583003867, 12.647778610], abs=1e-8)
    assert found.bound == pytest.approx(list(_values(world, INTUITIVE, 4).values()), abs=EXACT)


@pytest.mark.parametrize("steps", [STEPS[:n] for n in range(4)])
def test_seeing_more_never_costs_and_a_worse_key_never_helps(steps: Any) -> None:
    """Q of every action: with a gaze at most without; with a key that misses at least with one that does not.

    The beliefs before are the same only at the start; a missing key is compared there alone.
    """
    world = BallWorld(3, 1)
    without, with_gaze = (_values(world, m, 2, steps) for m in (INTUITIVE, gazing()))
    if not steps:
        assert all(with_gaze[action] < without[action] - 1e-4 for action in without)
        deaf = replace(INTUITIVE, observation=ObservationModel(miss=0.4, false_press=0.01))
        erring = _values(world, deaf, 2)
        assert all(erring[action] >= without[action] - EXACT for action in without)
        assert sum(erring.values()) > sum(without.values()) + 1e-3
    assert all(with_gaze[action] <= without[action] + EXACT for action in without)


@settings(max_examples=25)
@given(signalled_situations())
def test_no_step_tells_more_than_the_capacity(situation: tuple[Belief, Any]) -> None:
    belief, state = situation
    tree = BranchingTree(belief.world, belief.model)
    found = tree.search(belief, state, 1, 1.0)
    assert found is not None
    assert (entropy(belief.marginal()) - found.bound <= tree.capacity + 1e-12).all()
    assert (found.bound <= entropy(belief.marginal()) + 1e-12).all()


def test_a_deadline_gives_a_shorter_look_whose_certificate_holds() -> None:
    world, model = BallWorld(2, 1), gazing()
    belief, state = Belief.initial(world, model), world.start()
    planner = EntropyPlanner(world, model, 3)
    exact = planner.plan(belief, state).values
    hasty = planner.plan(belief, state, deadline=1e-9)
    assert hasty.horizon == 1
    certificate = hasty.certificate
    assert certificate is not None
    for action, value in exact.items():
        assert certificate.lower[action] - EXACT <= value <= certificate.upper[action] + EXACT
    regret = exact[hasty.action] - min(exact.values())
    assert regret <= certificate.regret + EXACT
    patient = planner.plan(belief, state, deadline=600.0)
    assert (patient.horizon, patient.values) == (3, exact)


def test_a_rest_tells_presses_from_other_outcomes_that_say_the_same() -> None:
    """A key that fires as often under every mental state says nothing, but begins a rest."""
    world = BallWorld(2, 1)
    seen = ObservationModel(0.7, 0.3)
    restless = replace(INTUITIVE, observation=seen, mistake=0.01)
    resting = replace(restless, rest=2.0)
    for model in (restless, resting):
        belief, state = Belief.initial(world, model), world.step(world.start(), Action.parse("light_on(1)"))
        belief = belief.update(state, False)
        oracle = branching_tree(belief, state, 2)
        assert_decides_as(oracle, EntropyPlanner(world, model, 2), belief, state)


def test_continuous_channels_are_left_aside_and_that_is_said() -> None:
    states = INTUITIVE.mental_states
    loud = NormalChannel({s: float(at) for at, s in enumerate(states)}, dict.fromkeys(states, 1.0))
    model = replace(INTUITIVE, observation=ObservationModel(channels={"loudness": loud}))
    world = BallWorld(3, 1)
    with pytest.warns(UnplannedChannel, match="planning leaves aside loudness: continuous"):
        planner = EntropyPlanner(world, model, 2)
    values = planner.plan(Belief.initial(world, model), world.start(), exact_values=True).values
    assert values == pytest.approx(_values(world, INTUITIVE, 2), abs=EXACT)


def test_a_planner_without_signals_looks_ahead_over_the_key_alone() -> None:
    """Under a belief that knows the looks: the values of the key's own tree from that belief."""
    world = BallWorld(2, 1)
    for model in (gazing(), gazing(miss=0.2, false_press=0.01)):
        key_alone = replace(model, observation=replace(model.observation, channels={}))
        belief, state = Belief.initial(world, model), world.step(world.start(), Action.parse("light_on(1)"))
        belief = belief.update(state, False, {"gaze": "1"})
        bare = replace(belief, model=key_alone, observer=Observer(world, key_alone))
        planner = EntropyPlanner(world, model, 2, signals=False)
        assert_decides_as(branching_tree(bare, state, 2), planner, belief, state)
        if model.observation.miss == 0:
            assert planner.horizon == 2
            assert EntropyPlanner(world, model, signals=False).horizon == 5
            assert planner.plan(belief, state).explain().root.action == planner.plan(belief, state).action


def test_a_planner_and_a_robot_look_less_far_where_more_is_observed() -> None:
    world = BallWorld(2, 1)
    erring = replace(INTUITIVE, observation=ObservationModel(miss=0.1))
    for model, horizon in ((INTUITIVE, 5), (erring, 4), (gazing(), 3), (gazing(miss=0.1), 3)):
        assert EntropyPlanner(world, model).horizon == horizon
        assert Robot(world, model).description["planner"]["horizon"] == horizon


def test_a_plan_over_signals_is_not_explained_as_one_over_a_key() -> None:
    world, model = BallWorld(2, 1), gazing()
    decision = EntropyPlanner(world, model, 1).plan(Belief.initial(world, model), world.start())
    with pytest.raises(ValueError, match="explanations are of plans over an exact key"):
        decision.explain()


def test_warming_up_leaves_random_ties_as_they_were() -> None:
    world, model = BallWorld(2, 1), gazing()
    belief, state = Belief.initial(world, model), world.start()
    cold, warm = (EntropyPlanner(world, model, 1, ties="random", seed=1) for _ in range(2))
    warm.warm_up()
    chosen = [[planner.plan(belief, state).action for _ in range(8)] for planner in (cold, warm)]
    assert chosen[0] == chosen[1]
    assert np.unique([str(action) for action in chosen[0]]).size > 1


def test_beliefs_searched_a_few_at_a_time_have_the_same_values(monkeypatch: pytest.MonkeyPatch) -> None:
    world, model = BallWorld(2, 1), gazing()
    belief, state = Belief.initial(world, model), world.start()
    whole = BranchingTree(world, model).search(belief, state, 3, 1.0)
    monkeypatch.setattr("taskcomm.branching.MOST_WEIGHTS", 100)
    parts = BranchingTree(world, model).search(belief, state, 3, 1.0)
    assert whole is not None
    assert parts is not None
    assert parts.bound == pytest.approx(whole.bound, abs=1e-12)
    assert parts.nodes == whole.nodes
