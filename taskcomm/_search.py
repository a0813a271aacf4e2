# mypy: disable-error-code="no-untyped-def, no-untyped-call"
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

Merging. Adjacent tasks with equal memories that no step to come can tell apart become one, of their
summed weight. What they differ by stays as it is, since each task keeps `own`, at first W ln W: it is
summed where tasks merge, and a branch that takes the share s of the weight has s own + W s ln s.

Layout. `row[r]` is (weight, own, levels, on-times) and `task[r]` its task; rows of one task are
adjacent, and the first of them has the task's `own`.
`reach`, `climb` and `run` of a node and a number of steps are the rows `slot[node, steps]` of
their arrays (see `WorldGraph`).
`top[m]` holds the table-top of approval m by the columns below. `trail[d]` is the world node at
depth d, `past` the patterns shown before depth 0 and at it, newest last. Frames of the search
(one per depth) are the rows of `real` and `whole`. All kernels are in this one file since the compiler's
cache does not see changes in another.
"""

import numpy as np

from taskcomm.compiling import kernel

WEIGHT, OWN, LEVEL = range(3)  # columns of row: the levels begin at LEVEL, the on-times after them
PEAK, UP, DOWN, FIRST_UP, FIRST_DOWN, FIRST, LAST, LATE, DECAY, HOLD = range(10)  # columns of top
MASS, HIGHEST, OTHERS, BEST, INFORMATION, CAPACITY, REACHED = range(7)  # columns of gain
SILENT, PRESS, PRESSED, BOUND = range(4)  # rows of table[depth], by action
COST, CUTOFF, SLACK, LEAST, ROOM, LEAST_PRESS, VALUE = range(7)  # columns of real
START, STOP, STEPS, SINCE, AT, PHASE, PRESS_STOP = range(7)  # columns of whole
ROUNDING = 1e-13  # relative difference of weights that are equal but for rounding
ENTER, AFTER_SILENT, AFTER_PRESS = range(3)  # phases

_PART = "the planner's search"
_kernel = kernel(__name__, _PART, error_model="numpy")
_inlined = kernel(__name__, _PART, error_model="numpy", inline="always")  # called too often for a call


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


@_inlined
def _seen(pattern, past, trail, depth, task):
    """The pattern shown at `depth` of the path; at most 0: before the search."""
    if depth >= 1:
        return pattern[trail[depth], task]
    return past[len(past) - 1 + depth, task]


@_kernel
def _look_ahead(top, pattern, past, trail, task, row, ahead, depth, start, stop, resting):
    """Where a step to depth + 1 takes every row's approvals, with the cue shown off or on.

    ahead[r, m, shown] is (level, P(M = m), on-time). Where the cue is seen a step or more late, what is
    shown now changes nothing, and both are what the path says.
    """
    states = len(top)
    decays = row.shape[1] > LEVEL + states
    for m in range(states):
        lag, bit = int(top[m, LATE]), 1 << m
        for r in range(start, stop):
            level, on_time = row[r, LEVEL + m], row[r, LEVEL + states + m] if decays else 0.0
            if top[m, FIRST] > 0.0:
                if _seen(pattern, past, trail, depth - lag, task[r]) & bit != 0:
                    level, on_time = min(1.0, level + top[m, FIRST_UP]), on_time + top[m, FIRST]
                else:
                    level, on_time = max(0.0, level - top[m, FIRST_DOWN]), 0.0
            up, down = min(1.0, level + top[m, UP]), max(0.0, level - top[m, DOWN])
            on_time += top[m, LAST]
            likely = 0.0 if resting else top[m, PEAK]
            fresh = 1.0
            if decays and on_time > top[m, HOLD]:
                fresh = np.exp(-(on_time - top[m, HOLD]) / top[m, DECAY])
            off, on = 0, 1
            if lag > 0:
                off = on = 1 if _seen(pattern, past, trail, depth + 1 - lag, task[r]) & bit != 0 else 0
            for shown in range(2):
                if (on if shown == 1 else off) == 1:
                    ahead[r, m, shown, 0], ahead[r, m, shown, 1] = up, likely * up * fresh
                    ahead[r, m, shown, 2] = on_time
                else:
                    ahead[r, m, shown, 0], ahead[r, m, shown, 1] = down, likely * down
                    ahead[r, m, shown, 2] = 0.0


@_inlined
def _branches(weight, own, pressed, group, g, at):
    """Mass and `own` of one task's press branch, and `own` of the rest, into group[g, at : at + 3].

    Tasks of equal press probability share its logarithms, kept from the last call in the last row of
    `group`.
    """
    group[g, at] = group[g, at + 1] = group[g, at + 2] = 0.0
    if weight > 0.0:
        share = pressed / weight
        if share != group[-1, 0]:
            group[-1, 0], group[-1, 1], group[-1, 2] = share, _xlogx(share), _xlogx(1.0 - share)
        group[g, at] = pressed
        group[g, at + 1] = share * own + weight * group[-1, 1]
        group[g, at + 2] = (1.0 - share) * own + weight * group[-1, 2]


@_inlined
def _pressed(mu, row, ahead, begin, end, shown):
    """Weight of the press branch of the rows [begin, end) of one task, if the step shows `shown`."""
    total = 0.0
    for r in range(begin, end):
        probability = mu
        for m in range(ahead.shape[1]):
            probability += ahead[r, m, shown >> m & 1, 1]
        total += row[r, WEIGHT] * probability
    return total


@_kernel
def _one_step(mu, first, count, successor, pattern, node, task, row, ahead, start, stop, group, table):
    """C and mass of both branches of every action at `node`, into table (4, actions).

    group[g] is: where the task's rows begin, its weight and `own`; what the first action shows for it,
    `_branches` of that; what another action shows for it, `_branches` of that. What actions show alike is
    counted once. The last row of `group` is for `_branches`.
    """
    base = successor[first[node]]
    group[-1, 0] = -1.0
    groups, at = 0, start
    press, silent, mass, total = 0.0, 0.0, 0.0, 0.0
    while at < stop:
        begin, weight = at, 0.0
        while at < stop and task[at] == task[begin]:
            weight += row[at, WEIGHT]
            at += 1
        shown, own = pattern[base, task[begin]], row[begin, OWN]
        group[groups, 0], group[groups, 1], group[groups, 2] = begin, weight, own
        group[groups, 3], group[groups, 7] = shown, -1.0
        _branches(weight, own, _pressed(mu, row, ahead, begin, at, shown), group, groups, 4)
        total += weight
        mass, press, silent = mass + group[groups, 4], press + group[groups, 5], silent + group[groups, 6]
        groups += 1
    group[groups, 0] = stop
    for a in range(count[node]):
        child = successor[first[node] + a]
        child_mass, child_press, child_silent = mass, press, silent
        for g in range(groups):
            begin = int(group[g, 0])
            shown = pattern[child, task[begin]]
            if shown != group[g, 3]:
                if shown != group[g, 7]:
                    pressed = _pressed(mu, row, ahead, begin, int(group[g + 1, 0]), shown)
                    group[g, 7] = shown
                    _branches(group[g, 1], group[g, 2], pressed, group, g, 8)
                child_mass += group[g, 8] - group[g, 4]
                child_press += group[g, 9] - group[g, 5]
                child_silent += group[g, 10] - group[g, 6]
        table[PRESSED, a] = child_mass
        table[PRESS, a] = max(0.0, _xlogx(child_mass) - child_press)
        table[SILENT, a] = max(0.0, _xlogx(total - child_mass) - child_silent)


@_kernel
def _children(mu, pattern, node, task, row, ahead, group, start, stop):
    """Append the rows after the step to `node`: with a press from `stop` on, then without.

    Returns where the former end and the latter start; the latter are as many as the parent's. The
    press branch comes first since it is searched last, and must not be overwritten until then.
    """
    states = ahead.shape[1]
    decays = row.shape[1] > LEVEL + states
    press_stop, silent_start = stop, stop + (stop - start) * (states + 1)
    if silent_start + (stop - start) > len(task):
        return -1, -1
    g = 0
    for r in range(start, stop):
        silent, shown, approved = silent_start + r - start, pattern[node, task[r]], 0.0
        if r == group[g, 0]:
            at = 4 if shown == group[g, 3] else 8
            if at == 8 and shown != group[g, 7]:
                pressed = _pressed(mu, row, ahead, r, int(group[g + 1, 0]), shown)
                group[g, 7] = shown
                _branches(group[g, 1], group[g, 2], pressed, group, g, 8)
            row[press_stop, OWN], row[silent, OWN] = group[g, at + 1], group[g, at + 2]
            g += 1
        for m in range(states):
            row[silent, LEVEL + m] = ahead[r, m, shown >> m & 1, 0]
            if decays:
                row[silent, LEVEL + states + m] = ahead[r, m, shown >> m & 1, 2]
        for m in range(-1, states):  # a mistake, then the resets
            probability = mu if m < 0 else ahead[r, m, shown >> m & 1, 1]
            approved += probability
            if probability > 0.0:
                task[press_stop] = task[r]
                for column in range(LEVEL, row.shape[1]):
                    row[press_stop, column] = row[silent, column]
                if m >= 0:
                    row[press_stop, LEVEL + m] = 0.0
                    if decays:
                        row[press_stop, LEVEL + states + m] = 0.0
                row[press_stop, WEIGHT] = row[r, WEIGHT] * probability
                press_stop += 1
        task[silent], row[silent, WEIGHT] = task[r], row[r, WEIGHT] * (1.0 - approved)
    return press_stop, silent_start


@_kernel
def _alike(run, pattern, past, trail, task, row, depth, a, b, size):
    """Whether two tasks, the `size` rows from a and from b, can be told apart by no step to come."""
    if run[task[a]] != run[task[b]]:
        return False
    for i in range(size):
        for column in range(LEVEL, row.shape[1]):
            if row[a + i, column] != row[b + i, column]:
                return False
    for back in range(len(past) - 1):  # what is still to be seen late
        if _seen(pattern, past, trail, depth - back, task[a]) != _seen(
            pattern, past, trail, depth - back, task[b]
        ):
            return False
    if size == 1:
        return True
    weight_a, weight_b = 0.0, 0.0
    for i in range(size):
        weight_a, weight_b = weight_a + row[a + i, WEIGHT], weight_b + row[b + i, WEIGHT]
    for i in range(size):
        skew = row[a + i, WEIGHT] * weight_b - row[b + i, WEIGHT] * weight_a
        if abs(skew) > ROUNDING * weight_a * weight_b:
            return False
    return True


@_kernel
def _merge(run, pattern, past, trail, task, row, depth, start, stop):
    """Make one of adjacent tasks that are `_alike`, in place; where the rows stop then."""
    at, last, end = start, start, start  # [last, end) is the task written last
    while at < stop:
        begin = at
        while at < stop and task[at] == task[begin]:
            at += 1
        size = at - begin
        if end - last == size and _alike(run, pattern, past, trail, task, row, depth, last, begin, size):
            row[last, OWN] += row[begin, OWN]
            for i in range(size):
                row[last + i, WEIGHT] += row[begin + i, WEIGHT]
        else:
            last = end
            for r in range(begin, at):
                if r != end:
                    task[end] = task[r]
                    for column in range(row.shape[1]):
                        row[end, column] = row[r, column]
                end += 1
    return end


@_kernel
def _highest(top, mu, row, r, show, climb, slot, task, steps, gain):
    """The highest P(press) of a row 1 to `steps` steps on, into gain[:, REACHED].

    The lesser of two bounds: each level as if its cue were on wherever it may be (`show`, the
    patterns from the furthest past that is still to be seen); all levels together by what one
    path through the world can add (`climb`), and what is seen late of the past.
    """
    past = len(show) - steps  # show[past] is the step to come
    now, late = mu, 0.0
    for k in range(steps):
        gain[k, REACHED] = mu
    for m in range(len(top)):
        level, bit, lag = row[r, LEVEL + m], 1 << m, int(top[m, LATE])
        peak, up, down = top[m, PEAK], top[m, UP], top[m, DOWN]
        now += peak * level
        late += peak * (lag * (up + top[m, FIRST_UP]) + top[m, FIRST_UP])
        for k in range(steps):
            if top[m, FIRST] > 0.0:
                if show[past + k - lag - 1] & bit != 0:
                    level = min(1.0, level + top[m, FIRST_UP])
                else:
                    level = max(0.0, level - top[m, FIRST_DOWN])
            on = show[past + k - lag] & bit != 0
            level = min(1.0, level + up) if on else max(0.0, level - down)
            gain[k, REACHED] += peak * level
    for k in range(steps):
        gain[k, REACHED] = min(gain[k, REACHED], now + late + climb[slot[k + 1], task])


@_kernel
def _two_points(mu, highest, share):
    """Information of a channel between mu and `highest`, at most `share` of the mass at the latter."""
    low, high = _h2(mu), _h2(highest)
    optimum = 1.0 / (1.0 + np.exp((high - low) / (highest - mu)))
    share = min(share, (optimum - mu) / (highest - mu))
    return max(0.0, _h2(mu + share * (highest - mu)) - (1.0 - share) * low - share * high)


@_kernel
def _best_task(task, row, start, stop):
    """Where the rows of the heaviest task begin, and the total weight."""
    total, most, best, at = 0.0, -1.0, start, start
    while at < stop:
        begin, weight = at, 0.0
        while at < stop and task[at] == task[begin]:
            weight += row[at, WEIGHT]
            at += 1
        total += weight
        if weight > most:
            most, best = weight, begin
    return best, total


@_kernel
def _gains(
    top, mu, pattern, past, trail, slot, reach, climb, task, row, depth, start, stop, steps, show, gain,
):  # fmt: skip
    """The most that each of the next `steps` steps can tell, in nats, for the rows [start, stop).

    gain[:, INFORMATION] is for these rows, gain[:, CAPACITY] for a unit of any mass among them.
    """
    node, before = trail[depth], len(past) - 1
    ceiling = mu + top[:, PEAK].sum()
    slope = _divergence(ceiling, mu) / (ceiling - mu) if ceiling > mu else 0.0
    best, total = _best_task(task, row, start, stop)
    show = show[: before + steps]
    for k in range(steps):
        gain[k, MASS], gain[k, HIGHEST], gain[k, OTHERS], gain[k, BEST] = 0.0, mu, 0.0, 0.0
    for others in range(2):  # the best task comes first: the others' bound needs it
        r = start if others else best
        while r < stop and (others or task[r] == task[best]):
            if others and task[r] == task[best]:
                r += 1
                continue
            if r in (start, best) or task[r] != task[r - 1]:
                for k in range(before):
                    show[k] = _seen(pattern, past, trail, depth + 1 + k - before, task[r])
                for k in range(steps):
                    show[before + k] = reach[slot[node, k + 1], task[r]]
            _highest(top, mu, row, r, show, climb, slot[node], task[r], steps, gain)
            for k in range(steps):
                above = gain[k, REACHED] - mu
                gain[k, MASS] += row[r, WEIGHT] * above
                gain[k, HIGHEST] = max(gain[k, HIGHEST], gain[k, REACHED])
                if others:
                    gain[k, OTHERS] += row[r, WEIGHT] * max(gain[k, BEST], slope * above)
            r += 1
        for k in range(steps):
            gain[k, BEST] = _divergence(mu, gain[k, HIGHEST])
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
    top, mu, rest_steps, first, count, successor, pattern, slot, reach, climb, run, past,
    task, row, ahead, trail, table, exact, order, group, show, gain, real, whole,
    rows, steps, since, cost, slack, gamma, resume, budget,
):  # fmt: skip
    """Q_steps of every action at trail[0] for the first `rows` rows, whose own C is `cost`.

    Into table[0, BOUND] and exact: Q, or a lower bound on it; exact for every action within
    `slack` of the least. Stops after `budget` nodes, and goes on from there if called again with the same
    arrays and the depth it returned as `resume` (at first -1); what stands in the table is right at any time.
    Returns the number of nodes visited, or -1 where the rows did not fit, and the depth reached: -1 at
    the end.
    """
    depth, nodes, value = max(resume, 0), 0, 0.0
    if resume < 0:
        weight = 0.0
        for r in range(rows - 1, -1, -1):  # the first row of a task comes last
            weight += row[r, WEIGHT]
            if r == 0 or task[r] != task[r - 1]:
                row[r, OWN], weight = _xlogx(weight), 0.0
        _push(real, whole, 0, 0, rows, steps, since, cost, np.inf)
        real[0, SLACK] = slack
    while depth >= 0:
        start, stop, steps = whole[depth, START], whole[depth, STOP], whole[depth, STEPS]
        node, resting = trail[depth], whole[depth, SINCE] < rest_steps
        if whole[depth, PHASE] == ENTER:
            if nodes >= budget:
                return nodes, depth
            stop = _merge(run[slot[node, steps]], pattern, past, trail, task, row, depth, start, stop)
            whole[depth, STOP] = stop
            if steps > 1:
                _gains(
                    top, mu, pattern, past, trail, slot, reach, climb, task, row, depth, start, stop, steps,
                    show, gain[depth],
                )  # fmt: skip
                value = _least_future(gain[depth], INFORMATION, 1.0, 0, steps, real[depth, COST], gamma)
                if value >= real[depth, CUTOFF]:
                    depth -= 1
                    continue
            nodes += 1
            _look_ahead(top, pattern, past, trail, task, row, ahead, depth, start, stop, resting)
            _one_step(
                mu,
                first,
                count,
                successor,
                pattern,
                node,
                task,
                row,
                ahead,
                start,
                stop,
                group[depth],
                table[depth],
            )
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
            mu, pattern, trail[depth + 1], task, row, ahead, group[depth], start, stop
        )
        if press_stop < 0:
            return -1, depth
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
    return nodes, -1
