"""What the search knows of a task along a history is what the belief knows."""

from typing import Any

import numpy as np
import pytest
from decisions import Family, group
from kernels import outside
from teachers import random_model, small_world, wide_world

from taskcomm import _histories, _roots
from taskcomm._arrays import (
    BEGIN,
    END,
    FULL,
    GROUPS,
    KEPT_HISTORIES,
    LEVEL,
    MASS,
    ON_PRESS,
    SILENTLY,
    SLOTS,
    USED_HISTORIES,
    WEIGHT,
)
from taskcomm.belief import Belief
from taskcomm.planner import EntropyPlanner
from taskcomm.searching import Search
from taskcomm.teacher import TeacherModel
from taskcomm.world import BallWorld, World
from taskcomm.worldgraph import WorldGraph

history_after, step_of = outside(_histories.history_after), outside(_histories.step_of)
crowded, forget, plant = outside(_roots.crowded), outside(_roots.forget), outside(_roots.plant)
LONG = 9
MANY = 30  # rows: of a belief with more no press is drawn, since each multiplies them


class Walk:
    """One task's history in the search and in the belief, side by side."""

    def __init__(self, seed: int, world_of: Any, rows: int = 1 << 18) -> None:
        self.rng = np.random.default_rng(seed)
        self.world: World = world_of(self.rng)
        model = random_model(self.rng, self.world)
        task = int(self.rng.integers(len(self.world.tasks)))
        prior = np.zeros(len(self.world.tasks))
        prior[task] = 1.0
        self.belief, self.state = Belief.initial(self.world, model, prior), self.world.start()
        for _ in range(int(self.rng.integers(8))):
            self.state = self._next()
            pressed = len(self.belief.task) < MANY and bool(self.rng.random() < 0.4)
            self.belief = self.belief.update(self.state, pressed)
        p = self.belief.parameters
        self.graph = WorldGraph(self.world, p.cue, p.peak * p.dt / p.rise, LONG)
        root = self.graph.grow(self.state, 1)
        assert root is not None
        search = Search(self.belief, self.graph, root, LONG, 0.0, 1.0, rows)
        self.teacher, _, self.path, given, self.histories, self.groups, *_ = search._arguments
        assert (
            plant(self.teacher, self.path, self.histories, self.groups, given, self.belief.since_press) == 1
        )
        self.task, self.h = task, int(self.groups.history[0, 0])

    def _next(self) -> Any:
        actions = self.world.actions(self.state)
        return self.world.step(self.state, actions[int(self.rng.integers(len(actions)))])

    def press(self, shown: int) -> float:
        """P(press) of the step from here that shows a pattern."""
        s = step_of(self.teacher, self.histories, self.h, shown)
        return float(self.histories.step[s]["press"] / self.histories.has[self.h, MASS])

    def go_on(self) -> None:
        """A step, with a press or without, of both."""
        self.state = self._next()
        shown = int(self.graph.pattern[self.graph.node(self.state), self.task])
        assert self.press(shown) == pytest.approx(self.belief.press_probability(self.state), rel=1e-9)
        pressed = len(self.belief.task) < MANY and bool(self.rng.random() < 0.4)
        s = step_of(self.teacher, self.histories, self.h, shown)
        branch = ON_PRESS if pressed else SILENTLY
        self.h = history_after(self.teacher, self.path, self.histories, self.h, s, branch)
        assert self.h > 0
        self.belief = self.belief.update(self.state, pressed)


@pytest.mark.parametrize("world_of", [small_world, wide_world])
def test_presses_along_a_history_are_as_likely_as_the_belief_says(world_of: Any) -> None:
    for seed in range(40):
        walk = Walk(seed, world_of)
        for _ in range(5 if world_of is small_world else 3):
            walk.go_on()


def test_tasks_share_a_history_at_the_root_only_if_their_memories_are_the_same() -> None:
    shared = 0
    for seed in range(40):
        of = group(Family(1, small_world, groups=1, beliefs=8, rows=300), seed)
        for _, belief, state in of.situations:  # tasks of 1e-300 among them, whose rows say little
            graph = WorldGraph(of.world, belief.parameters.cue, np.ones(len(belief.parameters.cue)), 1)
            root = graph.grow(state, 1)
            assert root is not None
            arguments = Search(belief, graph, root, 1, 0.0, of.gamma, 1 << 12)._arguments
            teacher, _, path, given, histories, groups, *_ = arguments
            number = plant(teacher, path, histories, groups, given, belief.since_press)
            shared += number - len(np.unique(groups.history[0, :number]))
            for t, h in zip(groups.task[0, :number], groups.history[0, :number], strict=True):
                rows = given.row[given.task == t]
                own = histories.row[histories.of[h, BEGIN] : histories.of[h, END]]
                assert (own[:, LEVEL:] == rows[:, LEVEL:]).all()
                assert own[:, WEIGHT] == pytest.approx(rows[:, WEIGHT] / rows[:, WEIGHT].sum(), abs=1e-12)
    assert shared > 100


def test_a_step_is_worked_out_once_and_patterns_with_the_same_lowest_bits_are_told_apart() -> None:
    walk = Walk(3, wide_world)
    patterns = [0, 1, SLOTS, SLOTS + 1, 3 * SLOTS, 1 << 12, (1 << 12) + 1]
    steps = [step_of(walk.teacher, walk.histories, walk.h, what) for what in patterns]
    assert len(set(steps)) == len(steps)
    assert [step_of(walk.teacher, walk.histories, walk.h, what) for what in patterns] == steps
    assert walk.histories.shown[steps].tolist() == patterns


def test_steps_with_the_same_lowest_bits_fill_their_room_and_are_worked_out_again_when_forgotten() -> None:
    walk = Walk(3, wide_world, rows=200)
    used, first_steps = walk.histories.used, SLOTS * len(walk.histories.of)
    room = len(walk.histories.step) - first_steps
    patterns = [1 + SLOTS * k for k in range(1 + room)]
    steps = [step_of(walk.teacher, walk.histories, walk.h, what) for what in patterns]
    assert steps == [SLOTS * walk.h + 1, *range(first_steps, first_steps + room)]
    assert crowded(walk.histories)
    assert not used[FULL]
    assert step_of(walk.teacher, walk.histories, walk.h, 1 + SLOTS * (1 + room)) == 0
    assert used[FULL]
    assert [step_of(walk.teacher, walk.histories, walk.h, what) for what in patterns] == steps
    before = [walk.press(shown) for shown in patterns]
    forget(walk.teacher, walk.path, walk.histories, walk.groups, np.array([1]), 0)
    assert not crowded(walk.histories)
    walk.h = int(walk.groups.history[0, 0])
    backwards = [walk.press(shown) for shown in reversed(patterns)]
    assert backwards[::-1] == before


def test_what_is_not_forgotten_goes_on_as_before() -> None:
    for seed in range(20):
        walk = Walk(seed, small_world)
        for _ in range(4):
            walk.go_on()
        before = [walk.press(shown) for shown in range(4)]
        walk.groups.history[0, 0] = walk.h
        forget(walk.teacher, walk.path, walk.histories, walk.groups, np.array([1]), 0)
        used = walk.histories.used
        assert used[USED_HISTORIES] == used[KEPT_HISTORIES] == 1 + 5  # it, what it came of, and number 0
        assert not crowded(walk.histories)
        walk.h = int(walk.groups.history[0, 0])
        assert [walk.press(shown) for shown in range(4)] == pytest.approx(before, rel=1e-12)
        for _ in range(4):
            walk.go_on()


def test_a_search_with_so_little_room_that_it_must_forget_finds_the_same() -> None:
    world, model = BallWorld(), TeacherModel.intuitive()
    belief, state = Belief.initial(world, model), world.start()
    for number, action in enumerate(world.actions(state)[1:4]):
        state = world.step(state, action)
        belief = belief.update(state, number == 2)
    wanted = EntropyPlanner(world, model, 4).plan(belief, state, exact_values=True)
    planner = EntropyPlanner(world, model, 4)
    root = planner._graph.grow(planner._at(belief, state), 4)
    assert root is not None
    forgot = 0
    for rows in (300, 600, 1200, 2400):
        search = Search(belief, planner._graph, root, 4, np.inf, 1.0, rows)
        if search.run():
            histories, frames = search._arguments[4], search._arguments[6]
            forgot += int(histories.used[KEPT_HISTORIES] > 1)
            assert search.bound == pytest.approx(list(wanted.values.values()), abs=1e-12)
            assert frames.whole[0, GROUPS] > 1
    assert forgot > 1
