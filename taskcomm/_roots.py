# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Where the histories of a search begin, and how those are forgotten that it no longer needs, compiled."""

import numpy as np

from taskcomm._arrays import (
    BEFORE,
    BEGIN,
    DEPTH,
    END,
    KEPT_HISTORIES,
    KEPT_ROWS,
    LEVEL,
    M_LN_M,
    MASS,
    NOTHING,
    SHOWN,
    SINCE,
    SLOTS,
    TASK,
    USED_HISTORIES,
    USED_ROWS,
    USED_STEPS,
    WEIGHT,
)
from taskcomm._entropy import called, compiled, xlogx
from taskcomm._histories import likely, new_history
from taskcomm._rows import begun, ended, fill

ROUNDING = 1e-13  # difference of shares that are equal but for rounding


@compiled
def _begins_as(path, histories, given, k, begin, size, weight):
    """Whether the task of the `size` rows from `begin` on has the memory and past of history k, a root."""
    at, task = histories.of[k, BEGIN], histories.of[k, TASK]
    if histories.of[k, END] - at != size:
        return False
    for back in range(len(path.past)):  # what is still to be seen late
        if path.past[back, task] != path.past[back, given.task[begin]]:
            return False
    for i in range(size):
        if abs(histories.row[at + i, WEIGHT] - given.row[begin + i, WEIGHT] / weight) > ROUNDING:
            return False
        for column in range(LEVEL, given.row.shape[1]):
            if histories.row[at + i, column] != given.row[begin + i, column]:
                return False
    return True


@compiled
def _rooted(teacher, path, histories, given, begin, size, weight, since):
    """The history of a task at the root, the rows [begin, begin + size) of the weight `weight`."""
    h = new_history(histories)
    if h == 0 or not begun(histories, h, size):
        return 0
    at = histories.of[h, BEGIN]
    for i in range(size):
        histories.row[at + i, WEIGHT] = given.row[begin + i, WEIGHT] / weight
        for column in range(LEVEL, given.row.shape[1]):
            histories.row[at + i, column] = given.row[begin + i, column]
    of = histories.of[h]
    of[BEFORE], of[SHOWN], of[DEPTH], of[SINCE], of[TASK] = 0, 0, 0, since, given.task[begin]
    histories.has[h, MASS], histories.has[h, M_LN_M] = 1.0, 0.0
    ended(teacher, path, histories, h, at + size)
    likely(teacher, histories, h)
    return h


@called
def plant(teacher, path, histories, groups, given, since):
    """Begin with the given belief: a group for each task that has any weight; how many they are.

    Number 0 of histories and steps is laid out too.
    """
    used, number, at, end = histories.used, 0, 0, len(given.task)
    used[:] = 0
    used[USED_HISTORIES] = used[KEPT_HISTORIES] = 1
    used[USED_STEPS] = SLOTS * len(histories.of)
    histories.shown[:SLOTS], histories.of[0, :], histories.has[0, :] = NOTHING, 0, 0.0
    step, link = histories.step[0], histories.link[0]
    step["press"] = step["apart"] = 0.0
    link["next"] = link["silently"] = link["on_press"] = 0
    while at < end:
        begin, weight = at, 0.0
        while at < end and given.task[at] == given.task[begin]:
            weight += given.row[at, WEIGHT]
            at += 1
        if not weight > 0.0:
            continue
        groups.task[0, number] = given.task[begin]
        groups.weight[0, number], groups.own[0, number] = weight, xlogx(weight)
        h, size = 0, at - begin
        for k in range(1, used[USED_HISTORIES]):
            if _begins_as(path, histories, given, k, begin, size, weight):
                h = k
                break
        if h == 0:
            h = _rooted(teacher, path, histories, given, begin, size, weight, since)
        groups.history[0, number] = h
        number += 1
    return number


@compiled
def crowded(histories):
    """Whether more than half of what was left when histories were last forgotten is used."""
    used, first_steps = histories.used, SLOTS * len(histories.of)
    return (
        2 * used[USED_HISTORIES] > used[KEPT_HISTORIES] + len(histories.of)
        or 2 * used[USED_ROWS] > used[KEPT_ROWS] + len(histories.row)
        or 2 * (used[USED_STEPS] - first_steps) > len(histories.step) - first_steps
    )


@compiled
def _copy(source, target):
    for i in range(len(source)):
        target[i] = source[i]


@called
def forget(teacher, path, histories, groups, number, depth):
    """Forget all but the histories of the groups down to `depth`, and what those came of; and all steps."""
    used, of, renamed = histories.used, histories.of, histories.renamed
    renamed[: used[USED_HISTORIES]] = 0
    for d in range(depth + 1):
        for g in range(number[d]):
            h = groups.history[d, g]
            if of[h, BEGIN] < 0:
                fill(teacher, path, histories, np.int64(h))
            renamed[h] = 1
    at = kept = 0
    while at < used[USED_ROWS]:
        h = histories.owner[at]
        size = of[h, END] - at
        if renamed[h] != 0:
            for i in range(size):
                _copy(histories.row[at + i], histories.row[kept + i])
                for m in range(histories.ahead.shape[1]):
                    for shown in range(2):
                        _copy(histories.ahead[at + i, m, shown], histories.ahead[kept + i, m, shown])
            histories.owner[kept] = h
            of[h, BEGIN], of[h, END] = kept, kept + size
            kept += size
        else:
            of[h, BEGIN] = of[h, END] = -1
        at += size
    used[USED_ROWS] = used[KEPT_ROWS] = kept
    for h in range(used[USED_HISTORIES] - 1, 0, -1):
        if renamed[h] != 0:
            renamed[of[h, BEFORE]] = 1
    next_number = 1
    renamed[0] = 0
    for h in range(1, used[USED_HISTORIES]):
        if renamed[h] == 0:
            continue
        renamed[h] = next_number
        _copy(of[h], of[next_number])
        _copy(histories.has[h], histories.has[next_number])
        of[next_number, BEFORE] = renamed[of[h, BEFORE]]
        if of[h, BEGIN] >= 0:
            histories.owner[of[h, BEGIN]] = next_number
        for slot in range(SLOTS):
            histories.shown[next_number * SLOTS + slot] = NOTHING
        next_number += 1
    used[USED_HISTORIES] = used[KEPT_HISTORIES] = next_number
    used[USED_STEPS] = SLOTS * len(of)
    for d in range(depth + 1):
        for g in range(number[d]):
            groups.history[d, g] = renamed[groups.history[d, g]]
