# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""The whole closed-loop tree, compiled and otherwise plain: what the planner's search is measured against.

The law is Q_h of MODEL.md, section 6. Compiled, buffers allocated before the search, an explicit stack,
leaves in closed form, rows of weight 0 dropped; no bounds, no order of moves, no merging of beliefs,
tasks or worlds, nothing kept from one belief to the next. It shares no code with the search.

On unnormalised weights w of rows (task, memory), W_theta by task and W in all, a belief at depth d is worth

    value(w) = C(w) + gamma min_a (value(w_a0) + value(w_a1)),   C(w) = W ln W - sum_theta W_theta ln W_theta

with w_a0, w_a1 the weights after action a without and with a press, and for the last step

    C(w_a0) + C(w_a1) = C(w) + sum_theta W_theta h2(L_theta) - W h2(sum_theta W_theta L_theta / W).
"""

from collections.abc import Hashable
from typing import Any

import numpy as np

from taskcomm.belief import Belief
from taskcomm.compiling import kernel
from taskcomm.teacher import TeacherModel
from taskcomm.world import World

PEAK, FIRST_UP, FIRST_DOWN, FIRST, LAST_UP, LAST_DOWN, LAST, LATE, DECAY, HOLD = range(10)  # columns of top
START, STOP, SINCE, TURN = range(4)  # columns of whole, by depth
OWN, SUM, LEAST = range(3)  # columns of real, by depth

_kernel = kernel(__name__, "the plain tree")


@_kernel
def _xlogx(x):
    return x * np.log(x) if x > 0.0 else 0.0


@_kernel
def _h2(p):
    return -_xlogx(p) - _xlogx(1.0 - p)


@_kernel
def _seen(pattern, past, trail, depth, task):
    """The cues shown at `depth`, one bit each; at most 0: before the tree."""
    return pattern[trail[depth], task] if depth > 0 else past[len(past) - 1 + depth, task]


@_kernel
def _advance(top, m, pattern, past, trail, depth, task, level, on_time, resting):
    """Level, on-time and P(M = m) at the end of the step that leads to `depth`."""
    at = depth - int(top[m, LATE])
    if top[m, FIRST] > 0.0:
        if _seen(pattern, past, trail, at - 1, task) >> m & 1:
            level, on_time = min(1.0, level + top[m, FIRST_UP]), on_time + top[m, FIRST]
        else:
            level, on_time = max(0.0, level - top[m, FIRST_DOWN]), 0.0
    if _seen(pattern, past, trail, at, task) >> m & 1:
        level, on_time = min(1.0, level + top[m, LAST_UP]), on_time + top[m, LAST]
    else:
        level, on_time = max(0.0, level - top[m, LAST_DOWN]), 0.0
    probability = 0.0 if resting else top[m, PEAK] * level
    if on_time > top[m, HOLD] and top[m, DECAY] < np.inf:
        probability *= np.exp(-(on_time - top[m, HOLD]) / top[m, DECAY])
    return level, on_time, probability


@_kernel
def _cost(task, weight, start, stop):
    """C of the rows [start, stop); rows of one task are adjacent."""
    total, parts, at = 0.0, 0.0, start
    while at < stop:
        one, begin = 0.0, at
        while at < stop and task[at] == task[begin]:
            one += weight[at]
            at += 1
        parts += _xlogx(one)
        total += one
    return _xlogx(total) - parts


@_kernel
def _last_step(top, mu, pattern, past, trail, depth, task, weight, memory, start, stop, resting):
    """C(w_a0) + C(w_a1) - C(w) for the last step, which leads to `depth`."""
    total, pressed, parts, at = 0.0, 0.0, 0.0, start
    while at < stop:
        one, likely, begin = 0.0, 0.0, at
        while at < stop and task[at] == task[begin]:
            probability = mu
            for m in range(len(top)):
                level, on_time = memory[at, m, 0], memory[at, m, 1]
                probability += _advance(
                    top, m, pattern, past, trail, depth, task[at], level, on_time, resting
                )[2]
            one += weight[at]
            likely += weight[at] * probability
            at += 1
        if one > 0.0:
            parts += one * _h2(likely / one)
        total += one
        pressed += likely
    return parts - total * _h2(pressed / total) if total > 0.0 else 0.0


@_kernel
def _child(top, mu, pattern, past, trail, depth, task, weight, memory, start, stop, resting, pressed, ahead):
    """Append the rows after the step to `depth`, with or without a press, from `stop` on; where they end."""
    end = stop
    for r in range(start, stop):
        approved = 0.0
        for m in range(len(top)):
            level, on_time = memory[r, m, 0], memory[r, m, 1]
            ahead[m, 0], ahead[m, 1], ahead[m, 2] = _advance(
                top, m, pattern, past, trail, depth, task[r], level, on_time, resting
            )
            approved += ahead[m, 2]
        for reason in range(-1, len(top) if pressed else 0):  # a mistake or no press, then the resets
            probability = mu if reason < 0 else ahead[reason, 2]
            if not pressed:
                probability = 1.0 - mu - approved
            if probability == 0.0:
                continue
            task[end], weight[end] = task[r], weight[r] * probability
            for m in range(len(top)):
                kept = 0.0 if m == reason else 1.0
                memory[end, m, 0], memory[end, m, 1] = kept * ahead[m, 0], kept * ahead[m, 1]
            end += 1
    return end


@_kernel
def _tree(
    top, mu, rest, count, successor, pattern, past, task, weight, memory,
    trail, whole, real, ahead, values, rows, horizon, since, gamma,
):  # fmt: skip
    """Q_horizon of every action at trail[0], into `values`; returns the beliefs looked at."""
    depth, nodes, value = 0, 0, 0.0
    whole[0, START], whole[0, STOP], whole[0, SINCE], whole[0, TURN] = 0, rows, since, -1
    while depth >= 0:
        node, start, stop = trail[depth], whole[depth, START], whole[depth, STOP]
        resting = whole[depth, SINCE] < rest
        if whole[depth, TURN] < 0:
            nodes += 1
            real[depth, OWN], real[depth, LEAST] = _cost(task, weight, start, stop), np.inf
            real[depth, SUM] = 0.0
            if depth == horizon - 1:
                for a in range(count[node]):
                    trail[depth + 1] = successor[node, a]
                    value = real[depth, OWN] + _last_step(
                        top, mu, pattern, past, trail, depth + 1, task, weight, memory, start, stop, resting
                    )
                    real[depth, LEAST] = min(real[depth, LEAST], value)
                    if depth == 0:
                        values[a] = value
                value = real[depth, OWN] + gamma * real[depth, LEAST]
                depth -= 1
                continue
        else:  # a child has returned its value
            real[depth, SUM] += value
            if whole[depth, TURN] % 2 == 1:
                real[depth, LEAST] = min(real[depth, LEAST], real[depth, SUM])
                if depth == 0:
                    values[whole[0, TURN] // 2] = real[0, SUM]
                real[depth, SUM] = 0.0
        whole[depth, TURN] += 1
        action, pressed = whole[depth, TURN] // 2, whole[depth, TURN] % 2 == 1
        if action == count[node]:
            value = real[depth, OWN] + gamma * real[depth, LEAST]
            depth -= 1
            continue
        trail[depth + 1] = successor[node, action]
        end = _child(
            top, mu, pattern, past, trail, depth + 1, task, weight, memory, start, stop, resting, pressed,
            ahead,
        )  # fmt: skip
        whole[depth + 1, START], whole[depth + 1, STOP], whole[depth + 1, TURN] = stop, end, -1
        whole[depth + 1, SINCE] = 0 if pressed else whole[depth, SINCE] + 1
        depth += 1
    return nodes


class PlainTree:
    """Q_h of every action, by the whole tree; `nodes` counts the beliefs of the last one."""

    def __init__(self, world: World, model: TeacherModel, horizon: int, gamma: float = 1.0) -> None:
        self.world, self.model, self.horizon, self.gamma = world, model, horizon, gamma
        self.nodes = 0
        self._cue = model.parameters(world.cue_names).cue
        self._index: dict[Hashable, int] = {}
        self._states: list[Any] = []
        self._after: dict[int, list[int]] = {}
        self._grown: set[Hashable] = set()

    def _node(self, state: Hashable) -> int:
        if state not in self._index:
            self._index[state] = len(self._states)
            self._states.append(state)
        return self._index[state]

    def grow(self, state: Hashable) -> None:
        """Number the worlds within `horizon` steps of `state`, and lay out what they lead to and show."""
        if state in self._grown:
            return
        layer = [self._node(state)]
        for _ in range(self.horizon):
            for node in layer:
                if node not in self._after:
                    at = self._states[node]
                    actions = self.world.actions(at)
                    self._after[node] = [self._node(self.world.step(at, action)) for action in actions]
            layer = sorted({after for node in layer for after in self._after[node]})
        self._grown.add(state)
        self._count = np.zeros(len(self._states), dtype=np.int64)
        self._successor = np.zeros((len(self._states), max(map(len, self._after.values()))), dtype=np.int64)
        for node, after in self._after.items():
            self._count[node] = len(after)
            self._successor[node, : len(after)] = after
        bits = 1 << np.arange(len(self._cue))
        cues = (np.asarray(self.world.cues(at))[self._cue] for at in self._states)
        self._pattern = np.array([bits @ on for on in cues], dtype=np.int64)

    def values(self, belief: Belief, state: Hashable) -> dict[Any, float]:
        """{action: expected cost in nats}, in canonical order."""
        self.grow(state)
        p, rows, states = belief.parameters, len(belief.task), len(self._cue)
        first = p.part_late * p.dt
        last = p.dt - first
        speeds = [first / p.rise, first / p.fall, first, last / p.rise, last / p.fall, last]
        room = rows * sum((states + 1) ** depth for depth in range(self.horizon))
        task, weight, memory = np.zeros(room, dtype=np.int64), np.zeros(room), np.zeros((room, states, 2))
        task[:rows], weight[:rows] = belief.task, belief.weight
        memory[:rows, :, 0], memory[:rows, :, 1] = belief.level, belief.on_time
        bits = (1 << np.arange(states))[:, None]
        actions = self.world.actions(state)
        values = np.zeros(len(actions))
        self.nodes = _tree(
            np.column_stack([p.peak, *speeds, p.steps_late, p.decay, p.hold]),
            p.mistake,
            p.rest_steps,
            *(self._count, self._successor, self._pattern, (belief.seen * bits).sum(axis=1)),
            *(task, weight, memory),
            np.full(self.horizon + 1, self._index[state]),
            np.zeros((self.horizon, 4), dtype=np.int64),
            np.zeros((self.horizon, 3)),
            np.zeros((states, 3)),
            values,
            *(rows, self.horizon, belief.since_press, self.gamma),
        )
        return dict(zip(actions, values.tolist(), strict=True))
