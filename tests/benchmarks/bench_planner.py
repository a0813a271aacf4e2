"""How much faster the search is than the whole tree of the oracle, as a ratio in one run."""

import time
from collections.abc import Callable
from typing import Any

import pytest
from oracles import full_tree

from taskcomm.belief import Belief
from taskcomm.planner import EntropyPlanner
from taskcomm.teacher import TeacherModel
from taskcomm.world import Action, BallWorld


def midway() -> tuple[Belief, Any]:
    """A belief after one approval, a ball held and another lit."""
    world, model = BallWorld(), TeacherModel.intuitive()
    belief, state = Belief.initial(world, model), world.start()
    for text in ("light_on(1)", "noa", "noa", "pick_up(1)", "light_on(2)"):
        state = world.step(state, Action.parse(text))
        belief = belief.update(state, text == "pick_up(1)")
    return belief, state


def seconds(call: Callable[[], Any]) -> float:
    started = time.process_time()
    call()
    return time.process_time() - started


@pytest.mark.parametrize("horizon", [1, 2, 3])
def bench_search_against_whole_tree(benchmark: Any, horizon: int) -> None:
    belief, state = midway()
    planner = EntropyPlanner(belief.world, belief.model, horizon)
    planner.plan(belief, state)
    benchmark(planner.plan, belief, state)
    fast = min(seconds(lambda: planner.plan(belief, state)) for _ in range(20))
    slow = min(seconds(lambda: full_tree(belief, state, horizon)) for _ in range(3))
    benchmark.extra_info["whole_tree_over_search"] = round(slow / fast, 1)
    print(f"\nhorizon {horizon}: whole tree / search = {slow / fast:.0f} (time)")
    assert slow > fast


@pytest.mark.parametrize("horizon", [3, 4, 5])
def bench_bounds_against_exact_values_of_all_actions(benchmark: Any, horizon: int) -> None:
    belief, state = midway()
    planner = EntropyPlanner(belief.world, belief.model, horizon)
    every = planner.plan(belief, state, exact_values=True)
    decision = benchmark(planner.plan, belief, state)
    benchmark.extra_info["nodes_over_nodes"] = round(every.nodes / decision.nodes, 2)
    print(
        f"\nhorizon {horizon}: all actions exact / the best only = {every.nodes / decision.nodes:.1f} (nodes)"
    )
    assert decision.nodes <= every.nodes
