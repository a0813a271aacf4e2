"""Random situations, and the comparison of a planner with the whole tree in each of them."""

import numpy as np
import pytest
from hypothesis import strategies as st
from oracles import full_tree
from strategies import models, walks, worlds

from taskcomm.belief import Belief
from taskcomm.planner import TIE, EntropyPlanner


@st.composite
def situations(draw: st.DrawFn, max_balls: int = 3, max_steps: int = 8) -> tuple[Belief, object]:
    """A belief after a random walk with random presses, and the world state reached."""
    world = draw(worlds(max_balls=max_balls, max_distances=3))
    belief, walk = Belief.initial(world, draw(models())), draw(walks(world, max_steps))
    for _, state in walk:
        belief = belief.update(state, draw(st.booleans()))
    return belief, walk[-1][1]


def assert_equals_the_whole_tree(belief: Belief, state: object, horizon: int, gamma: float) -> None:
    oracle = full_tree(belief, state, horizon, gamma)
    planner = EntropyPlanner(belief.world, belief.model, horizon, gamma=gamma)
    exact = planner.plan(belief, state, exact_values=True)
    assert list(exact.values) == list(oracle)
    assert exact.values == pytest.approx(oracle, abs=1e-9)
    least = min(oracle.values())
    quick = planner.plan(belief, state)
    for decision in (exact, quick):
        assert decision.value == pytest.approx(least, abs=1e-9)
        assert oracle[decision.action] <= least + TIE + 1e-12
        assert all(oracle[tie] <= least + TIE + 1e-12 for tie in decision.ties)
        assert decision.ties[0] == decision.action
    surely_tied = [action for action, value in oracle.items() if value <= least + TIE / 2]
    assert set(surely_tied) <= set(quick.ties)
    assert quick.action == next(action for action in oracle if action in quick.ties)
    assert set(quick.values) | set(quick.bounds) == set(oracle)
    for action, value in quick.values.items():
        assert value == pytest.approx(oracle[action], abs=1e-9)
    for action, bound in quick.bounds.items():
        assert least < bound <= oracle[action] + 1e-9
        assert quick.upper_bounds[action] >= oracle[action] - 1e-9
    true_gap = min((v for a, v in oracle.items() if a not in quick.ties), default=np.inf) - least
    assert quick.gap <= true_gap + 1e-9
    assert exact.gap == pytest.approx(true_gap, abs=1e-9)
