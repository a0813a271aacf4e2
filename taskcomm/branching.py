"""The closed-loop tree where more than an exact key is observed: a branch for every outcome of a step.

The law is Q_h of MODEL.md, section 6, on unnormalised weights as in `_search`: with w_ao the rows after
action a and outcome o, W_theta their sums by task and W their sum,

    C(w) = W ln W - sum_theta W_theta ln W_theta
    Q_h(w, a) = sum_o [ C(w_ao) + gamma min_a' Q_{h-1}(w_ao, a') ]

The memories that a step may lead to are the same for every outcome, only their weights differ. So all beliefs
that one sequence of actions leads to are searched at once: rows (task, memory) once, weights by belief.
Outcomes whose probabilities are in proportion under every mental state and task lead to the same belief,
and are one. Tasks that nothing within the horizon tells apart are one too.
"""

import math
import time
from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from taskcomm.belief import Belief, entropy
from taskcomm.beliefrows import alike
from taskcomm.levels import Bools, Floats, advance, approval_probability
from taskcomm.observation import Observer
from taskcomm.outcomes import capacity, distinct_outcomes
from taskcomm.teacher import Parameters, TeacherModel
from taskcomm.world import World

MOST_STATES = 50_000  # world states whose moves are kept
MOST_WEIGHTS = 1 << 20  # weights of beliefs and outcomes that are looked at together


def looks_beyond_the_key(model: TeacherModel) -> bool:
    """Whether a step has other outcomes than a press, which says that M is not waiting, and none."""
    seen = model.observation
    return bool(seen.discrete or seen.miss or seen.false_press)


def default_horizon(model: TeacherModel) -> int:
    """How far ahead a planner with this model looks unless told otherwise: what half a second allows.

    >>> default_horizon(TeacherModel.intuitive())
    5
    """
    if not looks_beyond_the_key(model):
        return 5
    return 3 if model.observation.discrete else 4


@dataclass(frozen=True)
class Looked:
    """Q_horizon in nats by action (`bound`; `exact` says that it is), as `searching.Search` has it.

    `expected` is C after the first step; `told` (horizon,) says nothing; `nodes` counts beliefs.
    """

    horizon: int
    bound: Floats
    expected: Floats
    nodes: int

    @property
    def exact(self) -> Bools:
        return np.ones(len(self.bound), dtype=np.bool_)

    @property
    def at_most(self) -> Floats:
        return self.bound

    @property
    def told(self) -> Floats:
        return np.full(self.horizon, np.inf)


class _Moves(NamedTuple):
    """What may be done in a world state: the states reached, and their cues (actions, M, tasks)."""

    states: tuple[Any, ...]
    cues: Bools


class _Node(NamedTuple):
    """Beliefs that share their memories: rows sorted by task, `weight` (beliefs, rows)."""

    task: NDArray[np.int64]
    level: Floats
    on_time: Floats
    weight: Floats
    seen: Bools
    since_press: int


class _Ahead(NamedTuple):
    """The rows of a node after every action, before anything is observed.

    `level` and `on_time` (actions, rows, M); `mental` (actions, rows, 2 + M) is P(M) of each row; `seen` by
    action.
    """

    level: Floats
    on_time: Floats
    mental: Floats
    seen: Bools


class _OutOfTime(Exception):
    pass


class BranchingTree:
    """The search, and what it keeps of a world and a model.

    `capacity` is the most that a step can tell of the task, in nats. Continuous channels are left aside.
    Raises ModelError where cues or channels do not fit the world.
    """

    def __init__(self, world: World, model: TeacherModel) -> None:
        self.world = world
        self._parameters = model.parameters(world.cue_names)
        rests = self._parameters.rest_steps > 0
        self._pressed, self._table = distinct_outcomes(Observer(world, model), rests)
        self.capacity = capacity(self._table, self._parameters)
        self._kept: dict[Hashable, _Moves] = {}

    def search(
        self, belief: Belief, state: Hashable, horizon: int, gamma: float, until: float = math.inf
    ) -> Looked | None:
        """Q_horizon of every action in `state`; None where time (of time.perf_counter) ran out before."""
        try:
            return self._search(belief, state, horizon, gamma, until)
        except _OutOfTime:
            return None

    def _search(self, belief: Belief, state: Hashable, horizon: int, gamma: float, until: float) -> Looked:
        if len(self._kept) > MOST_STATES:
            self._kept.clear()
        groups = self._alike_tasks(belief, self._reachable(state, horizon, until))
        node, inner = _grouped(belief, groups)
        tasks = np.array([group[0] for group in groups])
        one = _Search(self, tasks, self._pressed, self._table[:, tasks], self._parameters, gamma, until)
        values = one.values(node, state, horizon)[:, 0]
        expected = values if horizon == 1 else one.values(node, state, 1)[:, 0]
        steps = sum(gamma**k for k in range(horizon))
        return Looked(horizon, values + inner * steps, expected + inner, one.nodes)

    def moves(self, state: Hashable) -> _Moves:
        found = self._kept.get(state)
        if found is None:
            states = tuple(self.world.step(state, action) for action in self.world.actions(state))
            cues = np.array([self.world.cues(after) for after in states], dtype=np.bool_)
            found = self._kept[state] = _Moves(states, cues[:, self._parameters.cue])
        return found

    def _reachable(self, state: Hashable, horizon: int, until: float) -> list[Bools]:
        """The cues, (M, tasks), of every state that may be reached within the horizon."""
        edge, known, cues = [state], {state}, []
        for _ in range(horizon):
            if time.perf_counter() >= until:
                raise _OutOfTime
            after = []
            for at in edge:
                moves = self.moves(at)
                for reached, its in zip(moves.states, moves.cues, strict=True):
                    if reached not in known:
                        known.add(reached)
                        after.append(reached)
                        cues.append(its)
                    elif reached == state:
                        cues.append(its)
            edge = after
        return cues

    def _alike_tasks(self, belief: Belief, cues: list[Bools]) -> list[list[int]]:
        """The tasks of a belief by what they remember and what may tell them apart."""
        shown = np.concatenate([*cues, *belief.seen])
        groups: dict[Any, list[int]] = {}
        for task in np.unique(belief.task).tolist():
            own = belief.task == task
            shares = np.round(belief.weight[own] / belief.weight[own].sum(), 13)
            memory = shares.tobytes(), belief.level[own].tobytes(), belief.on_time[own].tobytes()
            key = *memory, shown[:, task].tobytes(), self._table[:, task].tobytes()
            groups.setdefault(key, []).append(task)
        return list(groups.values())


@dataclass
class _Search:
    """One search: its tasks stand for groups of tasks; `nodes` counts the beliefs that were looked at."""

    tree: BranchingTree
    tasks: NDArray[np.int64]
    pressed: NDArray[np.bool_]
    table: Floats
    parameters: Parameters
    gamma: float
    until: float
    nodes: int = 0

    def values(self, node: _Node, state: Hashable, horizon: int) -> Floats:
        """Q_horizon of every action for every belief of a node, (actions, beliefs)."""
        half = len(node.weight) // 2
        if half and node.weight.size * len(self.table) > MOST_WEIGHTS:
            parts = [node._replace(weight=part) for part in (node.weight[:half], node.weight[half:])]
            return np.concatenate([self.values(part, state, horizon) for part in parts], axis=1)
        moves = self.tree.moves(state)
        ahead = self._ahead(node, moves.cues[:, :, self.tasks])
        self.nodes += len(node.weight)
        result = self._costs_after(node, ahead)
        for action, reached in enumerate(moves.states if horizon > 1 else ()):
            if time.perf_counter() >= self.until:
                raise _OutOfTime
            after = [part[action] for part in ahead]
            for pressed in np.unique(self.pressed).tolist():
                child = self._child(node, *after, pressed=pressed)
                least = self.values(child, reached, horizon - 1).min(axis=0)
                result[action] += self.gamma * least.reshape(len(node.weight), -1).sum(axis=1)
        return result

    def _costs_after(self, node: _Node, ahead: _Ahead) -> Floats:
        """sum_o C(w_o) after every action of every belief, (actions, beliefs)."""
        from taskcomm import _branches  # numba is loaded, and the kernel compiled, only when it is needed

        result = np.empty((len(ahead.mental), len(node.weight)))
        begins = np.append(np.flatnonzero(np.diff(node.task, prepend=-1)), len(node.task))
        likely = np.empty((len(self.table), len(node.task)))
        _branches.costs_after(begins, node.task, node.weight, ahead.mental, self.table, likely, result)
        return result

    def _ahead(self, node: _Node, cues: Bools) -> _Ahead:
        p, count = self.parameters, len(cues)
        seen = np.concatenate(
            [np.broadcast_to(node.seen[1:], (count, *node.seen[1:].shape)), cues[:, None]], axis=1
        )
        states, at = np.arange(len(p.cue)), seen.shape[1] - 1 - p.steps_late
        newer = seen[:, at, states][:, :, node.task].transpose(0, 2, 1)
        older = seen[:, at - 1, states][:, :, node.task].transpose(0, 2, 1)
        level, on_time = advance(node.level, node.on_time, older, newer, p)
        approval = approval_probability(level, on_time, node.since_press < p.rest_steps, p)
        mistake = np.full((*approval.shape[:2], 1), p.mistake)
        waiting = 1 - p.mistake - approval.sum(axis=2, keepdims=True)
        return _Ahead(level, on_time, np.concatenate([waiting, mistake, approval], axis=2), seen)

    def _child(
        self, node: _Node, level: Floats, on_time: Floats, mental: Floats, seen: Bools, *, pressed: bool
    ) -> _Node:
        """The beliefs after each outcome with this state of the key, a belief's outcomes side by side."""
        table = self.table[np.flatnonzero(self.pressed == pressed)][:, node.task]
        unreset = (mental[:, :2] * table[:, :, :2]).sum(axis=2)
        resets = mental[:, 2:] * table[:, :, 2:]
        factor = np.concatenate([unreset, *np.moveaxis(resets, 2, 0)], axis=1)
        states, rows = level.shape[1], len(node.task)
        level, on_time = np.tile(level, (states + 1, 1)), np.tile(on_time, (states + 1, 1))
        for m in range(states):
            reset = slice((m + 1) * rows, (m + 2) * rows)
            level[reset, m] = on_time[reset, m] = 0.0
        source = np.tile(np.arange(rows), states + 1)
        weighs = np.asarray(node.weight.any(axis=0))[source]
        kept = np.flatnonzero(factor.any(axis=0) & weighs)
        task, level, on_time, source = node.task[source[kept]], level[kept], on_time[kept], source[kept]
        order, starts = alike(task, level, on_time, self.parameters)
        weight = node.weight[:, None, source[order]] * factor[:, kept[order]]
        weight = np.add.reduceat(weight.reshape(-1, len(order)), starts, axis=1)
        first = order[starts]
        since = 0 if pressed else node.since_press + 1
        return _Node(task[first], level[first], on_time[first], weight, seen, since)


def _grouped(belief: Belief, groups: list[list[int]]) -> tuple[_Node, float]:
    """The belief over groups of tasks, each with the rows of its first, and what groups hide, in nats."""
    marginal, parts, inner = belief.marginal(), [], 0.0
    for number, group in enumerate(groups):
        own, total = np.flatnonzero(belief.task == group[0]), float(marginal[group].sum())
        inner += total * entropy(marginal[group] / total)
        weight = belief.weight[own] * (total / marginal[group[0]])
        parts.append((np.full(len(own), number), belief.level[own], belief.on_time[own], weight))
    task, level, on_time, weight = (np.concatenate(part) for part in zip(*parts, strict=True))
    seen = belief.seen[:, :, [group[0] for group in groups]]
    return _Node(task, level, on_time, weight[None], seen, belief.since_press), inner
