"""Of balls that are alike one is looked at, and nothing is lost by it."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from teachers import random_model

from taskcomm.belief import Belief
from taskcomm.decision import Decision
from taskcomm.planner import EntropyPlanner
from taskcomm.symmetry import MOST, ReducedWorld
from taskcomm.teacher import TeacherModel
from taskcomm.world import Action, BallWorld, World

MODEL = TeacherModel.intuitive()
EXACT = 1e-9


class Silent:
    """A world that says nothing of what is alike in it."""

    def __init__(self, world: World) -> None:
        self.tasks, self.cue_names, self.start = world.tasks, world.cue_names, world.start
        self.actions, self.step, self.cues = world.actions, world.step, world.cues


def uniform(balls: int = 3, distances: int = 4) -> Belief:
    return Belief.initial(BallWorld(balls, distances), MODEL)


def after(belief: Belief, *shown: str) -> tuple[Belief, Any]:
    """The belief and the world after actions; one that ends with ! was followed by a press."""
    state = belief.world.start()
    for text in shown:
        state = belief.world.step(state, Action.parse(text.rstrip("!")))
        belief = belief.update(state, text.endswith("!"))
    return belief, state


def alike(belief: Belief, state: Any) -> list[tuple[int, int]]:
    reduced = ReducedWorld(belief.world)
    at = reduced.reduced(belief, state)
    return [pair for k, pair in enumerate(reduced.pairs) if at.pairs >> k & 1]


@given(
    st.integers(2, 5), st.booleans(), st.integers(0, 8), st.integers(1, 5), st.randoms(use_true_random=False)
)
def test_what_follows_is_the_same_with_alike_balls_exchanged(
    balls: int, unheld: bool, steps: int, more: int, random: Any
) -> None:
    world = BallWorld(balls, 2, unheld)
    state = world.start()
    for _ in range(steps):
        state = world.step(state, random.choice(world.actions(state)))
    label = world.alike(state)
    number = {task: t for t, task in enumerate(world.tasks)}
    for one, other in [(a, b) for a in label for b in label if a < b and label[a] == label[b]]:
        order = [number[world.exchanged(task, one, other)] for task in world.tasks]
        here, there = state, state
        for _ in range(more):
            assert (world.cues(here)[:, order] == world.cues(there)).all()
            actions = world.actions(here)
            assert {world.exchanged(a, one, other) for a in actions} == set(world.actions(there))
            action = random.choice(actions)
            here, there = world.step(here, action), world.step(there, world.exchanged(action, one, other))


def test_balls_are_alike_until_the_world_or_the_teacher_has_told_them_apart() -> None:
    three = uniform()
    assert alike(*after(three)) == [(1, 2), (1, 3), (2, 3)]
    assert alike(*after(three, "noa!", "noa")) == [(1, 2), (1, 3), (2, 3)]
    assert alike(*after(three, "light_on(2)")) == [(1, 3)]
    assert alike(*after(three, "light_on(2)", "light_off(2)")) == [(1, 3)]
    assert alike(*after(three, "pick_up(1)", "slide(1, 4, 2)")) == []
    lit = after(three, "light_on(1)", "light_on(2)")
    assert BallWorld().alike(lit[1]) == {1: -1, 2: -1, 3: 0}
    assert alike(*lit) == []  # one of them was lit before the other


def test_a_belief_tells_apart_what_it_knows_of_each_ball() -> None:
    belief, state = after(uniform(), "noa!")
    assert len(alike(belief, state)) == 3
    weight, level, on_time = belief.weight.copy(), belief.level.copy(), belief.on_time.copy()
    seen = belief.seen.copy()
    weight[0] *= 1 + 1e-9
    level[0, 0] += 1e-9
    on_time[0, 0] += 1e-9
    seen[0, 0, 0] = True
    # task 0 is (1, 2, 1): every exchange of two balls makes another task of it
    for known in ({"weight": weight}, {"level": level}, {"on_time": on_time}, {"seen": seen}):
        assert alike(replace(belief, **known), state) == []
    order = np.random.default_rng(0).permutation(len(belief.task))
    moved = {name: getattr(belief, name)[order] for name in ("task", "weight", "level", "on_time")}
    assert len(alike(replace(belief, **moved), state)) == 3


def decisions(belief: Belief, state: Any, horizon: int, **how: Any) -> tuple[Decision, Decision]:
    """Of a planner that knows what is alike, and of one that does not."""
    knowing = EntropyPlanner(belief.world, belief.model, horizon)
    plain = EntropyPlanner(Silent(belief.world), belief.model, horizon)
    return knowing.plan(belief, state, **how), plain.plan(belief, state, **how)


def assert_the_same(one: Decision, other: Decision) -> None:
    assert (one.action, one.ties) == (other.action, other.ties)
    if not one.bounds and not other.bounds:
        assert one.gap == pytest.approx(other.gap, abs=EXACT)
    for action, value in one.values.items():
        assert value == pytest.approx(other.values.get(action, value), abs=EXACT)
    for action, bound in one.bounds.items():
        assert bound <= other.values.get(action, np.inf) + EXACT
        assert bound >= one.value
    assert one.values.keys() | one.bounds.keys() == other.values.keys() | other.bounds.keys()


@pytest.mark.parametrize("seed", range(24))
def test_decisions_are_those_of_a_planner_that_looks_at_all_balls(seed: int) -> None:
    rng = np.random.default_rng(seed)
    world = BallWorld(int(rng.integers(4, 6)), int(rng.integers(1, 3)), bool(rng.integers(2)))
    belief, state = Belief.initial(world, random_model(rng, world)), world.start()
    for _ in range(int(rng.integers(4))):
        actions = [a for a in world.actions(state) if a.ball in (None, 1) and a.reference in (None, 2)]
        state = world.step(state, actions[int(rng.integers(len(actions)))])
        belief = belief.update(state, bool(rng.random() < 0.3))
    assert alike(belief, state)
    for horizon, exact in ((1, False), (2, True), (3, False), (3, True), (4, False)):
        knowing, plain = decisions(belief, state, horizon, exact_values=exact)
        assert_the_same(knowing, plain)
        assert knowing.nodes <= plain.nodes
        if exact:
            assert knowing.values.keys() == set(world.actions(state))


def test_a_search_of_six_steps_ends_with_the_same_and_looks_at_a_third_of_the_beliefs() -> None:
    belief, state = after(uniform(), "noa")
    knowing, plain = decisions(belief, state, 6)  # with a shorter look first
    assert_the_same(knowing, plain)
    assert 3 * knowing.nodes < plain.nodes


def test_with_a_deadline_bounds_hold_of_all_balls() -> None:
    belief, state = after(uniform(4), "light_on(1)!")
    exact = EntropyPlanner(belief.world, MODEL, 5).plan(belief, state, exact_values=True).values
    hasty = EntropyPlanner(belief.world, MODEL, 5).plan(belief, state, deadline=0.02)
    assert hasty.certificate is not None
    for action, value in exact.items():
        assert hasty.certificate.lower[action] - EXACT <= value <= hasty.certificate.upper[action] + EXACT


def test_actions_that_are_worth_the_same_are_no_regret() -> None:
    belief, state = after(uniform(4))
    planner = EntropyPlanner(belief.world, MODEL, 8)
    proof = planner.plan(belief, state, deadline=0.02).certificate
    assert proof is not None
    assert not proof.optimal
    lights = [action for action in proof.lower if action.name == "light_on"]
    assert len({(proof.lower[light], proof.upper[light]) for light in lights}) == 1
    others = min(bound for action, bound in proof.lower.items() if action not in lights)
    assert proof.regret == max(0.0, proof.upper[lights[0]] - others)
    assert proof.regret < proof.upper[lights[0]] - proof.lower[lights[0]]


def test_more_balls_than_are_looked_at() -> None:
    belief, state = after(uniform(13, 1))
    assert len(alike(belief, state)) == MOST
    knowing, plain = decisions(belief, state, 2)
    assert_the_same(knowing, plain)
    assert len(knowing.ties) == 13
