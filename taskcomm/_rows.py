# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""The rows (memory, weight) of a task along a history of patterns and presses, compiled."""

import numpy as np

from taskcomm._arrays import (
    BEFORE,
    BEGIN,
    BRANCH,
    DECAY,
    DEPTH,
    DOWN,
    END,
    FIRST,
    FIRST_DOWN,
    FIRST_UP,
    FULL,
    HIGHEST_SECOND,
    HOLD,
    LAST,
    LATE,
    LEVEL,
    ON_PRESS,
    PEAK,
    SHOWN,
    SINCE,
    TASK,
    UP,
    USED_ROWS,
    WEIGHT,
)
from taskcomm._entropy import called, compiled


@compiled
def seen(path, histories, h, depth):
    """The pattern that history h showed at `depth`, at most its own; at most 0: before the search."""
    if depth < 1:
        return path.past[len(path.past) - 1 + depth, histories.of[h, TASK]]
    while histories.of[h, DEPTH] > depth:
        h = histories.of[h, BEFORE]
    return np.uint16(histories.of[h, SHOWN])


@compiled
def _look_ahead(teacher, path, histories, h):
    """Where a step from history h takes every row's approvals, with the cue shown off or on.

    Where the cue is seen a step or more late, what is shown now changes nothing, and both are what h says.
    """
    states, depth = len(teacher.top), histories.of[h, DEPTH]
    decays = histories.row.shape[1] > LEVEL + states
    resting = histories.of[h, SINCE] < teacher.rest_steps
    highest = 0.0
    for r in range(histories.of[h, BEGIN], histories.of[h, END]):
        second = teacher.mu
        for m in range(states):
            lag, bit = int(teacher.top[m, LATE]), 1 << m
            rise, fall, peak = teacher.top[m, UP], teacher.top[m, DOWN], teacher.top[m, PEAK]
            level, on_time = histories.row[r, LEVEL + m], 0.0
            second += peak * min(1.0, level + 2.0 * (rise + teacher.top[m, FIRST_UP]))
            if resting:
                peak = 0.0
            if decays:
                on_time = histories.row[r, LEVEL + states + m]
            if teacher.top[m, FIRST] > 0.0:
                if seen(path, histories, h, depth - lag) & bit != 0:
                    level = min(1.0, level + teacher.top[m, FIRST_UP])
                    on_time += teacher.top[m, FIRST]
                else:
                    level, on_time = max(0.0, level - teacher.top[m, FIRST_DOWN]), 0.0
            up, down, fresh = min(1.0, level + rise), max(0.0, level - fall), 1.0
            if decays:
                on_time += teacher.top[m, LAST]
                if on_time > teacher.top[m, HOLD]:
                    fresh = np.exp(-(on_time - teacher.top[m, HOLD]) / teacher.top[m, DECAY])
            off, on = 0, 1
            if lag > 0:
                off = on = 1 if seen(path, histories, h, depth + 1 - lag) & bit != 0 else 0
            for shown in range(2):
                ahead = histories.ahead[r, m, shown]
                if (on if shown == 1 else off) == 1:
                    ahead[0], ahead[1], ahead[2] = up, peak * up * fresh, on_time
                else:
                    ahead[0], ahead[1], ahead[2] = down, peak * down, 0.0
        highest = max(highest, second)
    histories.has[h, HIGHEST_SECOND] = highest


@compiled
def begun(histories, h, rows):
    """Give history h room for so many rows; whether there is any."""
    used = histories.used
    if used[USED_ROWS] + rows > len(histories.row):
        used[FULL] = 1
        return False
    histories.of[h, BEGIN] = used[USED_ROWS]
    histories.owner[used[USED_ROWS]] = h
    return True


@compiled
def ended(teacher, path, histories, h, end):
    """History h has its rows, up to `end`."""
    histories.of[h, END] = end
    histories.used[USED_ROWS] = end
    _look_ahead(teacher, path, histories, h)


@compiled
def _silent_rows(teacher, histories, h, k, what):
    """The rows of history k: those of h after a step that shows `what`, without a press."""
    states, at = len(teacher.top), histories.of[k, BEGIN]
    decays = histories.row.shape[1] > LEVEL + states
    for r in range(histories.of[h, BEGIN], histories.of[h, END]):
        pressed = teacher.mu
        for m in range(states):
            ahead = histories.ahead[r, m, what >> m & 1]
            histories.row[at, LEVEL + m] = ahead[0]
            pressed += ahead[1]
            if decays:
                histories.row[at, LEVEL + states + m] = ahead[2]
        histories.row[at, WEIGHT] = histories.row[r, WEIGHT] * (1.0 - pressed)
        at += 1
    return at


@compiled
def _press_rows(teacher, histories, h, k, what):
    """The rows of history k: those of h after a step that shows `what`, with a press.

    One row becomes one for a mistake and one for each reset that is possible.
    """
    states, at = len(teacher.top), histories.of[k, BEGIN]
    decays = histories.row.shape[1] > LEVEL + states
    for r in range(histories.of[h, BEGIN], histories.of[h, END]):
        for reset in range(-1, states):  # a mistake, then the resets
            probability = teacher.mu if reset < 0 else histories.ahead[r, reset, what >> reset & 1, 1]
            if probability <= 0.0:
                continue
            for m in range(states):
                ahead = histories.ahead[r, m, what >> m & 1]
                histories.row[at, LEVEL + m] = 0.0 if m == reset else ahead[0]
                if decays:
                    histories.row[at, LEVEL + states + m] = 0.0 if m == reset else ahead[2]
            histories.row[at, WEIGHT] = histories.row[r, WEIGHT] * probability
            at += 1
    return at


@called
def fill(teacher, path, histories, k):
    """Give history k, which has none, its rows; whether there was room."""
    h, what, branch = histories.of[k, BEFORE], histories.of[k, SHOWN], histories.of[k, BRANCH]
    rows = histories.of[h, END] - histories.of[h, BEGIN]
    if not begun(histories, k, rows * (len(teacher.top) + 1) if branch == ON_PRESS else rows):
        return False
    if branch == ON_PRESS:
        end = _press_rows(teacher, histories, h, k, what)
    else:
        end = _silent_rows(teacher, histories, h, k, what)
    ended(teacher, path, histories, k, end)
    return True
