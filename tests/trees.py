"""Random situations, and the comparison of a planner with the whole tree in each of them."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from hypothesis import strategies as st
from oracles import full_tree
from strategies import models, walks, worlds

from taskcomm.belief import Belief
from taskcomm.decision import TIE, Decision
from taskcomm.planner import EntropyPlanner

EXACT = 1e-9  # nats
ROUNDING = 1e-12  # nats by which two ways to the same sum may differ


@st.composite
def situations(draw: st.DrawFn, max_balls: int = 3, max_steps: int = 8) -> tuple[Belief, object]:
    """A belief after a random walk with random presses, and the world state reached."""
    world = draw(worlds(max_balls=max_balls, max_distances=3))
    belief, walk = Belief.initial(world, draw(models())), draw(walks(world, max_steps))
    for _, state in walk:
        belief = belief.update(state, draw(st.booleans()))
    return belief, walk[-1][1]


def assert_equals_the_whole_tree(belief: Belief, state: object, horizon: int, gamma: float) -> None:
    """The planner decides as the oracle's tree does, by `assert_decides_as`."""
    oracle = full_tree(belief, state, horizon, gamma)
    assert_decides_as(oracle, EntropyPlanner(belief.world, belief.model, horizon, gamma=gamma), belief, state)


def assert_decides_as(
    oracle: Mapping[Any, float], planner: EntropyPlanner, belief: Belief, state: Any
) -> bool:
    """The planner's values, ties, action, bounds and gap are those of `oracle`, Q by action.

    With all values, with those it needs, and with more time than it needs before a deadline. Returns
    whether the action had to be one alone: not so only where a value lies within rounding of the
    border of the ties.
    """
    least = min(oracle.values())
    surely = [action for action, value in oracle.items() if value <= least + TIE - ROUNDING]
    maybe = [action for action, value in oracle.items() if value <= least + TIE + ROUNDING]
    clear = surely == maybe
    exact = planner.plan(belief, state, exact_values=True)
    assert list(exact.values) == list(oracle)
    quick, in_time = planner.plan(belief, state), planner.plan(belief, state, deadline=600.0)
    for decision in (exact, quick, in_time):
        assert decision.horizon == planner.horizon
        assert decision.value == pytest.approx(least, abs=EXACT)
        assert set(surely) <= set(decision.ties) <= set(maybe)
        assert decision.action == decision.ties[0]
        assert list(decision.ties) == [action for action in oracle if action in decision.ties]
        _assert_true(decision, oracle)
        if clear:
            assert decision.action == surely[0]
            true_gap = min((v for a, v in oracle.items() if a not in surely), default=np.inf) - least
            assert decision.gap <= true_gap + EXACT
            if decision is exact:
                assert decision.gap == pytest.approx(true_gap, abs=EXACT)
    return clear


def _assert_true(decision: Decision, oracle: Mapping[Any, float]) -> None:
    """What a decision says of every action holds; nobody else is as good as the ties."""
    assert set(decision.values) | set(decision.bounds) == set(oracle)
    for action, value in decision.values.items():
        assert value == pytest.approx(oracle[action], abs=EXACT)
    for action, bound in decision.bounds.items():
        assert action not in decision.ties
        assert decision.value < bound <= oracle[action] + EXACT
        assert decision.upper_bounds[action] >= oracle[action] - EXACT
