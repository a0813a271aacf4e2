# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""What the next two steps tell about the task, in closed form and compiled.

A step is a channel from task to press or no press. With W_g the weight of task g, P_g that of its press
branch, W and P their totals, it tells, in nats times mass,

    told = W h2(P / W) - sum_g W_g h2(P_g / W_g)

and the expected entropy falls by that much. The second step is such a channel for each branch of the
first; what P_g is there needs no rows, since it is a sum over the approvals of terms that depend on what the
first step showed and on whether the second shows their cue:

    after no press: sum_r w_r (1 - p_r) (mu + sum_m p'_rm)
    after a press:  sum_r w_r (p_r (mu + sum_m p'_rm) + sum_m p_rm (p''_rm - p'_rm))

with p_rm = P(M = m) of row r at the first step, p_r their sum with mu, p'_rm that at the second step, p''_rm
after the reset. What a task does when a pattern is shown is worked out once at each belief and kept
(`once`, and `kept` for the second step), found by its lowest bits and held to be right by its `key`.
"""

import numpy as np

from taskcomm._arrays import (
    DECAY,
    DOWN,
    FIRST,
    FIRST_DOWN,
    FIRST_UP,
    GROUPS,
    HOLD,
    LAST,
    LATE,
    LEVEL,
    NEXT,
    NO,
    ONCE,
    OWN,
    PEAK,
    PRESSED,
    SILENT,
    STAMP,
    TWICE,
    UP,
    WEIGHT,
    YES,
)
from taskcomm._rows import compiled, seen, xlogx


@compiled
def second_step(teacher, graph, path, rows, depth, start, stop, resting):
    """P(M = m) at the second step: second[r, m, shown, then, reset].

    `shown` says whether the first step shows the cue, `then` whether the second does, `reset` whether M
    was m at the first step.
    """
    states = len(teacher.top)
    decays = rows.row.shape[1] > LEVEL + states
    for m in range(states):
        lag, bit, peak = int(teacher.top[m, LATE]), 1 << m, 0.0 if resting else teacher.top[m, PEAK]
        rise, fall, first = teacher.top[m, UP], teacher.top[m, DOWN], teacher.top[m, FIRST]
        plain, risen = lag == 0 and first == 0.0 and not decays, peak * min(1.0, rise)
        for r in range(start, stop):
            for shown in range(2):
                if plain:
                    level = rows.ahead[r, m, shown, 0]
                    rows.second[r, m, shown, 0, 0] = peak * max(0.0, level - fall)
                    rows.second[r, m, shown, 1, 0] = peak * min(1.0, level + rise)
                    rows.second[r, m, shown, 0, 1], rows.second[r, m, shown, 1, 1] = 0.0, risen
                    continue
                older = shown
                if lag > 0:
                    older = seen(graph, path, depth + 1 - lag, rows.task[r]) >> m & 1
                for reset in range(2):
                    level = on_time = 0.0
                    if reset == 0:
                        level, on_time = rows.ahead[r, m, shown, 0], rows.ahead[r, m, shown, 2]
                    if first > 0.0:
                        if older == 1:
                            level, on_time = min(1.0, level + teacher.top[m, FIRST_UP]), on_time + first
                        else:
                            level, on_time = max(0.0, level - teacher.top[m, FIRST_DOWN]), 0.0
                    up, down, fresh = min(1.0, level + rise), max(0.0, level - fall), 1.0
                    on_time += teacher.top[m, LAST]
                    if decays and on_time > teacher.top[m, HOLD]:
                        fresh = np.exp(-(on_time - teacher.top[m, HOLD]) / teacher.top[m, DECAY])
                    for then in range(2):
                        on = then
                        if lag == 1:
                            on = shown
                        elif lag > 1:
                            on = 1 if seen(graph, path, depth + 2 - lag, rows.task[r]) & bit != 0 else 0
                        rows.second[r, m, shown, then, reset] = peak * (up * fresh if on == 1 else down)


@compiled
def lay_out(rows, notes, start, stop, depth):
    """Number the tasks of the rows: tasks[depth, g] has the rows from begins[depth, g] to the next."""
    groups, at = 0, start
    while at < stop:
        notes.tasks[depth, groups], notes.begins[depth, groups] = rows.task[at], at
        at += 1
        while at < stop and rows.task[at] == rows.task[at - 1]:
            at += 1
        groups += 1
    notes.begins[depth, groups] = stop
    return groups


@compiled
def _work_out(teacher, rows, notes, depth, g, what):
    """What the rows of task g do when shown `what`."""
    at, states = what & (ONCE - 1), rows.ahead.shape[1]
    mass = press = 0.0
    for column in range(NEXT, NEXT + 4 * states):
        notes.once[depth, g, at, column] = 0.0
    for r in range(notes.begins[depth, g], notes.begins[depth, g + 1]):
        weight, pressed = rows.row[r, WEIGHT], teacher.mu
        for m in range(states):
            pressed += rows.ahead[r, m, what >> m & 1, 1]
        mass, press = mass + weight, press + weight * pressed
        for m in range(states):
            bit = what >> m & 1
            approved = rows.ahead[r, m, bit, 1]
            for then in range(2):
                column, unreset = NEXT + 4 * m + 2 * then, rows.second[r, m, bit, then, 0]
                notes.once[depth, g, at, column] += weight * (1.0 - pressed) * unreset
                if teacher.rest_steps == 0:
                    reset = rows.second[r, m, bit, then, 1]
                    notes.once[depth, g, at, column + 1] += weight * (
                        pressed * unreset + approved * (reset - unreset)
                    )
    share = press / mass if mass > 0.0 else 0.0
    notes.once[depth, g, at, SILENT], notes.once[depth, g, at, PRESSED] = mass - press, press
    notes.once[depth, g, at, YES] = mass * xlogx(share)
    notes.once[depth, g, at, NO] = mass * xlogx(1.0 - share)


@compiled
def show(teacher, graph, rows, notes, frames, node, depth):
    """Set shown[g] to what `node` shows for task g, and work out what it does then."""
    stamp = frames.whole[depth, STAMP] << 16
    for g in range(frames.whole[depth, GROUPS]):
        what = np.int64(graph.pattern[node, notes.tasks[depth, g]])
        notes.shown[g] = what
        key = stamp | what
        if notes.known[depth, g, what & (ONCE - 1)] != key:
            notes.known[depth, g, what & (ONCE - 1)] = key
            _work_out(teacher, rows, notes, depth, g, what)


@compiled
def first_told(notes, depth, groups, total):
    """What the step that shows `shown` tells, and the mass of its press branch."""
    press, apart = 0.0, 0.0
    for g in range(groups):
        at = notes.shown[g] & (ONCE - 1)
        press += notes.once[depth, g, at, PRESSED]
        apart += notes.once[depth, g, at, YES] + notes.once[depth, g, at, NO]
    return max(0.0, apart - xlogx(press / total) * total - xlogx(1.0 - press / total) * total), press


@compiled
def _then(teacher, notes, branch, depth, g, stamp, then):
    """Where `kept` has a press of task g in the second step that shows it `then`."""
    what = notes.shown[g]
    slot, key = (what * 5 + then) & (TWICE - 1), (stamp << 32) | (what << 16) | then
    if notes.key[branch, g, slot] != key:
        notes.key[branch, g, slot] = key
        at = what & (ONCE - 1)
        weight = notes.once[depth, g, at, branch]
        likely = teacher.mu * weight
        for m in range((notes.once.shape[3] - NEXT) // 4):
            likely += notes.once[depth, g, at, NEXT + 4 * m + 2 * (then >> m & 1) + branch]
        notes.kept[branch, g, slot, 0], notes.kept[branch, g, slot, 1] = likely, 0.0
        if weight > 0.0:
            share = likely / weight
            notes.kept[branch, g, slot, 1] = -weight * (xlogx(share) + xlogx(1.0 - share))
    return slot


@compiled
def most_told(teacher, graph, notes, frames, branch, node, depth):
    """The most that a step from `node` tells after one that showed `shown`; `branch` is 1 after a press.

    What the first action shows, task by task, is in `usual`; the others are told from it by what differs.
    """
    groups, stamp = frames.whole[depth, GROUPS], frames.whole[depth, STAMP]
    begin, mass, press, apart = graph.first[node], 0.0, 0.0, 0.0
    for g in range(groups):
        then = np.int64(graph.pattern[graph.successor[begin], notes.tasks[depth, g]])
        slot = _then(teacher, notes, branch, depth, g, stamp, then)
        notes.usual[g] = then
        mass += notes.once[depth, g, notes.shown[g] & (ONCE - 1), branch]
        press += notes.kept[branch, g, slot, 0]
        apart += notes.kept[branch, g, slot, 1]
    if mass <= 0.0:
        return 0.0
    most = -mass * (xlogx(press / mass) + xlogx(1.0 - press / mass)) - apart
    for c in range(begin + 1, begin + graph.choices[node]):
        child, more, further = graph.successor[c], 0.0, 0.0
        for g in range(groups):
            then = np.int64(graph.pattern[child, notes.tasks[depth, g]])
            if then != notes.usual[g]:
                slot = _then(teacher, notes, branch, depth, g, stamp, notes.usual[g])
                more -= notes.kept[branch, g, slot, 0]
                further -= notes.kept[branch, g, slot, 1]
                slot = _then(teacher, notes, branch, depth, g, stamp, then)
                more += notes.kept[branch, g, slot, 0]
                further += notes.kept[branch, g, slot, 1]
        if more != 0.0 or further != 0.0:
            share = (press + more) / mass
            most = max(most, -mass * (xlogx(share) + xlogx(1.0 - share)) - apart - further)
    return max(0.0, most)


@compiled
def owns(rows, notes, depth, groups, press_start, silent_start):
    """Give the tasks of both branches their `own`; C of the press branch."""
    mass, cost, at = 0.0, 0.0, press_start
    for g in range(groups):
        slot, begin = notes.shown[g] & (ONCE - 1), notes.begins[depth, g]
        own, press = rows.row[begin, OWN], notes.once[depth, g, slot, PRESSED]
        weight = press + notes.once[depth, g, slot, SILENT]
        share = press / weight if weight > 0.0 else 0.0
        yes = share * own + notes.once[depth, g, slot, YES]
        rows.row[at, OWN] = yes
        rows.row[silent_start + begin - notes.begins[depth, 0], OWN] = (
            (1.0 - share) * own + notes.once[depth, g, slot, NO]
        )  # fmt: skip
        mass, cost = mass + press, cost - yes
        t = rows.task[at]
        while at < silent_start and rows.task[at] == t:
            at += 1
    return max(0.0, xlogx(mass) + cost)
