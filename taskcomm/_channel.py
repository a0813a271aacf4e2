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
(`once`, and `kept` for the second step), found by its lowest bits and held to be right by its key. Few
tasks see after one action what they do not see after another (`changed`): only they are summed again.
"""

import numpy as np

from taskcomm._arrays import (
    APART,
    DECAY,
    DOWN,
    FIRST,
    FIRST_DOWN,
    FIRST_UP,
    GROUPS,
    HOLD,
    KEY,
    LAST,
    LATE,
    LEVEL,
    LIKELY,
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
    W_LN_W,
    WEIGHT,
    YES,
)
from taskcomm._entropy import called, compiled, fused, log, xlogx
from taskcomm._rows import seen


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
    """Number the tasks of the rows, from 0; how many there are."""
    groups, at = 0, start
    notes.heads[depth, :] = 0
    while at < stop:
        t = rows.task[at]
        notes.tasks[depth, groups], notes.begins[depth, groups], notes.group[depth, t] = t, at, groups
        notes.heads[depth, t >> 6] |= np.uint64(1) << np.uint64(t & 63)
        at += 1
        while at < stop and rows.task[at] == rows.task[at - 1]:
            at += 1
        groups += 1
    notes.begins[depth, groups] = stop
    return groups


@fused
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
    silent, scale = mass - press, log(mass) if mass > 0.0 else 0.0
    no, yes = xlogx(silent), xlogx(press)
    notes.once[depth, g, at, SILENT], notes.once[depth, g, at, PRESSED] = silent, press
    notes.once[depth, g, at, W_LN_W + SILENT], notes.once[depth, g, at, W_LN_W + PRESSED] = no, yes
    notes.once[depth, g, at, YES], notes.once[depth, g, at, NO] = yes - press * scale, no - silent * scale


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


@fused
def first_told(notes, depth, groups, total):
    """What the step that shows `shown` tells, and the mass of its press branch."""
    press, apart = 0.0, 0.0
    for g in range(groups):
        at = notes.shown[g] & (ONCE - 1)
        press += notes.once[depth, g, at, PRESSED]
        apart += notes.once[depth, g, at, YES] + notes.once[depth, g, at, NO]
    return max(0.0, apart - xlogx(press / total) * total - xlogx(1.0 - press / total) * total), press


@fused
def _then(teacher, notes, branch, depth, g, stamp, then):
    """Where `kept` has a press of task g in the second step that shows it `then`."""
    what = notes.shown[g]
    slot, key = (what * 5 + then) & (TWICE - 1), (stamp << 32) | (what << 16) | then
    if np.float64(notes.kept[branch, g, slot, KEY]).view(np.int64) != key:
        at = what & (ONCE - 1)
        weight = notes.once[depth, g, at, branch]
        likely = teacher.mu * weight
        for m in range((notes.once.shape[3] - NEXT) // 4):
            likely += notes.once[depth, g, at, NEXT + 4 * m + 2 * (then >> m & 1) + branch]
        notes.kept[branch, g, slot, LIKELY] = likely
        notes.kept[branch, g, slot, APART] = (
            notes.once[depth, g, at, W_LN_W + branch] - xlogx(likely) - xlogx(weight - likely)
        )
        notes.kept[branch, g, slot, KEY] = np.int64(key).view(np.float64)
    return slot


@compiled
def lowest(bits):
    """The number of the lowest bit that is set."""
    low = bits & (~bits + np.uint64(1))
    return (np.float64(low).view(np.int64) >> 52) - 1023  # the exponent of a power of 2


@fused
def _told(mass, press, apart):
    """What a step tells for which `press` of the mass presses, less what remains for the tasks apart."""
    return xlogx(mass) - xlogx(press) - xlogx(mass - press) - apart


@called
def most_told(teacher, graph, notes, frames, branch, node, depth, mass):
    """The most that a step from `node` tells after one that showed `shown`; `branch` is 1 after a press.

    `mass` is the weight of that branch.
    """
    if mass <= 0.0:
        return 0.0
    groups, stamp = frames.whole[depth, GROUPS], frames.whole[depth, STAMP]
    begin, press, apart = graph.first[node], 0.0, 0.0
    for g in range(groups):
        then = np.int64(graph.pattern[graph.successor[begin], notes.tasks[depth, g]])
        slot = _then(teacher, notes, branch, depth, g, stamp, then)
        one, other = notes.kept[branch, g, slot, LIKELY], notes.kept[branch, g, slot, APART]
        notes.usual[g, 0], notes.usual[g, 1] = one, other
        press, apart = press + one, apart + other
    most = max(0.0, _told(mass, press, apart))
    for c in range(begin + 1, begin + graph.choices[node]):
        child, more, further = graph.successor[c], press, apart
        for word in range(graph.changed.shape[1]):
            left = graph.changed[c, word] & notes.heads[depth, word]
            while left != 0:
                t = (word << 6) + lowest(left)
                left &= left - np.uint64(1)
                g = notes.group[depth, t]
                slot = _then(teacher, notes, branch, depth, g, stamp, np.int64(graph.pattern[child, t]))
                more += notes.kept[branch, g, slot, LIKELY] - notes.usual[g, 0]
                further += notes.kept[branch, g, slot, APART] - notes.usual[g, 1]
        if more != press or further != apart:
            most = max(most, _told(mass, more, further))
    return most


@compiled
def silent_owns(rows, notes, depth, groups, at):
    """Give the tasks of the branch without a press, whose rows begin `at`, their `own`; C of the other."""
    mass, cost = 0.0, 0.0
    for g in range(groups):
        slot, begin = notes.shown[g] & (ONCE - 1), notes.begins[depth, g]
        press, own = notes.once[depth, g, slot, PRESSED], rows.row[begin, OWN]
        share = press / (press + notes.once[depth, g, slot, SILENT]) if press > 0.0 else 0.0
        mass, cost = mass + press, cost - (share * own + notes.once[depth, g, slot, YES])
        rows.row[at + begin - notes.begins[depth, 0], OWN] = (
            (1.0 - share) * own + notes.once[depth, g, slot, NO]
        )  # fmt: skip
    return max(0.0, xlogx(mass) + cost)


@compiled
def press_owns(rows, notes, depth, groups, at, stop):
    """Give the tasks of the branch with a press, whose rows are [at, stop), their `own`."""
    for g in range(groups):
        slot, begin = notes.shown[g] & (ONCE - 1), notes.begins[depth, g]
        press, t = notes.once[depth, g, slot, PRESSED], rows.task[begin]
        share = press / (press + notes.once[depth, g, slot, SILENT]) if press > 0.0 else 0.0
        rows.row[at, OWN] = share * rows.row[begin, OWN] + notes.once[depth, g, slot, YES]
        while at < stop and rows.task[at] == t:
            at += 1
