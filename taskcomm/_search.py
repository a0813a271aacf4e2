# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""The exact closed-loop tree search, compiled: arrays in, arrays out, no balls.

The law is Q_h of MODEL.md, section 6, on unnormalised measures: with w the weights of the rows
(task, memory), W_theta their sums by task and W the total, the cost is total weight times entropy:

    C(w) = W ln W - sum_theta W_theta ln W_theta
    V_h(w) = min_a [ C(w_a0) + C(w_a1) + gamma (V_{h-1}(w_a0) + V_{h-1}(w_a1)) ]

with w_a0, w_a1 the measures after action a without and with a press. Branch and bound keeps it
exact: only what cannot change the result is left out. The last two steps are closed forms (`_channel`);
before them, those two steps in closed form and bounds on what the others can tell (`_bounds`) say which
actions are worth searching, the most promising first, press branches last. Rows are in `_rows`.

One frame of the explicit stack (one per depth) is a row of `real` and of `whole`, and of `table`, `order`
and `exact` by action.
"""

import numpy as np

from taskcomm._actions import bounds_on, first_steps, last_two, least_of
from taskcomm._arrays import (
    AT,
    BOUND,
    CAPACITY,
    COST,
    CUTOFF,
    EXPECTED,
    GROUPS,
    INFORMATION,
    LEAST,
    LEAST_PRESS,
    OWN,
    PHASE,
    PRESS,
    PRESSED,
    PRESSES,
    ROOM,
    SINCE,
    SLACK,
    STAMP,
    START,
    STEPS,
    STOP,
    TOLD,
    VALUE,
    WEIGHT,
)
from taskcomm._bounds import gains, least_future
from taskcomm._channel import lay_out, most_told, press_owns, second_step, show, silent_owns
from taskcomm._entropy import compiled, xlogx
from taskcomm._rows import look_ahead, merge, press_branch, silent_branch

FULL, RULED_OUT, BEGUN = range(3)  # what came of a descent
ENTER, AFTER_SILENT, AFTER_PRESS = range(3)  # phases


@compiled
def _push(frames, depth, start, stop, steps, since, cost, cutoff):
    """Begin the search of the rows [start, stop) at `depth`: exact below `cutoff`."""
    frames.real[depth, COST], frames.real[depth, CUTOFF], frames.real[depth, SLACK] = cost, cutoff, 0.0
    frames.whole[depth, START], frames.whole[depth, STOP], frames.whole[depth, STEPS] = start, stop, steps
    frames.whole[depth, SINCE], frames.whole[depth, PHASE] = since, ENTER


@compiled
def _enter(teacher, graph, path, rows, notes, frames, depth, gamma):
    """Bound Q of every action of the frame at `depth`, or find it where two steps are left.

    Returns the nodes visited: none where the frame's value cannot be below its cutoff.
    """
    table, exact, real, whole = frames.table, frames.exact, frames.real, frames.whole
    node, steps, start = path.trail[depth], whole[depth, STEPS], whole[depth, START]
    stop = merge(graph, path, rows, graph.slot[node, steps], depth, start, whole[depth, STOP])
    whole[depth, STOP], whole[depth, AT], real[depth, LEAST] = stop, 0, np.inf
    if steps > 2:
        gains(teacher, graph, path, rows, frames, depth, start, stop, steps)
        real[depth, VALUE] = least_future(frames, depth, INFORMATION, 1.0, 0, steps, real[depth, COST], gamma)
        if real[depth, VALUE] >= real[depth, CUTOFF]:
            return 0
    resting = whole[depth, SINCE] < teacher.rest_steps
    look_ahead(teacher, graph, path, rows, depth, start, stop, resting)
    if steps > 1:
        resting = whole[depth, SINCE] + 1 < teacher.rest_steps
        second_step(teacher, graph, path, rows, depth, start, stop, resting)
    whole[depth, GROUPS] = lay_out(rows, notes, start, stop, depth)
    whole[-1, STAMP] += 1
    whole[depth, STAMP] = whole[-1, STAMP]
    total = first_steps(teacher, graph, rows, notes, frames, node, depth)
    if steps == 2:
        return 1 + last_two(teacher, graph, rows, notes, frames, node, depth, total, gamma)
    if steps > 2:
        bounds_on(teacher, graph, rows, notes, frames, node, depth, steps, total, gamma)
        return 1
    for a in range(graph.choices[node]):
        table[depth, BOUND, a], exact[depth, a] = table[depth, EXPECTED, a], True
    return 1


@compiled
def _descend(teacher, graph, path, rows, notes, frames, depth, action, limit, gamma):
    """Begin the search of the branch of `action` without a press: FULL where its rows may not fit, RULED_OUT
    where what the branch with a press can tell next leaves the action nothing below `limit`, else BEGUN.
    """
    table, real, whole = frames.table, frames.real, frames.whole
    start, stop, steps = whole[depth, START], whole[depth, STOP], whole[depth, STEPS]
    child = graph.successor[graph.first[path.trail[depth]] + action]
    expected, mass = table[depth, EXPECTED, action], table[depth, PRESSES, action]
    show(teacher, graph, rows, notes, frames, child, depth)
    told = most_told(teacher, graph, notes, frames, PRESSED, child, depth, mass)
    bound = least_of(frames, depth, action, table[depth, TOLD, action] + told, steps, gamma)
    table[depth, BOUND, action] = max(table[depth, BOUND, action], bound)
    if bound >= limit:
        return RULED_OUT
    if stop + (stop - start) * (len(teacher.top) + 1) > len(rows.task):
        return FULL
    silent_branch(teacher, graph, rows, child, start, stop)
    press = silent_owns(rows, notes, depth, whole[depth, GROUPS], stop)
    later = max(0.0, press - told)
    rest = least_future(frames, depth, CAPACITY, mass, 2, steps, later, gamma)
    real[depth, PRESS], real[depth, ROOM] = press, (limit - expected) / gamma
    real[depth, LEAST_PRESS] = later + gamma * rest
    path.trail[depth + 1], whole[depth, PHASE] = child, AFTER_SILENT
    silent, room = max(0.0, expected - press), real[depth, ROOM] - real[depth, LEAST_PRESS]
    _push(frames, depth + 1, stop, stop + stop - start, steps - 1, whole[depth, SINCE] + 1, silent, room)
    return BEGUN


@compiled
def _descend_pressed(teacher, graph, path, rows, notes, frames, depth, silent):
    """Begin the search of the branch with a press, in the rows of that without, which is worth `silent`."""
    real, whole, child = frames.real, frames.whole, path.trail[depth + 1]
    start, stop = whole[depth, START], whole[depth, STOP]
    end = press_branch(teacher, graph, rows, child, start, stop)
    show(teacher, graph, rows, notes, frames, child, depth)
    press_owns(rows, notes, depth, whole[depth, GROUPS], stop, end)
    real[depth, VALUE], whole[depth, PHASE] = silent, AFTER_PRESS
    room = real[depth, ROOM] - silent
    _push(frames, depth + 1, stop, end, whole[depth, STEPS] - 1, 0, real[depth, PRESS], room)


@compiled
def _settle(frames, depth, value, gamma):
    """Take note of Q of the action that was searched, `value` being that of the branch searched last."""
    table, exact, real, whole = frames.table, frames.exact, frames.real, frames.whole
    action = frames.order[depth, whole[depth, AT]]
    if whole[depth, PHASE] == AFTER_SILENT:
        value += real[depth, LEAST_PRESS]
    else:
        exact[depth, action] = value < real[depth, ROOM] - real[depth, VALUE]
        value += real[depth, VALUE]
    value = table[depth, EXPECTED, action] + gamma * value
    if exact[depth, action]:
        table[depth, BOUND, action] = value
        real[depth, LEAST] = min(real[depth, LEAST], value)
    else:
        table[depth, BOUND, action] = max(table[depth, BOUND, action], value)
    whole[depth, AT] += 1


@compiled
def _value(frames, depth, actions):
    """The least Q of a frame's actions, or a lower bound on it."""
    least = np.inf
    for a in range(actions):
        least = min(least, frames.table[depth, BOUND, a])
    return least


@compiled
def _next(teacher, graph, path, rows, notes, frames, depth, gamma):
    """Begin the search of the next action that may lie below what counts; RULED_OUT where there is none."""
    table, real, whole = frames.table, frames.real, frames.whole
    actions = graph.choices[path.trail[depth]] if whole[depth, STEPS] > 2 else 0
    limit = min(real[depth, LEAST] + real[depth, SLACK], real[depth, CUTOFF])
    while whole[depth, AT] < actions:
        action = frames.order[depth, whole[depth, AT]]
        if table[depth, BOUND, action] < limit:
            outcome = _descend(teacher, graph, path, rows, notes, frames, depth, action, limit, gamma)
            if outcome != RULED_OUT:
                return outcome
        whole[depth, AT] += 1
    return RULED_OUT


@compiled
def search(
    teacher, graph, path, rows, notes, frames, number, steps, since, cost, slack, gamma, resume, budget
):
    """Q_steps of every action at trail[0] for the first `number` rows, whose own C is `cost`.

    Into table[0, BOUND] and exact: Q, or a lower bound on it; exact for every action within
    `slack` of the least. Stops after `budget` nodes, and goes on from there if called again with the same
    arrays and the depth it returned as `resume` (at first -1); what stands in the table is right at any time.
    Returns the number of nodes visited, or -1 where the rows did not fit, and the depth reached: -1 at
    the end.
    """
    real, whole = frames.real, frames.whole
    depth, nodes, value = max(resume, 0), 0, 0.0
    if resume < 0:
        weight = 0.0
        for r in range(number - 1, -1, -1):  # the first row of a task comes last
            weight += rows.row[r, WEIGHT]
            if r == 0 or rows.task[r] != rows.task[r - 1]:
                rows.row[r, OWN], weight = xlogx(weight), 0.0
        _push(frames, 0, 0, number, steps, since, cost, np.inf)
        real[0, SLACK] = slack
    while depth >= 0:
        if whole[depth, PHASE] == ENTER:
            if nodes >= budget:
                return nodes, depth
            visited = _enter(teacher, graph, path, rows, notes, frames, depth, gamma)
            nodes += visited
            if visited == 0:
                value = real[depth, VALUE]
                depth -= 1
                continue
        elif whole[depth, PHASE] == AFTER_SILENT and value < real[depth, ROOM] - real[depth, LEAST_PRESS]:
            _descend_pressed(teacher, graph, path, rows, notes, frames, depth, value)
            depth += 1
            continue
        else:
            _settle(frames, depth, value, gamma)
        outcome = _next(teacher, graph, path, rows, notes, frames, depth, gamma)
        if outcome == FULL:
            return -1, depth
        if outcome == BEGUN:
            depth += 1
            continue
        value = _value(frames, depth, graph.choices[path.trail[depth]])
        depth -= 1
    return nodes, -1
