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
    BEST,
    CAPACITY,
    DOWN,
    FIRST,
    FIRST_DOWN,
    FIRST_UP,
    HIGHEST,
    INFORMATION,
    LATE,
    LEVEL,
    OTHERS,
    PEAK,
    REACHED,
    UP,
    WEIGHT,
)
from taskcomm._entropy import compiled, divergence, h2
from taskcomm._rows import seen


@compiled
def _highest(teacher, graph, path, rows, frames, before, r, steps, depth):
    """The highest P(press) of a row 1 to `steps` steps on, into gain[depth, :, REACHED].

    The lesser of two bounds: each level as if its cue were on wherever it may be (`reach`,
    those of the `before` steps still to be seen late first); all levels together by what one
    path through the world can add (`climb`), and what is seen late of the past.
    """
    node, now, late = path.trail[depth], teacher.mu, 0.0
    for k in range(steps):
        frames.gain[depth, k, REACHED] = teacher.mu
    for m in range(len(teacher.top)):
        level, bit, lag = rows.row[r, LEVEL + m], 1 << m, int(teacher.top[m, LATE])
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
            frames.gain[depth, k, REACHED], now + late + graph.climb[graph.slot[node, k + 1], rows.task[r]]
        )


@compiled
def two_points(teacher, highest, share):
    """Information of a channel between mu and `highest`, at most `share` of the mass at the latter."""
    low, high = h2(teacher.mu), h2(highest)
    optimum = 1.0 / (1.0 + np.exp((high - low) / (highest - teacher.mu)))
    share = min(share, (optimum - teacher.mu) / (highest - teacher.mu))
    return max(0.0, h2(teacher.mu + share * (highest - teacher.mu)) - (1.0 - share) * low - share * high)


@compiled
def _best_task(rows, start, stop):
    """Where the rows of the heaviest task begin, and the total weight."""
    total, most, best, at = 0.0, -1.0, start, start
    while at < stop:
        begin, weight = at, 0.0
        while at < stop and rows.task[at] == rows.task[begin]:
            weight += rows.row[at, WEIGHT]
            at += 1
        total += weight
        if weight > most:
            most, best = weight, begin
    return best, total


@compiled
def gains(teacher, graph, path, rows, frames, depth, start, stop, steps):
    """The most that each of the next `steps` steps can tell, in nats, for the rows [start, stop).

    gain[:, INFORMATION] is for these rows, gain[:, CAPACITY] for a unit of any mass among them.
    """
    node, before = path.trail[depth], len(path.past) - 1
    ceiling = teacher.mu + teacher.top[:, PEAK].sum()
    slope = divergence(ceiling, teacher.mu) / (ceiling - teacher.mu) if ceiling > teacher.mu else 0.0
    best, total = _best_task(rows, start, stop)
    for k in range(steps):
        frames.gain[depth, k, HIGHEST] = teacher.mu
        frames.gain[depth, k, ALL] = frames.gain[depth, k, OTHERS] = frames.gain[depth, k, BEST] = 0.0
    for others in range(2):  # the best task comes first: the others' bound needs it
        r = start if others else best
        while r < stop and (others or rows.task[r] == rows.task[best]):
            if others and rows.task[r] == rows.task[best]:
                r += 1
                continue
            if r in (start, best) or rows.task[r] != rows.task[r - 1]:
                for k in range(before):
                    frames.window[k] = seen(graph, path, depth + 1 + k - before, rows.task[r])
                for k in range(steps):
                    frames.window[before + k] = graph.reach[graph.slot[node, k + 1], rows.task[r]]
            _highest(teacher, graph, path, rows, frames, before, r, steps, depth)
            for k in range(steps):
                above = frames.gain[depth, k, REACHED] - teacher.mu
                frames.gain[depth, k, ALL] += rows.row[r, WEIGHT] * above
                frames.gain[depth, k, HIGHEST] = max(
                    frames.gain[depth, k, HIGHEST], frames.gain[depth, k, REACHED]
                )
                if others:
                    frames.gain[depth, k, OTHERS] += rows.row[r, WEIGHT] * max(
                        frames.gain[depth, k, BEST], slope * above
                    )
            r += 1
        for k in range(steps):
            frames.gain[depth, k, BEST] = divergence(teacher.mu, frames.gain[depth, k, HIGHEST])
    for k in range(steps):
        highest = frames.gain[depth, k, HIGHEST]
        frames.gain[depth, k, INFORMATION] = frames.gain[depth, k, CAPACITY] = 0.0
        if highest > teacher.mu and total > 0.0:
            share = frames.gain[depth, k, ALL] / ((highest - teacher.mu) * total)
            frames.gain[depth, k, CAPACITY] = two_points(teacher, highest, 1.0)
            frames.gain[depth, k, INFORMATION] = min(
                total * two_points(teacher, highest, share), frames.gain[depth, k, OTHERS]
            )


@compiled
def second_capacity(teacher, rows, start, stop):
    """The most that the second step can tell for a unit of any mass among the rows [start, stop).

    Where there is decay, a reset may raise P(M = m): its on-time begins anew.
    """
    highest, resets = teacher.mu, 2 if rows.row.shape[1] > LEVEL + len(teacher.top) else 1
    for r in range(start, stop):
        top = teacher.mu
        for m in range(len(teacher.top)):
            most = 0.0
            for reset in range(resets):
                most = max(
                    most,
                    max(rows.second[r, m, 0, 0, reset], rows.second[r, m, 0, 1, reset]),
                    max(rows.second[r, m, 1, 0, reset], rows.second[r, m, 1, 1, reset]),
                )
            top += most
        highest = max(highest, top)
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
