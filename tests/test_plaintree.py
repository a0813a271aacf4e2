"""The plain compiled tree equals the oracle's whole tree, and the search equals it at three steps."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from oracles import full_tree
from plaintree import PlainTree
from trees import situations

from taskcomm.belief import Belief
from taskcomm.planner import EntropyPlanner
from taskcomm.teacher import TeacherModel
from taskcomm.world import Action, BallState, BallWorld


@given(situations(), st.integers(1, 2), st.sampled_from([1.0, 0.9, 0.3]))
def test_equals_the_oracle_on_any_world_and_model(
    situation: tuple[Belief, object], horizon: int, gamma: float
) -> None:
    belief, state = situation
    found = PlainTree(belief.world, belief.model, horizon, gamma).values(belief, state)
    oracle = full_tree(belief, state, horizon, gamma)
    assert list(found) == list(oracle)
    assert found == pytest.approx(oracle, abs=1e-10)


@given(situations(max_balls=2, max_steps=5))
def test_equals_the_oracle_three_steps_deep(situation: tuple[Belief, object]) -> None:
    belief, state = situation
    found = PlainTree(belief.world, belief.model, 3).values(belief, state)
    assert found == pytest.approx(full_tree(belief, state, 3), abs=1e-10)


@given(situations(), st.sampled_from([1.0, 0.8]))
def test_the_search_equals_it_three_steps_deep_on_any_world_and_model(
    situation: tuple[Belief, object], gamma: float
) -> None:
    belief, state = situation
    values = PlainTree(belief.world, belief.model, 3, gamma).values(belief, state)
    planner = EntropyPlanner(belief.world, belief.model, 3, gamma=gamma)
    assert planner.plan(belief, state, exact_values=True).values == pytest.approx(values, abs=1e-9)
    assert planner.plan(belief, state).value == pytest.approx(min(values.values()), abs=1e-9)


def test_first_decision_has_the_reference_values_and_every_belief_is_visited() -> None:
    world, model = BallWorld(), TeacherModel.intuitive()
    tree = PlainTree(world, model, 4)
    values = tree.values(Belief.initial(world, model), world.start())
    for text, value in {"noa": 12.651607, "light_on(2)": 12.583004, "pick_up(3)": 12.647779}.items():
        assert values[Action.parse(text)] == pytest.approx(value, abs=1e-6)

    def beliefs(state: BallState, steps: int) -> int:
        after = [world.step(state, action) for action in world.actions(state)] if steps > 1 else []
        return 1 + sum(2 * beliefs(reached, steps - 1) for reached in after)

    assert tree.nodes == beliefs(world.start(), 4)
