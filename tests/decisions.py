"""Seeded random decisions, of every kind of belief, and their comparison with the whole compiled tree.

A *group* is one random world with one random teacher model, and the beliefs of a walk through it.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from plaintree import PlainTree
from teachers import random_model
from trees import assert_decides_as

from taskcomm.belief import Belief
from taskcomm.planner import EntropyPlanner
from taskcomm.symmetry import ReducedWorld, says_what_is_alike
from taskcomm.teacher import TeacherModel
from taskcomm.world import BallWorld, World

Random = np.random.Generator
Situation = tuple[Belief, Any]


def _walked(rng: Random, belief: Belief, state: Any, steps: int, presses: float) -> Situation:
    """After steps of which half turn on as many cues as can be, so that there are levels to reset.

    The others are the first action, which leaves cues as they are, or any.
    """
    world, cue = belief.world, belief.parameters.cue
    for _ in range(steps):
        actions, way = world.actions(state), rng.random()
        action = actions[0 if way < 0.25 else int(rng.integers(len(actions)))]
        if way > 0.5:
            on = [np.asarray(world.cues(world.step(state, action)))[cue].sum() for action in actions]
            action = actions[int(rng.choice(np.flatnonzero(np.equal(on, max(on)))))]
        state = world.step(state, action)
        belief = belief.update(state, bool(rng.random() < presses))
    return belief, state


def with_marginal(belief: Belief, marginal: Any) -> Belief:
    """The belief with another marginal over tasks, and each task's memories as they were."""
    share = np.asarray(marginal) / np.maximum(belief.marginal(), 1e-300)
    weight = belief.weight * (share / share.max())[belief.task]
    kept = weight > 0
    weight = weight[kept] / weight[kept].sum()
    task, level, on_time = belief.task[kept], belief.level[kept], belief.on_time[kept]
    return replace(belief, task=task, weight=weight, level=level, on_time=on_time)


def _likely(rng: Random, belief: Belief) -> int:
    return int(rng.choice(belief.task))


def peaked(rng: Random, belief: Belief, state: Any) -> Situation:
    """One task has 0.9 to 0.999999 of the probability."""
    rest = float(rng.choice([1e-1, 1e-2, 1e-4, 1e-6]))
    marginal = rest * belief.marginal()
    marginal[_likely(rng, belief)] += 1.0 - rest
    return with_marginal(belief, marginal), state


def degenerate(rng: Random, belief: Belief, state: Any) -> Situation:
    """All tasks but one or two have 1e-6, 1e-12 or 1e-300."""
    marginal = rng.choice([1e-6, 1e-12, 1e-300], len(belief.world.tasks))
    marginal[belief.marginal() == 0] = 0.0
    for _ in range(2):
        marginal[_likely(rng, belief)] = 1.0
    return with_marginal(belief, marginal), state


def one_task(rng: Random, belief: Belief, state: Any) -> Situation:
    marginal = np.zeros(len(belief.world.tasks))
    marginal[_likely(rng, belief)] = 1.0
    return with_marginal(belief, marginal), state


def symmetric(rng: Random, belief: Belief, state: Any) -> Situation:
    """Whatever the world treats alike is alike: at the start, or with every ball lit a long while."""
    world = belief.world
    belief, state = Belief.initial(world, belief.model), world.start()
    lit = isinstance(world, BallWorld) and rng.random() < 0.5
    for step in range(int(rng.integers(0, 12))):
        state = world.step(state, world.actions(state)[0])
        if lit and isinstance(world, BallWorld) and step < world.num_balls:
            state = world.step(state, world.actions(state)[1 + step])
        belief = belief.update(state, bool(rng.random() < 0.2))
    return belief, state


def resting(rng: Random, belief: Belief, state: Any) -> Situation:
    """A press in the last step but none, one or two."""
    belief = belief.update(state, True)
    for _ in range(int(rng.integers(3))):
        belief = belief.update(state, False)
    return belief, state


def walked(rng: Random, belief: Belief, state: Any) -> Situation:
    return belief, state


KINDS: tuple[Callable[[Random, Belief, Any], Situation], ...] = (
    walked, peaked, walked, degenerate, symmetric, walked, resting, one_task,
)  # fmt: skip


class Family(NamedTuple):
    """How the groups of one kind are made; `beliefs` to a group."""

    horizon: int
    world: Callable[[Random], World]
    groups: int
    beliefs: int
    rows: int  # a belief of more is not taken, since its whole tree takes long
    presses: int = 0  # at least so many before the first belief, of a teacher that remembers them

    @property
    def name(self) -> str:
        pressed = f" after {self.presses} presses" if self.presses else ""
        return f"horizon {self.horizon}, {self.world.__name__}{pressed}"


class Group(NamedTuple):
    world: World
    model: TeacherModel
    gamma: float
    situations: list[tuple[str, Belief, Any]]  # kind, belief, state


def group(family: Family, seed: int) -> Group:
    """A random world, model and discount, and the situations of walks through it."""
    rng = np.random.default_rng([family.horizon, seed])
    world = family.world(rng)
    model = random_model(rng, world, slow=family.presses > 0)
    gamma = float(rng.choice([1.0, 1.0, 0.95, 0.5]))
    return Group(world, model, gamma, _situations(rng, family, world, model))


def _situations(
    rng: Random, family: Family, world: World, model: TeacherModel
) -> list[tuple[str, Belief, Any]]:
    """Of one walk, or of several: where the rows become too many, another walk begins, of fewer presses."""
    presses = family.presses
    found: list[tuple[str, Belief, Any]] = []
    share = 0.7 if presses else 0.3

    def begun() -> Situation:
        belief = Belief.initial(world, model)
        if rng.random() < 0.4:
            belief = Belief.initial(world, model, rng.dirichlet(np.full(len(world.tasks), 0.5)))
        return _walked(rng, belief, world.start(), presses, 1.0)

    belief, state = begun()
    number = int(rng.integers(len(KINDS)))
    while len(found) < family.beliefs:
        belief, state = _walked(rng, belief, state, int(rng.integers(3)), share)
        kind = KINDS[(number + len(found)) % len(KINDS)]
        situation = kind(rng, belief, state)
        if len(situation[0].task) > family.rows:
            presses = max(0, presses - 1)
            belief, state = begun()
        else:
            found.append((kind.__name__, *situation))
    return found


def counted(of: Group) -> Counter[str]:
    """How many decisions of a group have what."""
    tops, many = of.model.approvals.values(), len(of.situations)
    has = {
        "delay": any(top.delay > 0 for top in tops),
        "delay of part of a step": any(top.delay % of.model.dt > 0 for top in tops),
        "decay": any(top.decay is not None for top in tops),
        "rest": of.model.rest > 0,
        "discount": of.gamma < 1,
        f"{len(tops)} states": True,
        type(of.world).__name__: True,
    }
    if isinstance(of.world, BallWorld):
        has |= {f"{of.world.num_balls} balls": True, f"{of.world.num_distances} distances": True}
    counts = Counter({name: many for name, holds in has.items() if holds})
    reduced = ReducedWorld(of.world) if says_what_is_alike(of.world) else None
    for kind, belief, state in of.situations:
        counts.update([kind, *(f"over {rows} rows" for rows in (100, 300) if len(belief.task) > rows)])
        counts["resting now"] += belief.resting
        counts["things alike"] += reduced is not None and reduced.reduced(belief, state).pairs > 0
    return counts


def compare(family: Family, seed: int) -> Counter[str]:
    """Compare the decisions of one group with the whole tree, by `assert_decides_as`.

    Counts "decisions", and those with "one action" that is right. A failure names the group in a note.
    """
    counts: Counter[str] = Counter()
    world, model, gamma, situations = group(family, seed)
    try:
        planner = EntropyPlanner(world, model, family.horizon, gamma=gamma)
        tree = PlainTree(world, model, family.horizon, gamma)
        for _, belief, state in situations:
            clear = assert_decides_as(tree.values(belief, state), planner, belief, state)
            counts.update({"decisions": 1, "one action": int(clear)})
    except Exception as error:
        number = counts["decisions"]
        error.add_note(f"family {family.name!r}, seed {seed}, decision {number} ({situations[number][0]})")
        raise
    return counts
