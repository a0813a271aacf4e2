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
    DEPTH,
    DOWN,
    END,
    FULL,
    LIKELY,
    M_LN_M,
    MASS,
    NOTHING,
    ON_PRESS,
    PEAK,
    SHOWN,
    SINCE,
    SLOTS,
    TASK,
    UP,
    USED_HISTORIES,
    USED_STEPS,
    WEIGHT,
)
from taskcomm._entropy import called, compiled, fused, xlogx
from taskcomm._rows import fill


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
        histories.shown[h * SLOTS + slot] = NOTHING
    return h


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


@compiled
def _work_out(teacher, histories, h, s, what):
    """Make s the step of history h that shows `what`."""
    has, press = histories.has[h], teacher.mu * histories.has[h, MASS]
    for m in range(len(teacher.top)):
        press += has[LIKELY + 2 * m + (what >> m & 1)]
    step, link = histories.step[s], histories.link[s]
    step["press"], step["apart"] = press, xlogx(press) + xlogx(has[MASS] - press) - has[M_LN_M]
    link["next"] = link["silently"] = link["on_press"] = 0
    histories.shown[s] = what


@called
def _found(teacher, histories, h, s, what):
    """The step of history h that shows `what`, which its first one, s, does not; 0 where there is no room."""
    used = histories.used
    while histories.shown[s] != NOTHING:
        following = np.int64(histories.link[s]["next"])
        if following == 0:
            if used[USED_STEPS] >= len(histories.step):
                used[FULL] = 1
                return 0
            following = used[USED_STEPS]
            used[USED_STEPS] += 1
            histories.link[s]["next"], histories.shown[following] = following, NOTHING
        s = following
        if histories.shown[s] == what:
            return s
    if h == 0:
        used[FULL] = 1
        return 0
    _work_out(teacher, histories, h, s, what)
    return s


@fused
def step_of(teacher, histories, h, what):
    """The number of the step of history h that shows the pattern `what`."""
    s = np.uint64(h) * np.uint64(SLOTS) + (np.uint64(what) & np.uint64(SLOTS - 1))
    if histories.shown[s] != what:
        s = np.uint64(_found(teacher, histories, np.int64(h), np.int64(s), np.int64(what)))
    return s


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
        histories.shown[s],
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
        histories.link[s]["on_press"] = k
    else:
        histories.link[s]["silently"] = k
    return k


@fused
def history_after(teacher, path, histories, h, s, branch):
    """The history after step s of history h, without a press or with one (`branch`: SILENTLY, ON_PRESS)."""
    k = histories.link[s]["on_press"] if branch == ON_PRESS else histories.link[s]["silently"]
    if k == 0:
        k = np.uint32(_go_on(teacher, path, histories, np.int64(h), np.int64(s), branch))
    return k
