"""The exact closed-loop tree search, compiled: arrays in, arrays out, no balls.

The law is Q_h of MODEL.md, section 6, on unnormalised measures: with w the weights of the rows
(task, memory), W_theta their sums by task and W the total, the cost is total weight times entropy:

    C(w) = W ln W - sum_theta W_theta ln W_theta
    V_h(w) = min_a [ C(w_a0) + C(w_a1) + gamma (V_{h-1}(w_a0) + V_{h-1}(w_a1)) ]

with w_a0, w_a1 the measures after action a without and with a press. Branch and bound keeps it
exact: only what cannot change the result is left out.

Bound. A step lowers the expected entropy by no more than its information about the rows. The press
probability of a row lies in [mu, top], top what its levels reach if its cues come on as early as
the world graph allows. Information is convex in each of these probabilities, so with
B = sum_rows w (top_row - mu) it is at most that of a channel with the two points mu and the
highest top, used with mean mu + B / W or at its capacity if that comes first. It is also at most
the sum of w KL(row || best task) over the rows of all tasks but the best, which is small once the
belief is peaked. Both are linear in w for a fixed output distribution, and so hold for the
expectation over all that may be observed until then.

Layout. `row[r]` is (weight, levels, on-times) and `task[r]` its task; rows of one task are adjacent.
`top[m]` holds the table-top of approval m by the columns below. `trail[d]` is the world node at
depth d, `past` the patterns shown before depth 0 and at it, newest last. Frames of the search
(one per depth) are the rows of `real` and `whole`.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from taskcomm.belief import Belief
from taskcomm.teacher import Parameters
from taskcomm.worldgraph import WorldGraph

Floats = NDArray[np.float64]

PEAK, UP, DOWN, FIRST_UP, FIRST_DOWN, FIRST, LAST, LATE, DECAY, HOLD = range(10)  # columns of top
MASS, HIGHEST, OTHERS, BEST, INFORMATION, CAPACITY, REACHED = range(7)  # columns of gain
SILENT, PRESS, PRESSED, BOUND = range(4)  # rows of table[depth], by action
COST, CUTOFF, SLACK, LEAST, ROOM, LEAST_PRESS, VALUE = range(7)  # columns of real
START, STOP, STEPS, SINCE, AT, PHASE, SILENT_START, PRESS_STOP = range(8)  # columns of whole
ENTER, AFTER_SILENT, AFTER_PRESS = range(3)  # phases

_kernel = njit(cache=True, nogil=True, error_model="numpy")
_inlined = njit(cache=True, nogil=True, error_model="numpy", inline="always")


@_kernel
def _xlogx(x):
    return x * np.log(x) if x > 0.0 else 0.0


@_kernel
def _h2(p):
    return -_xlogx(p) - _xlogx(1.0 - p)


@_kernel
def _divergence(p, q):
    """KL of press probability p from q, in nats."""
    return _xlogx(p) + _xlogx(1.0 - p) - p * np.log(q) - (1.0 - p) * np.log(1.0 - q)


@_kernel
def _seen(pattern, past, trail, depth, task):
    """The pattern shown at `depth` of the path; at most 0: before the search."""
    if depth >= 1:
        return pattern[trail[depth], task]
    return past[len(past) - 1 + depth, task]


@_kernel
def _approval(top, row, r, m, states, older, newer):
    """Level, on-time and P(M_t = m) of a row after a step that shows `older`, then `newer`."""
    level = row[r, 1 + m]
    decays = row.shape[1] > 1 + states
    on_time = row[r, 1 + states + m] if decays else 0.0
    if top[m, FIRST] > 0.0:
        if older:
            level = min(1.0, level + top[m, FIRST_UP])
            on_time += top[m, FIRST]
        else:
            level, on_time = max(0.0, level - top[m, FIRST_DOWN]), 0.0
    if newer:
        level = min(1.0, level + top[m, UP])
        on_time += top[m, LAST]
    else:
        level, on_time = max(0.0, level - top[m, DOWN]), 0.0
    probability = top[m, PEAK] * level
    if decays and on_time > top[m, HOLD]:
        probability *= np.exp(-(on_time - top[m, HOLD]) / top[m, DECAY])
    return level, on_time, probability


@_kernel
def _late(top, pattern, past, trail, depth, task, m, shown):
    """Whether approval m's cue is seen in the first part and in the rest of the step to depth."""
    lag, bit = int(top[m, LATE]), 1 << m
    newer = shown if lag == 0 else _seen(pattern, past, trail, depth - lag, task)
    older = 0
    if top[m, FIRST] > 0.0:
        older = _seen(pattern, past, trail, depth - lag - 1, task)
    return older & bit != 0, newer & bit != 0


@_kernel
def _press_mass(top, mu, pattern, past, trail, task, row, depth, begin, end, shown, resting):
    """Weight of the press branch of the rows of one task, if the step to depth + 1 shows `shown`."""
    total = 0.0
    for r in range(begin, end):
        probability = mu
        if not resting:
            for m in range(len(top)):
                older, newer = _late(top, pattern, past, trail, depth + 1, task[r], m, shown)
                probability += _approval(top, row, r, m, len(top), older, newer)[2]
        total += row[r, 0] * probability
    return total


@_kernel
def _one_step(
    top, mu, first, count, successor, pattern, past, trail, task, row, depth, start, stop, resting, group, table
):  # fmt: skip
    """C and mass of both branches of every action at trail[depth], into table[depth].

    Tasks for which an action shows what the first action shows are counted once.
    """
    node = trail[depth]
    base = successor[first[node]]
    groups, at = 0, start
    sum_press, sum_silent, total_press, total = 0.0, 0.0, 0.0, 0.0
    while at < stop:
        begin, weight = at, 0.0
        while at < stop and task[at] == task[begin]:
            weight += row[at, 0]
            at += 1
        shown = pattern[base, task[begin]]
        pressed = _press_mass(top, mu, pattern, past, trail, task, row, depth, begin, at, shown, resting)
        group[groups, 0], group[groups, 1], group[groups, 2] = begin, weight, pressed
        group[groups, 3], group[groups, 4] = _xlogx(pressed), _xlogx(weight - pressed)
        group[groups, 5] = -1.0
        total, total_press = total + weight, total_press + pressed
        sum_press, sum_silent = sum_press + group[groups, 3], sum_silent + group[groups, 4]
        groups += 1
    group[groups, 0] = stop
    for a in range(count[node]):
        child = successor[first[node] + a]
        press, silent, mass = sum_press, sum_silent, total_press
        for g in range(groups):
            begin = int(group[g, 0])
            shown = pattern[child, task[begin]]
            if a > 0 and shown != pattern[base, task[begin]]:
                if group[g, 5] != shown:
                    end = int(group[g + 1, 0])
                    pressed = _press_mass(
                        top, mu, pattern, past, trail, task, row, depth, begin, end, shown, resting
                    )
                    group[g, 5], group[g, 6] = shown, pressed
                    group[g, 7], group[g, 8] = _xlogx(pressed), _xlogx(group[g, 1] - pressed)
                mass += group[g, 6] - group[g, 2]
                press += group[g, 7] - group[g, 3]
                silent += group[g, 8] - group[g, 4]
        table[depth, PRESSED, a] = mass
        table[depth, PRESS, a] = max(0.0, _xlogx(mass) - press)
        table[depth, SILENT, a] = max(0.0, _xlogx(total - mass) - silent)


@_kernel
def _children(top, mu, pattern, past, trail, task, row, depth, start, stop, resting):
    """Append the rows after the step to trail[depth + 1]: with a press from `stop` on, then without.

    Returns where the former end and the latter start; the latter are as many as the parent's. The
    press branch comes first since it is searched last, and must not be overwritten until then.
    """
    states = len(top)
    decays = row.shape[1] > 1 + states
    press_stop, silent_start = stop, stop + (stop - start) * (states + 1)
    if silent_start + (stop - start) > len(task):
        return -1, -1
    for r in range(start, stop):
        silent, mistaken = silent_start + r - start, press_stop
        press_stop += 1
        shown = pattern[trail[depth + 1], task[r]]
        task[silent] = task[mistaken] = task[r]
        approved = 0.0
        for m in range(states):
            older, newer = _late(top, pattern, past, trail, depth + 1, task[r], m, shown)
            level, on_time, probability = _approval(top, row, r, m, states, older, newer)
            row[silent, 1 + m] = row[mistaken, 1 + m] = level
            if decays:
                row[silent, 1 + states + m] = row[mistaken, 1 + states + m] = on_time
            if probability > 0.0 and not resting:
                approved += probability
                task[press_stop] = task[r]
                row[press_stop, 0] = row[r, 0] * probability
                row[press_stop, 1] = m  # for the second pass
                press_stop += 1
        row[mistaken, 0] = row[r, 0] * mu
        row[silent, 0] = row[r, 0] * (1.0 - mu - approved)
        for reset in range(mistaken + 1, press_stop):
            m = int(row[reset, 1])
            for column in range(1, row.shape[1]):
                row[reset, column] = row[silent, column]
            row[reset, 1 + m] = 0.0
            if decays:
                row[reset, 1 + states + m] = 0.0
    return press_stop, silent_start


@_kernel
def _may_show(pattern, past, trail, reach, depth, ahead, task):
    """Bits that may be on `ahead` steps after `depth`; known where that is past."""
    if ahead >= 1:
        return reach[trail[depth], ahead, task]
    return _seen(pattern, past, trail, depth + ahead, task)


@_kernel
def _highest(top, mu, pattern, past, trail, reach, task, row, depth, r, steps, gain):
    """The highest P(press) of a row 1 to `steps` steps after `depth`, into gain[:, REACHED]."""
    for k in range(steps):
        gain[k, REACHED] = mu
    for m in range(len(top)):
        level, bit, lag = row[r, 1 + m], 1 << m, int(top[m, LATE])
        for k in range(steps):
            if top[m, FIRST] > 0.0:
                if _may_show(pattern, past, trail, reach, depth, k - lag, task[r]) & bit != 0:
                    level = min(1.0, level + top[m, FIRST_UP])
                else:
                    level = max(0.0, level - top[m, FIRST_DOWN])
            if _may_show(pattern, past, trail, reach, depth, k + 1 - lag, task[r]) & bit != 0:
                level = min(1.0, level + top[m, UP])
            else:
                level = max(0.0, level - top[m, DOWN])
            gain[k, REACHED] += top[m, PEAK] * level


@_kernel
def _two_points(mu, highest, share):
    """Information of a channel between mu and `highest`, at most `share` of the mass at the latter."""
    low, high = _h2(mu), _h2(highest)
    optimum = 1.0 / (1.0 + np.exp((high - low) / (highest - mu)))
    share = min(share, (optimum - mu) / (highest - mu))
    return max(0.0, _h2(mu + share * (highest - mu)) - (1.0 - share) * low - share * high)


@_kernel
def _gains(top, mu, pattern, past, trail, reach, task, row, depth, start, stop, steps, gain):
    """The most that each of the next `steps` steps can tell, in nats, for the rows [start, stop).

    gain[:, INFORMATION] is for these rows, gain[:, CAPACITY] for a unit of any mass among them.
    """
    ceiling = mu + top[:, PEAK].sum()
    slope = _divergence(ceiling, mu) / (ceiling - mu) if ceiling > mu else 0.0
    total, most, from_, to, at = 0.0, -1.0, start, start, start
    while at < stop:
        begin, weight = at, 0.0
        while at < stop and task[at] == task[begin]:
            weight += row[at, 0]
            at += 1
        total += weight
        if weight > most:
            most, from_, to = weight, begin, at
    for k in range(steps):
        gain[k, MASS], gain[k, HIGHEST], gain[k, OTHERS] = 0.0, mu, 0.0
    for i in range(stop - start):  # the best task's rows come first
        r = from_ + i if i < to - from_ else start + i - (to - from_)
        if i >= to - from_ and r >= from_:
            r += to - from_
        if i == to - from_:
            for k in range(steps):
                gain[k, BEST] = _divergence(mu, gain[k, HIGHEST])
        _highest(top, mu, pattern, past, trail, reach, task, row, depth, r, steps, gain)
        for k in range(steps):
            above = gain[k, REACHED] - mu
            gain[k, MASS] += row[r, 0] * above
            gain[k, HIGHEST] = max(gain[k, HIGHEST], gain[k, REACHED])
            if i >= to - from_:
                gain[k, OTHERS] += row[r, 0] * max(gain[k, BEST], slope * above)
    for k in range(steps):
        highest = gain[k, HIGHEST]
        gain[k, INFORMATION] = gain[k, CAPACITY] = 0.0
        if highest > mu and total > 0.0:
            share = gain[k, MASS] / ((highest - mu) * total)
            gain[k, CAPACITY] = _two_points(mu, highest, 1.0)
            gain[k, INFORMATION] = min(total * _two_points(mu, highest, share), gain[k, OTHERS])


@_kernel
def _least_future(gain, column, mass, skip, steps, cost, gamma):
    """sum_k gamma^(k-1) max(0, cost - gains of steps skip+1 .. skip+k), the gains times `mass`."""
    result, discount = 0.0, 1.0
    for k in range(skip, steps):
        cost -= mass * gain[k, column]
        if cost <= 0.0:
            break
        result += discount * cost
        discount *= gamma
    return result


@_kernel
def _order(table, order, gain, depth, count, steps, gamma):
    """Lower bounds on Q of every action at `depth`, and the actions by them, lowest first."""
    for a in range(count):
        cost = table[depth, SILENT, a] + table[depth, PRESS, a]
        bound = cost
        if steps > 1:
            bound += gamma * _least_future(gain[depth], INFORMATION, 1.0, 1, steps, cost, gamma)
        table[depth, BOUND, a] = bound
        at = a
        while at > 0 and table[depth, BOUND, order[depth, at - 1]] > bound:
            order[depth, at] = order[depth, at - 1]
            at -= 1
        order[depth, at] = a


@_kernel
def _push(real, whole, depth, start, stop, steps, since, cost, cutoff):
    """Begin the search of the rows [start, stop) at `depth`: exact below `cutoff`."""
    real[depth, COST], real[depth, CUTOFF], real[depth, SLACK] = cost, cutoff, 0.0
    whole[depth, START], whole[depth, STOP], whole[depth, STEPS] = start, stop, steps
    whole[depth, SINCE], whole[depth, PHASE] = since, ENTER


@_kernel
def search(
    top, mu, rest_steps, first, count, successor, pattern, reach, past,
    task, row, trail, table, exact, order, group, gain, real, whole,
    rows, steps, since, cost, slack, gamma,
):  # fmt: skip
    """Q_steps of every action at trail[0] for the first `rows` rows, whose own C is `cost`.

    Into table[0, BOUND] and exact: Q, or a lower bound on it; exact for every action within
    `slack` of the least. Returns the number of nodes visited, or -1 where the rows did not fit.
    """
    depth, nodes, value = 0, 0, 0.0
    _push(real, whole, 0, 0, rows, steps, since, cost, np.inf)
    real[0, SLACK] = slack
    while depth >= 0:
        start, stop, steps = whole[depth, START], whole[depth, STOP], whole[depth, STEPS]
        node, resting = trail[depth], whole[depth, SINCE] < rest_steps
        if whole[depth, PHASE] == ENTER:
            _gains(top, mu, pattern, past, trail, reach, task, row, depth, start, stop, steps, gain[depth])
            value = _least_future(gain[depth], INFORMATION, 1.0, 0, steps, real[depth, COST], gamma)
            if value >= real[depth, CUTOFF]:
                depth -= 1
                continue
            nodes += 1
            _one_step(
                top, mu, first, count, successor, pattern, past, trail, task, row, depth, start, stop,
                resting, group, table,
            )  # fmt: skip
            _order(table, order, gain, depth, count[node], steps, gamma)
            whole[depth, AT], real[depth, LEAST] = 0, np.inf
            for a in range(count[node]):
                exact[depth, a] = steps == 1
        elif whole[depth, PHASE] == AFTER_SILENT and value < real[depth, ROOM] - real[depth, LEAST_PRESS]:
            real[depth, VALUE] = value
            whole[depth, PHASE] = AFTER_PRESS
            action = order[depth, whole[depth, AT]]
            _push(
                real, whole, depth + 1, stop, whole[depth, PRESS_STOP], steps - 1, 0,
                table[depth, PRESS, action], real[depth, ROOM] - value,
            )  # fmt: skip
            depth += 1
            continue
        else:
            action = order[depth, whole[depth, AT]]
            if whole[depth, PHASE] == AFTER_SILENT:
                value += real[depth, LEAST_PRESS]
            else:
                exact[depth, action] = value < real[depth, ROOM] - real[depth, VALUE]
                value += real[depth, VALUE]
            cost = table[depth, SILENT, action] + table[depth, PRESS, action]
            table[depth, BOUND, action] = cost + gamma * value
            if exact[depth, action]:
                real[depth, LEAST] = min(real[depth, LEAST], cost + gamma * value)
            whole[depth, AT] += 1
        at = whole[depth, AT]
        limit = min(real[depth, LEAST] + real[depth, SLACK], real[depth, CUTOFF])
        if steps == 1 or at == count[node] or table[depth, BOUND, order[depth, at]] >= limit:
            value = table[depth, BOUND, : count[node]].min()
            depth -= 1
            continue
        action = order[depth, at]
        trail[depth + 1] = successor[first[node] + action]
        press_stop, silent_start = _children(
            top, mu, pattern, past, trail, task, row, depth, start, stop, resting
        )
        if press_stop < 0:
            return -1
        silent, press = table[depth, SILENT, action], table[depth, PRESS, action]
        mass = table[depth, PRESSED, action]
        real[depth, ROOM] = (limit - silent - press) / gamma
        real[depth, LEAST_PRESS] = _least_future(gain[depth], CAPACITY, mass, 1, steps, press, gamma)
        whole[depth, PRESS_STOP], whole[depth, PHASE] = press_stop, AFTER_SILENT
        _push(
            real, whole, depth + 1, silent_start, silent_start + stop - start, steps - 1,
            whole[depth, SINCE] + 1, silent, real[depth, ROOM] - real[depth, LEAST_PRESS],
        )  # fmt: skip
        depth += 1
    return nodes


def run(
    belief: Belief, graph: WorldGraph, root: int, horizon: int, slack: float, gamma: float, capacity: int
) -> tuple[Floats, NDArray[np.bool_], int]:
    """`search` from a belief: bounds by action, which of them are exact, nodes (-1: rows did not fit)."""
    p: Parameters = belief.parameters
    states, rows = len(p.peak), len(belief.task)
    first = p.part_late * p.dt
    last = p.dt - first
    top = np.column_stack(
        [
            p.peak,
            last / p.rise,
            last / p.fall,
            first / p.rise,
            first / p.fall,
            first,
            last,
            p.steps_late,
            p.decay,
            p.hold,
        ]
    )
    decays = bool(np.isfinite(p.decay).any())
    capacity = max(capacity, rows * (states + 3))
    task = np.zeros(capacity, dtype=np.int64)
    row = np.zeros((capacity, 1 + states * (1 + decays)))
    task[:rows], row[:rows, 0], row[:rows, 1 : 1 + states] = belief.task, belief.weight, belief.level
    if decays:
        row[:rows, 1 + states :] = belief.on_time
    bits = (1 << np.arange(states)).astype(np.uint16)[None, :, None]
    past = np.where(belief.seen, bits, np.uint16(0)).sum(axis=1).astype(np.uint16)
    most = int(graph.count.max())
    table = np.zeros((horizon, 4, most))
    exact = np.zeros((horizon, most), dtype=np.bool_)
    nodes = search(
        top, p.mistake, p.rest_steps, graph.first, graph.count, graph.successor, graph.pattern, graph.reach, past,
        task, row, np.full(horizon + 1, root), table, exact, np.zeros((horizon, most), dtype=np.int64),
        np.zeros((len(belief.world.tasks) + 1, 9)), np.zeros((horizon, horizon, 7)),
        np.zeros((horizon, 7)), np.zeros((horizon, 8), dtype=np.int64),
        rows, horizon, belief.since_press, belief.entropy(), slack, gamma,
    )  # fmt: skip
    count = int(graph.count[root])
    return table[0, BOUND, :count], exact[0, :count], int(nodes)
