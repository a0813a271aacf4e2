"""Of balls that are alike one is looked at, and nothing is lost by it."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from teachers import random_model

from taskcomm.belief import Belief
from taskcomm.certificate import certificate
from taskcomm.decision import Decision
from taskcomm.planner import EntropyPlanner
from taskcomm.symmetry import MOST, ReducedWorld, says_what_is_alike
from taskcomm.teacher import TeacherModel
from taskcomm.world import Action, BallWorld, World

MODEL = TeacherModel.intuitive()
EXACT = 1e-9


class Join:
    """Two of four lamps may be joined, in either order; the tasks are the pairs."""

    lamps = "abcd"
    cue_names = ("joined", "touched")

    def __init__(self) -> None:
        self.tasks = [one + other for one in self.lamps for other in self.lamps if one < other]

    def start(self) -> str:
        return ""

    def actions(self, state: str) -> list[str]:
        return ["part" if state else "wait", *self.tasks]

    def step(self, state: str, action: str) -> str:
        return action if action in self.tasks else ""

    def cues(self, state: str) -> Any:
        touched = [any(lamp in task for lamp in state) for task in self.tasks]
        return np.array([[task == state for task in self.tasks], touched])

    def alike(self, state: str) -> dict[str, bool]:
        return {lamp: lamp in state for lamp in self.lamps}

    def exchanged(self, value: str, one: str, other: str) -> str:
        if value not in self.tasks:
            return value
        become = {one: other, other: one}
        return "".join(sorted(become.get(lamp, lamp) for lamp in value))


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


def decisions(
    belief: Belief, state: Any, horizon: int, gamma: float = 1.0, **how: Any
) -> tuple[Decision, Decision]:
    """Of a planner that knows what is alike, and of one that does not."""
    knowing = EntropyPlanner(belief.world, belief.model, horizon, gamma=gamma)
    plain = EntropyPlanner(Silent(belief.world), belief.model, horizon, gamma=gamma)
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
        gamma = float(rng.choice([1.0, 0.9, 0.3]))
        knowing, plain = decisions(belief, state, horizon, gamma, exact_values=exact)
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
    lower, upper = np.array([1.0, 1.0, 2.0]), np.array([2.5, 2.5, 3.0])
    assert certificate("abc", 0, 9, lower, upper, 1e-9).regret == 1.5
    assert certificate("abc", 0, 9, lower, upper, 1e-9, same=[0, 1]).regret == 0.5
    belief, state = after(uniform(4))
    proof = EntropyPlanner(belief.world, MODEL, 30).plan(belief, state, deadline=0.02).certificate
    assert proof is not None
    lights = [action for action in proof.lower if action.name == "light_on"]
    assert len({(proof.lower[light], proof.upper[light]) for light in lights}) == 1
    others = min(bound for action, bound in proof.lower.items() if action not in lights)
    assert proof.regret == max(0.0, proof.upper[lights[0]] - others)


def test_more_balls_than_are_looked_at() -> None:
    belief, state = after(uniform(13, 1))
    assert len(alike(belief, state)) == MOST
    knowing, plain = decisions(belief, state, 2)
    assert_the_same(knowing, plain)
    assert len(knowing.ties) == 13


@pytest.mark.parametrize("seed", range(8))
def test_actions_that_take_two_things_that_are_alike(seed: int) -> None:
    rng = np.random.default_rng(seed)
    world = Join()
    belief, state = Belief.initial(world, random_model(rng, world), prune=float(rng.choice([0, 1e-3]))), ""
    for action in ("ab", "wait", "ab")[: int(rng.integers(4))]:
        state = world.step(state, action)
        belief = belief.update(state, bool(rng.random() < 0.3))
    assert alike(belief, state)
    for horizon in (1, 2, 3):
        knowing, plain = decisions(belief, state, horizon, exact_values=True)
        assert_the_same(knowing, plain)
        assert knowing.nodes < plain.nodes or horizon == 1


class Dim(BallWorld):
    """The light of ball 1 cannot be seen; what BallWorld says of its balls does not hold here."""

    def cues(self, state: Any) -> Any:
        table = super().cues(state).copy()
        table[0, [task.mov == 1 for task in self.tasks]] = False
        return table


def test_a_world_that_changed_what_another_said_was_alike_is_looked_at_as_a_whole() -> None:
    assert says_what_is_alike(BallWorld())
    assert says_what_is_alike(type("Same", (BallWorld,), {"__slots__": ()})())
    assert not says_what_is_alike(Dim())
    assert says_what_is_alike(type("Anew", (Dim,), {"alike": lambda *_: {}, "exchanged": lambda *_: None})())
    assert not says_what_is_alike(Silent(BallWorld()))
    mended = Join()
    vars(mended)["actions"] = lambda state: ["ab"]
    assert not says_what_is_alike(mended)
    world = Dim()
    belief = Belief.initial(world, MODEL)
    knowing, plain = decisions(belief, world.start(), 3)
    assert knowing == replace(plain, asked=knowing.asked)
    assert str(knowing.action) == "light_on(2)"


def test_what_an_exchange_cannot_make_is_one_clear_error() -> None:
    world = Join()
    world.tasks = world.tasks[:-1]
    model = random_model(np.random.default_rng(0), world)
    planner, belief = EntropyPlanner(world, model, 2), Belief.initial(world, model)
    with pytest.raises(ValueError, match="exchange a and c makes of tasks what is none"):
        planner.plan(belief, "")
    world = type("Lame", (Join,), {"actions": lambda self, state: ["wait", "cd"]} | {
        name: getattr(Join, name) for name in ("alike", "exchanged")
    })()  # fmt: skip
    model = random_model(np.random.default_rng(0), world)
    planner, belief = EntropyPlanner(world, model, 2), Belief.initial(world, model)
    with pytest.raises(ValueError, match="exchanges make ab of an action in"):
        planner.plan(belief, "")


def test_a_key_that_errs_is_looked_ahead_of_as_a_whole() -> None:
    model = replace(MODEL, observation=replace(MODEL.observation, miss=0.1))
    belief, state = after(Belief.initial(BallWorld(3, 1), model))
    knowing, plain = decisions(belief, state, 2)
    assert_the_same(knowing, plain)
    assert len(knowing.ties) == 3
