# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""The rows of a measure over (task, memory), compiled: a step ahead, its two branches, tasks that are one.

Merging. Adjacent tasks with equal memories that no step to come can tell apart become one, of their
summed weight. What they differ by stays as it is, since each task keeps `own`, at first W ln W: it is
summed where tasks merge, and a branch that takes the share s of the weight has s own + W s ln s.
"""

import numpy as np

from taskcomm._arrays import (
    DECAY,
    DOWN,
    FIRST,
    FIRST_DOWN,
    FIRST_UP,
    HOLD,
    LAST,
    LATE,
    LEVEL,
    OWN,
    PEAK,
    UP,
    WEIGHT,
)
from taskcomm._entropy import compiled

ROUNDING = 1e-13  # relative difference of weights that are equal but for rounding


@compiled
def seen(graph, path, depth, t):
    """The pattern shown at `depth` of the path; at most 0: before the search."""
    if depth >= 1:
        return graph.pattern[path.trail[depth], t]
    return path.past[len(path.past) - 1 + depth, t]


@compiled
def look_ahead(teacher, graph, path, rows, depth, start, stop, resting):
    """Where a step to depth + 1 takes every row's approvals, with the cue shown off or on.

    ahead[r, m, shown] is (level, P(M = m), on-time). Where the cue is seen a step or more late, what is
    shown now changes nothing, and both are what the path says.
    """
    states = len(teacher.top)
    decays = rows.row.shape[1] > LEVEL + states
    for m in range(states):
        lag, bit = int(teacher.top[m, LATE]), 1 << m
        rise, fall, peak = teacher.top[m, UP], teacher.top[m, DOWN], 0.0 if resting else teacher.top[m, PEAK]
        for r in range(start, stop):
            level, on_time = rows.row[r, LEVEL + m], rows.row[r, LEVEL + states + m] if decays else 0.0
            if teacher.top[m, FIRST] > 0.0:
                if seen(graph, path, depth - lag, rows.task[r]) & bit != 0:
                    level, on_time = (
                        min(1.0, level + teacher.top[m, FIRST_UP]),
                        on_time + teacher.top[m, FIRST],
                    )
                else:
                    level, on_time = max(0.0, level - teacher.top[m, FIRST_DOWN]), 0.0
            up, down = min(1.0, level + rise), max(0.0, level - fall)
            fresh = 1.0
            if decays:
                on_time += teacher.top[m, LAST]
                if on_time > teacher.top[m, HOLD]:
                    fresh = np.exp(-(on_time - teacher.top[m, HOLD]) / teacher.top[m, DECAY])
            off, on = 0, 1
            if lag > 0:
                off = on = 1 if seen(graph, path, depth + 1 - lag, rows.task[r]) & bit != 0 else 0
            for shown in range(2):
                if (on if shown == 1 else off) == 1:
                    rows.ahead[r, m, shown, 0], rows.ahead[r, m, shown, 1] = up, peak * up * fresh
                    rows.ahead[r, m, shown, 2] = on_time
                else:
                    rows.ahead[r, m, shown, 0], rows.ahead[r, m, shown, 1] = down, peak * down
                    rows.ahead[r, m, shown, 2] = 0.0


@compiled
def silent_branch(teacher, graph, rows, node, start, stop):
    """Put the rows after the step to `node` without a press, as many as now, from `stop` on; `own` apart."""
    states = rows.ahead.shape[1]
    decays = rows.row.shape[1] > LEVEL + states
    for r in range(start, stop):
        at, shown, pressed = stop + r - start, int(graph.pattern[node, rows.task[r]]), teacher.mu
        for m in range(states):
            ahead = rows.ahead[r, m, shown >> m & 1]
            rows.row[at, LEVEL + m] = ahead[0]
            pressed += ahead[1]
            if decays:
                rows.row[at, LEVEL + states + m] = ahead[2]
        rows.task[at], rows.row[at, WEIGHT] = rows.task[r], rows.row[r, WEIGHT] * (1.0 - pressed)


@compiled
def press_branch(teacher, graph, rows, node, start, stop):
    """Put the rows after the step to `node` with a press from `stop` on, `own` apart; where they end.

    One row becomes one for a mistake and one for each reset that is possible.
    """
    states, at = rows.ahead.shape[1], stop
    decays = rows.row.shape[1] > LEVEL + states
    for r in range(start, stop):
        shown = int(graph.pattern[node, rows.task[r]])
        for reset in range(-1, states):  # a mistake, then the resets
            probability = teacher.mu if reset < 0 else rows.ahead[r, reset, shown >> reset & 1, 1]
            if probability <= 0.0:
                continue
            for m in range(states):
                ahead = rows.ahead[r, m, shown >> m & 1]
                rows.row[at, LEVEL + m] = 0.0 if m == reset else ahead[0]
                if decays:
                    rows.row[at, LEVEL + states + m] = 0.0 if m == reset else ahead[2]
            rows.task[at], rows.row[at, WEIGHT] = rows.task[r], rows.row[r, WEIGHT] * probability
            at += 1
    return at


@compiled
def _alike(graph, path, rows, depth, a, b, size):
    """Whether two tasks, the `size` rows from a and from b, have equal memories and pasts."""
    for i in range(size):
        for column in range(LEVEL, rows.row.shape[1]):
            if rows.row[a + i, column] != rows.row[b + i, column]:
                return False
    for back in range(len(path.past) - 1):  # what is still to be seen late
        if seen(graph, path, depth - back, rows.task[a]) != seen(graph, path, depth - back, rows.task[b]):
            return False
    if size > 1:
        weight_a, weight_b = 0.0, 0.0
        for i in range(size):
            weight_a, weight_b = weight_a + rows.row[a + i, WEIGHT], weight_b + rows.row[b + i, WEIGHT]
        for i in range(size):
            skew = rows.row[a + i, WEIGHT] * weight_b - rows.row[b + i, WEIGHT] * weight_a
            if abs(skew) > ROUNDING * weight_a * weight_b:
                return False
    return True


@compiled
def merge(graph, path, rows, outlook, depth, start, stop):
    """Make one of adjacent tasks that no step to come can tell apart, in place; where the rows stop then.

    `run[outlook]` numbers the runs of tasks that the coming steps treat alike.
    """
    at, last, end = start, start, start  # [last, end) is the task written last
    while at < stop:
        begin = at
        at += 1
        while at < stop and rows.task[at] == rows.task[begin]:
            at += 1
        size = at - begin
        if (
            end - last == size
            and graph.run[outlook, rows.task[last]] == graph.run[outlook, rows.task[begin]]
            and _alike(graph, path, rows, depth, last, begin, size)
        ):
            rows.row[last, OWN] += rows.row[begin, OWN]
            for i in range(size):
                rows.row[last + i, WEIGHT] += rows.row[begin + i, WEIGHT]
        else:
            last = end
            if begin == end:
                end = at
                continue
            for r in range(begin, at):
                rows.task[end] = rows.task[r]
                for column in range(rows.row.shape[1]):
                    rows.row[end, column] = rows.row[r, column]
                end += 1
    return end
