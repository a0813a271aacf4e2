"""The world graph equals the enumeration of all paths, whatever was dropped before, in bounded memory."""

import gc
import tracemalloc
from collections.abc import Hashable, Iterator
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from gridworld import Plane
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from strategies import models, walks, worlds
from tinyworld import menu

from taskcomm.belief import Belief
from taskcomm.planner import EntropyPlanner
from taskcomm.teacher import TableTop, TeacherModel
from taskcomm.world import BallWorld, World
from taskcomm.worldgraph import WorldGraph


def graph_of(world: World, model: TeacherModel, horizon: int, **bounded: int) -> WorldGraph:
    p = model.parameters(world.cue_names)
    return WorldGraph(world, p.cue, p.peak * p.dt / p.rise, horizon, **bounded)


def plane(seed: int = 0, num_cues: int = 3, num_tasks: int = 4) -> tuple[Plane, TeacherModel]:
    """The plane, and a teacher who approves of every cue of it, of some more than of others."""
    world = Plane(num_tasks, num_cues, seed)
    tops = {name: TableTop(name, 0.05, 1.0 + row, 2.0) for row, name in enumerate(world.cue_names)}
    return world, TeacherModel(mistake=0.01, approvals=tops)


def paths(world: World, state: Any, steps: int) -> Iterator[list[Any]]:
    """The states of every path of `steps` steps, without the one it begins in."""
    if steps == 0:
        yield []
        return
    for action in world.actions(state):
        reached = world.step(state, action)
        for path in paths(world, reached, steps - 1):
            yield [reached, *path]


def outlook(graph: WorldGraph, state: Hashable, steps: int) -> tuple[NDArray[Any], ...]:
    """`reach`, `climb` and `run` by their definitions."""
    tasks = len(graph.world.tasks)
    reach, climb, differ = np.zeros(tasks, np.int64), np.full(tasks, -np.inf), np.zeros(tasks, np.int64)
    for path in paths(graph.world, state, steps):
        shown = [np.asarray(graph.world.cues(at))[graph.cue] for at in path]
        collected = np.zeros(tasks)
        for on in shown:
            for m in range(len(graph.cue)):
                reach |= on[m].astype(np.int64) << m
                collected += graph.worth[m] * on[m]
            differ[1:] |= (on[:, 1:] != on[:, :-1]).any(axis=0)
        climb = np.maximum(climb, collected)
    return reach, climb, np.cumsum(differ)


def assert_complete(graph: WorldGraph, state: Any, depth: int) -> None:
    """All that lies within `depth` steps of `state` is in the graph, as its definitions have it."""
    world, near = graph.world, {state: graph.node(state)}
    for left in range(depth, -1, -1):
        layer, near = near, {}
        for at, node in layer.items():
            assert graph.states[node] == at
            on = np.asarray(world.cues(at))[graph.cue]
            assert (graph.pattern[node] == (on << np.arange(len(on))[:, None]).sum(axis=0)).all()
            if left == 0:
                continue
            first, count = graph.first[node], graph.count[node]
            successors = [world.step(at, action) for action in world.actions(at)]
            assert [graph.states[n] for n in graph.successor[first : first + count]] == successors
            assert_compared(graph, slice(first, first + count))
            assert graph.depth[node] >= left
            for steps in range(1, left + 1):
                row = graph.slot[node, steps]
                reach, climb, run = outlook(graph, at, steps)
                assert (graph.reach[row] == reach).all()
                assert graph.climb[row] == pytest.approx(climb, abs=1e-12)
                assert (graph.run[row] == run).all()
            near |= {state: graph.node(state) for state in successors}
    assert_tidy(graph)


def assert_compared(graph: WorldGraph, links: slice) -> None:
    """`changed` says which tasks are shown something else than by the first action."""
    shown = graph.pattern[graph.successor[links]]
    for t in range(len(graph.world.tasks)):
        bits = graph.changed[links, t // 64] >> np.uint64(t % 64) & np.uint64(1)
        assert (bits == (shown[:, t] != shown[0, t])).all()
    of_tasks = graph.changed[links].astype("<u8").view(np.uint8)
    assert not np.unpackbits(of_tasks, axis=1, bitorder="little")[:, len(graph.world.tasks) :].any()


def assert_tidy(graph: WorldGraph) -> None:
    """Every row belongs to one node and one number of steps, and row 0 to none."""
    steps = np.arange(1, graph.horizon + 1)
    assert ((graph.slot[:, 1:] > 0) == (steps <= graph.depth[:, None])).all()
    assert not graph.slot[:, 0].any()
    taken = graph.slot[graph.slot > 0]
    assert len(np.unique(taken)) == len(taken)
    expanded = np.flatnonzero(graph.count)
    assert len(np.unique(graph.first[expanded])) == len(expanded)
    for pool in (graph.reach, graph.climb, graph.run):
        assert not pool[0].any()


@given(st.data(), worlds(max_balls=2, max_distances=2), models(), st.integers(1, 3))
def test_outlooks_equal_the_enumeration_of_paths(
    data: st.DataObject, world: BallWorld, model: TeacherModel, depth: int
) -> None:
    graph = graph_of(world, model, depth)
    for _, state in data.draw(walks(world, 3)):
        assert graph.grow(state, depth) is not None
    assert_complete(graph, state, depth)


@pytest.mark.parametrize("num_cues", [1, 3])
def test_outlooks_equal_the_enumeration_in_a_world_without_balls(num_cues: int) -> None:
    world, model = menu(num_cues)
    graph = graph_of(world, model, 4)
    graph.grow(world.start(), 4)
    assert_complete(graph, world.start(), 4)


@pytest.mark.parametrize("num_tasks", [64, 65, 150])
def test_more_tasks_than_a_word_has_bits_are_compared_in_several(num_tasks: int) -> None:
    world, model = plane(num_tasks=num_tasks)
    graph = graph_of(world, model, 2)
    graph.grow(world.start(), 2)
    assert graph.changed.shape[1] == -(-num_tasks // 64)
    assert_complete(graph, world.start(), 2)


@given(st.data(), st.integers(0, 99), st.sampled_from([1, 3, 8, 9, 16]), st.integers(1, 5))
def test_whatever_was_dropped_or_broken_off_before_what_is_grown_is_complete(
    data: st.DataObject, seed: int, num_cues: int, num_tasks: int
) -> None:
    """In any order of asking, with a memory that holds little more than one neighbourhood."""
    world, model = plane(seed, num_cues, num_tasks)
    graph, state = graph_of(world, model, 3, memory=60_000), world.start()
    for _ in range(data.draw(st.integers(1, 8))):
        for move in data.draw(st.lists(st.integers(0, 4), max_size=4)):
            actions = world.actions(state)
            state = world.step(state, actions[move % len(actions)])
        depth, looks = data.draw(st.integers(1, 3)), data.draw(st.integers(0, 40))
        ticks = iter(range(10**9))
        with patch("taskcomm.worldgraph.time", SimpleNamespace(perf_counter=lambda t=ticks: next(t))):
            root = graph.grow(state, depth, until=looks)
        if root is not None:
            assert graph.states[root] == state
            assert_complete(graph, state, depth)
    assert graph.grow(state, 3) is not None
    assert_complete(graph, state, 3)


@pytest.mark.parametrize("memory", range(40_000, 80_000, 3_000))
def test_wherever_in_growing_the_memory_is_full_what_is_grown_is_complete(memory: int) -> None:
    world, model = plane(num_tasks=2)
    graph, state = graph_of(world, model, 3, memory=memory), world.start()
    for step in range(25):
        assert graph.grow(state, 3) is not None
        assert_complete(graph, state, 3)
        for _ in range(1 + step % 3):
            state = world.step(state, world.actions(state)[1 if step % 4 else -1])


def march(graph: WorldGraph, steps: int, depth: int) -> tuple[Any, set[Hashable]]:
    """Grow the graph along a walk away from the start of the plane; where it ends, and all states seen."""
    state, seen = graph.world.start(), set()
    for step in range(steps):
        assert graph.grow(state, depth) is not None
        seen.update(graph.states)
        state = graph.world.step(state, graph.world.actions(state)[1 if step % 3 else -1])
    graph.grow(state, depth)
    return state, seen


def test_a_walk_without_end_stays_in_its_memory() -> None:
    """Measured, Python's own objects included."""
    world, model = plane(num_tasks=40)
    march(graph_of(world, model, 4), 1, 1)  # what is loaded once
    memory = 300_000
    tracemalloc.start()
    try:
        graph = graph_of(world, model, 4, memory=memory)
        state = world.start()
        for step in range(300):
            assert graph.grow(state, 4) is not None
            state = world.step(state, world.actions(state)[1 if step % 3 else -1])
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < memory
    assert graph.grow(state, 4) is not None
    assert_complete(graph, state, 4)
    _, seen = march(graph_of(world, model, 4, memory=memory), 300, 4)
    assert len(seen) > 5 * len(graph.states)


def test_a_memory_too_small_is_one_clear_error_and_with_a_deadline_a_shorter_horizon() -> None:
    world, model = BallWorld(3, 2), TeacherModel.intuitive()
    belief, state, memory = Belief.initial(world, model), world.start(), 100_000
    small = EntropyPlanner(world, model, 5, memory=memory)
    with pytest.raises(MemoryError, match=r"within 5 steps of BallState\(.*100000 bytes.*shorter horizon"):
        small.plan(belief, state)
    decision = small.plan(belief, state, deadline=60.0)
    assert 1 <= decision.horizon < 5
    whole = EntropyPlanner(world, model, decision.horizon).plan(belief, state)
    assert (decision.action, decision.values) == (whole.action, whole.values)
    for hardly_any in (1, 64, 2000):
        with pytest.raises(MemoryError, match="within 1 steps"):
            EntropyPlanner(world, model, 5, memory=hardly_any).plan(belief, state, deadline=1.0)
    with pytest.raises(ValueError, match="memory"):
        EntropyPlanner(world, model, 5, memory=0)


def test_a_trial_with_little_memory_has_the_decisions_of_one_with_much() -> None:
    world, model, rng = BallWorld(3, 2), TeacherModel.intuitive(), np.random.default_rng(5)
    much = EntropyPlanner(world, model, 3)
    little = EntropyPlanner(world, model, 3, memory=180_000)
    belief, state = Belief.initial(world, model), world.start()
    for _ in range(60):
        decision = little.plan(belief, state)
        assert decision == much.plan(belief, state)
        action = world.actions(state)[int(rng.integers(len(world.actions(state))))]
        state = world.step(state, decision.action if rng.random() < 0.6 else action)
        belief = belief.update(state, bool(rng.random() < belief.press_probability(state)))
    assert len(much._graph.states) > 2 * len(little._graph.states)


def test_the_garbage_collector_waits_while_the_graph_grows_and_no_longer() -> None:
    collects: list[bool] = []

    class Watched(Plane):
        def step(self, state: tuple[int, int], action: tuple[int, int]) -> tuple[int, int]:
            collects.append(gc.isenabled())
            return super().step(state, action)

    model = plane()[1]
    graph_of(Watched(), model, 2).grow((0, 0), 2)
    with pytest.raises(MemoryError):
        graph_of(Watched(), model, 2, memory=2000).grow((0, 0), 2)
    assert collects
    assert not any(collects)
    assert gc.isenabled()


def test_a_world_without_actions_or_with_too_many_tasks_or_cues_is_named() -> None:
    world, model = plane()

    class Stuck(Plane):
        def actions(self, state: tuple[int, int]) -> tuple[tuple[int, int], ...]:
            return super().actions(state) if state == (0, 0) else ()

    with pytest.raises(ValueError, match=r"no action is valid in \(1, 0\)"):
        graph_of(Stuck(), model, 3).grow((0, 0), 3)
    with pytest.raises(ValueError, match="65536 tasks"):
        graph_of(Plane(num_tasks=65537), model, 3)
    with pytest.raises(ValueError, match="16 approval states"):
        graph_of(*plane(num_cues=17), 3)
    with pytest.raises(ValueError, match="horizon 3"):
        graph_of(world, model, 3).grow((0, 0), 4)
