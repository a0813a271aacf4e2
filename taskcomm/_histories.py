# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""What one task does along a history of patterns and presses, compiled, each history worked out once.

Given the task, the teacher's memory follows from the patterns that the robot shows and from when she
presses, whatever the other tasks see. So the rows (memory, weight) of a task belong to a *history*, and a
measure over (task, memory) is a history for each task; the many paths of a search share few of them.
Weights are relative to the task's at the root, so that tasks with equal memories there share their
histories too.

A step that shows a pattern to history h of weight W presses with weight P and says

    press: P        apart: P ln P + (W - P) ln (W - P) - W ln W

where P is a sum over the approvals of terms that depend on whether the step shows their cue, worked out
once for a history. Most histories are looked at for their next step only, which needs no rows of their own:
with p_r the probability of a press for row r of the history before, p_rm that of M = m, p'_rm that of M = m
in the step after it, p''_rm that after the reset, the weight of M = m in that step is

    after no press: sum_r w_r (1 - p_r) p'_rm
    after a press:  sum_r w_r (p_r p'_rm + p_rm (p''_rm - p'_rm))
"""

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
    LIKELY,
    M_LN_M,
    MASS,
    ON_PRESS,
    PEAK,
    SHOWN,
    SINCE,
    SLOTS,
    TASK,
    UP,
    USED_HISTORIES,
    USED_ROWS,
    USED_STEPS,
    WEIGHT,
)
from taskcomm._entropy import called, compiled, fused, xlogx


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
def new_history(histories):
    """The number of a new history, without rows or steps; 0 where there is no room."""
    used = histories.used
    if used[USED_HISTORIES] >= len(histories.of):
        used[FULL] = 1
        return 0
    h = used[USED_HISTORIES]
    used[USED_HISTORIES] += 1
    histories.of[h, BEGIN] = histories.of[h, END] = -1
    for slot in range(SLOTS):
        histories.edge[h, slot] = 0
    return h


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
def likely(teacher, histories, h):
    """The weights of the approvals in the next step of history h, from its rows."""
    has = histories.has[h]
    for m in range(len(teacher.top)):
        off = on = 0.0
        for r in range(histories.of[h, BEGIN], histories.of[h, END]):
            off += histories.row[r, WEIGHT] * histories.ahead[r, m, 0, 1]
            on += histories.row[r, WEIGHT] * histories.ahead[r, m, 1, 1]
        has[LIKELY + 2 * m], has[LIKELY + 2 * m + 1] = off, on


@compiled
def _likely_rowless(teacher, histories, k):
    """The same from the rows of the history before.

    Only for teachers whose memory is the levels, which follow what is shown at once (`plain`).
    """
    h, what, after_press = (
        histories.of[k, BEFORE],
        histories.of[k, SHOWN],
        histories.of[k, BRANCH] == ON_PRESS,
    )
    states, has = len(teacher.top), histories.has[k]
    has[LIKELY : LIKELY + 2 * states] = 0.0
    if histories.of[k, SINCE] < teacher.rest_steps:
        return
    for r in range(histories.of[h, BEGIN], histories.of[h, END]):
        weight, pressed = histories.row[r, WEIGHT], teacher.mu
        for m in range(states):
            pressed += histories.ahead[r, m, what >> m & 1, 1]
        weighed = weight * pressed if after_press else weight * (1.0 - pressed)
        for m in range(states):
            ahead, peak, up = histories.ahead[r, m, what >> m & 1], teacher.top[m, PEAK], teacher.top[m, UP]
            reset = weight * ahead[1] if after_press else 0.0
            has[LIKELY + 2 * m] += (weighed - reset) * peak * max(0.0, ahead[0] - teacher.top[m, DOWN])
            has[LIKELY + 2 * m + 1] += peak * (
                (weighed - reset) * min(1.0, ahead[0] + up) + reset * min(1.0, up)
            )


@called
def _work_out(teacher, histories, h, what):
    """The step of history h that shows `what`, which it had not; 0 where there is no room."""
    used = histories.used
    if h == 0 or used[USED_STEPS] >= len(histories.step):
        used[FULL] = 1
        return 0
    s, slot, has = used[USED_STEPS], what & (SLOTS - 1), histories.has[h]
    used[USED_STEPS] += 1
    press = teacher.mu * has[MASS]
    for m in range(len(teacher.top)):
        press += has[LIKELY + 2 * m + (what >> m & 1)]
    step = histories.step[s]
    step["press"], step["apart"] = press, xlogx(press) + xlogx(has[MASS] - press) - has[M_LN_M]
    step["shown"], step["next"] = what, histories.edge[h, slot]
    step["silently"] = step["on_press"] = 0
    histories.edge[h, slot] = s
    return s


@fused
def step_of(teacher, histories, h, what):
    """The number of the step of history h that shows the pattern `what`."""
    s = histories.edge[h, np.uint32(what & (SLOTS - 1))]
    while s != 0 and histories.step[s]["shown"] != what:
        s = histories.step[s]["next"]
    if s == 0:
        s = np.uint32(_work_out(teacher, histories, np.int64(h), np.int64(what)))
    return s


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


@called
def _go_on(teacher, path, histories, h, s, branch):
    """The history after step s of h, which it had not; 0 where there is no room."""
    if s == 0 or (histories.of[h, BEGIN] < 0 and not fill(teacher, path, histories, h)):
        return 0
    k = new_history(histories)
    if k == 0:
        return 0
    of, before, press = histories.of[k], histories.of[h], histories.step[s]["press"]
    of[BEFORE], of[SHOWN], of[DEPTH], of[TASK] = (
        h,
        histories.step[s]["shown"],
        before[DEPTH] + 1,
        before[TASK],
    )
    of[BRANCH], of[SINCE] = branch, 0 if branch == ON_PRESS else before[SINCE] + 1
    mass = press if branch == ON_PRESS else histories.has[h, MASS] - press
    histories.has[k, MASS], histories.has[k, M_LN_M] = mass, xlogx(mass)
    if teacher.plain:
        _likely_rowless(teacher, histories, k)
    elif fill(teacher, path, histories, k):
        likely(teacher, histories, k)
    else:
        return 0
    if branch == ON_PRESS:
        histories.step[s]["on_press"] = k
    else:
        histories.step[s]["silently"] = k
    return k


@fused
def history_after(teacher, path, histories, h, s, branch):
    """The history after step s of history h, without a press or with one (`branch`: SILENTLY, ON_PRESS)."""
    k = histories.step[s]["on_press"] if branch == ON_PRESS else histories.step[s]["silently"]
    if k == 0:
        k = np.uint32(_go_on(teacher, path, histories, np.int64(h), np.int64(s), branch))
    return k
