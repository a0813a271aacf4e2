# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""How much the coming steps can tell at most, compiled.

A step lowers the expected entropy by no more than its information about the rows. The press
probability of a row lies in [mu, top], top what its levels reach if its cues come on as early as
the world graph allows. Information is convex in each of these probabilities, so with
B = sum_rows w (top_row - mu) it is at most that of a channel with the two points mu and the
highest top, used with mean mu + B / W or at its capacity if that comes first. It is also at most
the sum of w KL(row || best task) over the rows of all tasks but the best, which is small once the
belief is peaked. Both are linear in w for a fixed output distribution, and so hold for the
expectation over all that may be observed until then.
"""

import numpy as np

from taskcomm._arrays import (
    ALL,
    BEGIN,
    BEST,
    CAPACITY,
    DOWN,
    END,
    FIRST,
    FIRST_DOWN,
    FIRST_UP,
    HIGHEST,
    HIGHEST_SECOND,
    INFORMATION,
    LATE,
    LEVEL,
    MASS,
    OTHERS,
    PEAK,
    REACHED,
    UP,
    WEIGHT,
)
from taskcomm._entropy import compiled, divergence, h2
from taskcomm._rows import seen


@compiled
def _highest(teacher, graph, histories, frames, node, task, before, r, steps, depth):
    """The highest P(press) of a row 1 to `steps` steps on, into gain[depth, :, REACHED].

    The lesser of two bounds: each level as if its cue were on wherever it may be (`reach`,
    those of the `before` steps still to be seen late first); all levels together by what one
    path through the world can add (`climb`), and what is seen late of the past.
    """
    now, late = teacher.mu, 0.0
    for k in range(steps):
        frames.gain[depth, k, REACHED] = teacher.mu
    for m in range(len(teacher.top)):
        level, bit, lag = histories.row[r, LEVEL + m], 1 << m, int(teacher.top[m, LATE])
        peak, up, down = teacher.top[m, PEAK], teacher.top[m, UP], teacher.top[m, DOWN]
        now += peak * level
        late += peak * (lag * (up + teacher.top[m, FIRST_UP]) + teacher.top[m, FIRST_UP])
        for k in range(steps):
            if teacher.top[m, FIRST] > 0.0:
                if frames.window[before + k - lag - 1] & bit != 0:
                    level = min(1.0, level + teacher.top[m, FIRST_UP])
                else:
                    level = max(0.0, level - teacher.top[m, FIRST_DOWN])
            on = frames.window[before + k - lag] & bit != 0
            level = min(1.0, level + up) if on else max(0.0, level - down)
            frames.gain[depth, k, REACHED] += peak * level
    for k in range(steps):
        frames.gain[depth, k, REACHED] = min(
            frames.gain[depth, k, REACHED], now + late + graph.climb[graph.slot[node, k + 1], task]
        )


@compiled
def two_points(teacher, highest, share):
    """Information of a channel between mu and `highest`, at most `share` of the mass at the latter."""
    low, high = h2(teacher.mu), h2(highest)
    optimum = 1.0 / (1.0 + np.exp((high - low) / (highest - teacher.mu)))
    share = min(share, (optimum - teacher.mu) / (highest - teacher.mu))
    return max(0.0, h2(teacher.mu + share * (highest - teacher.mu)) - (1.0 - share) * low - share * high)


@compiled
def _heaviest(histories, groups, depth, number):
    """The group of the greatest weight."""
    most, best = -1.0, 0
    for g in range(number):
        weight = groups.weight[depth, g] * histories.has[groups.history[depth, g], MASS]
        if weight > most:
            most, best = weight, g
    return best


@compiled
def _reached(teacher, graph, path, histories, groups, frames, depth, g, steps, others):
    """Take the rows of group g into the gains; `others` where it is not the heaviest."""
    node, before = path.trail[depth], len(path.past) - 1
    task, history, weight = groups.task[depth, g], groups.history[depth, g], groups.weight[depth, g]
    ceiling = teacher.mu + teacher.top[:, PEAK].sum()
    slope = divergence(ceiling, teacher.mu) / (ceiling - teacher.mu) if ceiling > teacher.mu else 0.0
    for k in range(before):
        frames.window[k] = seen(path, histories, history, depth + 1 + k - before)
    for k in range(steps):
        frames.window[before + k] = graph.reach[graph.slot[node, k + 1], task]
    gain = frames.gain[depth]
    for r in range(histories.of[history, BEGIN], histories.of[history, END]):
        _highest(teacher, graph, histories, frames, node, task, before, r, steps, depth)
        heavy = weight * histories.row[r, WEIGHT]
        for k in range(steps):
            above = gain[k, REACHED] - teacher.mu
            gain[k, ALL] += heavy * above
            gain[k, HIGHEST] = max(gain[k, HIGHEST], gain[k, REACHED])
            if others:
                gain[k, OTHERS] += heavy * max(gain[k, BEST], slope * above)


@compiled
def gains(teacher, graph, path, histories, groups, frames, depth, number, total, steps):
    """The most that each of the next `steps` steps can tell, in nats, for the groups at `depth`, `total` in
    all.

    gain[:, INFORMATION] is for these groups, gain[:, CAPACITY] for a unit of any mass among them.
    """
    gain, best = frames.gain[depth], _heaviest(histories, groups, depth, number)
    for k in range(steps):
        gain[k, HIGHEST] = teacher.mu
        gain[k, ALL] = gain[k, OTHERS] = gain[k, BEST] = 0.0
    _reached(teacher, graph, path, histories, groups, frames, depth, best, steps, False)
    for k in range(steps):
        gain[k, BEST] = divergence(teacher.mu, gain[k, HIGHEST])
    for g in range(number):
        if g != best:
            _reached(teacher, graph, path, histories, groups, frames, depth, g, steps, True)
    for k in range(steps):
        highest = gain[k, HIGHEST]
        gain[k, INFORMATION] = gain[k, CAPACITY] = 0.0
        if highest > teacher.mu and total > 0.0:
            share = gain[k, ALL] / ((highest - teacher.mu) * total)
            gain[k, CAPACITY] = two_points(teacher, highest, 1.0)
            gain[k, INFORMATION] = min(total * two_points(teacher, highest, share), gain[k, OTHERS])


@compiled
def second_capacity(teacher, histories, groups, depth, number):
    """The most that the second step can tell for a unit of any mass among the groups at `depth`."""
    highest = teacher.mu
    for g in range(number):
        highest = max(highest, histories.has[groups.history[depth, g], HIGHEST_SECOND])
    return two_points(teacher, highest, 1.0) if highest > teacher.mu else 0.0


@compiled
def least_future(frames, depth, column, mass, skip, steps, cost, gamma):
    """sum_k gamma^(k-1) max(0, cost - gains of steps skip+1 .. skip+k), the gains times `mass`."""
    result, discount = 0.0, 1.0
    for k in range(skip, steps):
        cost -= mass * frames.gain[depth, k, column]
        if cost <= 0.0:
            break
        result += discount * cost
        discount *= gamma
    return result
