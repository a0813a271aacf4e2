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
    LEVEL,
    OWN,
    PHASE,
    PRESS,
    PRESS_STOP,
    PRESSED,
    PRESSES,
    ROOM,
    SILENT,
    SINCE,
    SLACK,
    STAMP,
    START,
    STEPS,
    STOP,
    VALUE,
    WEIGHT,
)
from taskcomm._bounds import gains, least_future, two_points
from taskcomm._channel import first_told, lay_out, most_told, owns, second_step, show
from taskcomm._rows import branch, compiled, look_ahead, merge, xlogx

ENTER, AFTER_SILENT, AFTER_PRESS = range(3)  # phases


@compiled
def _place(frames, depth, a, bound):
    """Give action a its lower bound and its place among the actions before it, lowest bound first."""
    frames.table[depth, BOUND, a] = bound
    at = a
    while at > 0 and frames.table[depth, BOUND, frames.order[depth, at - 1]] > bound:
        frames.order[depth, at] = frames.order[depth, at - 1]
        at -= 1
    frames.order[depth, at] = a


@compiled
def _first_steps(teacher, graph, rows, notes, frames, node, depth):
    """C after every action at `node` and the mass of its press branch, into table; the total mass."""
    groups, cost, total = frames.whole[depth, GROUPS], frames.real[depth, COST], 0.0
    for r in range(notes.begins[depth, 0], notes.begins[depth, groups]):
        total += rows.row[r, WEIGHT]
    for a in range(graph.choices[node]):
        show(teacher, graph, rows, notes, frames, graph.successor[graph.first[node] + a], depth)
        told, frames.table[depth, PRESSES, a] = first_told(notes, depth, groups, total)
        frames.table[depth, EXPECTED, a] = max(0.0, cost - told)
    return total


@compiled
def _room(teacher, rows, start, stop):
    """The most that the second step can tell for a unit of mass.

    Where there is decay, a reset may raise P(M = m): its on-time begins anew.
    """
    highest, resets = teacher.mu, 2 if rows.row.shape[1] > LEVEL + len(teacher.top) else 1
    for r in range(start, stop):
        p = teacher.mu
        for m in range(rows.second.shape[1]):
            most = 0.0
            for reset in range(resets):
                most = max(
                    most,
                    max(rows.second[r, m, 0, 0, reset], rows.second[r, m, 0, 1, reset]),
                    max(rows.second[r, m, 1, 0, reset], rows.second[r, m, 1, 1, reset]),
                )
            p += most
        highest = max(highest, p)
    return two_points(teacher, highest, 1.0) if highest > teacher.mu else 0.0


@compiled
def _last_two(teacher, graph, rows, notes, frames, node, depth, total, gamma):
    """Q_2 of every action at `node`, or a bound where it is no less than what counts; how many were found."""
    table, exact, real, whole = frames.table, frames.exact, frames.real, frames.whole
    actions, nodes, least = graph.choices[node], 0, np.inf
    room = _room(teacher, rows, whole[depth, START], whole[depth, STOP])
    for a in range(actions):
        exact[depth, a], expected = False, table[depth, EXPECTED, a]
        _place(frames, depth, a, expected + gamma * max(0.0, expected - room * total))
    for at in range(actions):
        a = frames.order[depth, at]
        cutoff = min(least + real[depth, SLACK], real[depth, CUTOFF])
        if table[depth, BOUND, a] >= cutoff:
            break
        child = graph.successor[graph.first[node] + a]
        show(teacher, graph, rows, notes, frames, child, depth)
        expected = table[depth, EXPECTED, a]
        later = expected - most_told(teacher, graph, notes, frames, SILENT, child, depth)
        bound = expected + gamma * (later - room * table[depth, PRESSES, a])
        table[depth, BOUND, a] = max(table[depth, BOUND, a], bound)
        nodes += 1
        if table[depth, BOUND, a] < cutoff:
            later -= most_told(teacher, graph, notes, frames, PRESSED, child, depth)
            table[depth, BOUND, a], exact[depth, a] = expected + gamma * later, True
            least = min(least, table[depth, BOUND, a])
            nodes += 1
    return nodes


@compiled
def _bound(teacher, graph, rows, notes, frames, node, depth, steps, gamma):
    """Lower bounds on Q of every action at `node`, and the actions by them.

    The first step is exact, the second for the branch without a press; later ones are bounded by `gain`.
    """
    for a in range(graph.choices[node]):
        child = graph.successor[graph.first[node] + a]
        show(teacher, graph, rows, notes, frames, child, depth)
        expected = frames.table[depth, EXPECTED, a]
        told = most_told(teacher, graph, notes, frames, SILENT, child, depth)
        told += frames.table[depth, PRESSES, a] * frames.gain[depth, 1, CAPACITY]
        later = max(0.0, expected - min(told, frames.gain[depth, 1, INFORMATION]))
        rest = least_future(frames, depth, INFORMATION, 1.0, 2, steps, later, gamma)
        _place(frames, depth, a, expected + gamma * (later + gamma * rest))
        frames.exact[depth, a] = False


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
    total = _first_steps(teacher, graph, rows, notes, frames, node, depth)
    if steps == 2:
        return 1 + _last_two(teacher, graph, rows, notes, frames, node, depth, total, gamma)
    if steps > 2:
        _bound(teacher, graph, rows, notes, frames, node, depth, steps, gamma)
        return 1
    for a in range(graph.choices[node]):
        table[depth, BOUND, a], exact[depth, a] = table[depth, EXPECTED, a], True
    return 1


@compiled
def _descend(teacher, graph, path, rows, notes, frames, depth, action, limit, gamma):
    """Begin the search of the branch of `action` without a press; whether its rows fit."""
    table, real, whole = frames.table, frames.real, frames.whole
    start, stop, steps = whole[depth, START], whole[depth, STOP], whole[depth, STEPS]
    child = graph.successor[graph.first[path.trail[depth]] + action]
    press_stop, silent_start = branch(teacher, graph, rows, child, start, stop)
    if press_stop < 0:
        return False
    path.trail[depth + 1] = child
    show(teacher, graph, rows, notes, frames, child, depth)
    press = owns(rows, notes, depth, whole[depth, GROUPS], stop, silent_start)
    expected, mass = table[depth, EXPECTED, action], table[depth, PRESSES, action]
    real[depth, PRESS], real[depth, ROOM] = press, (limit - expected) / gamma
    real[depth, LEAST_PRESS] = least_future(frames, depth, CAPACITY, mass, 1, steps, press, gamma)
    whole[depth, PRESS_STOP], whole[depth, PHASE] = press_stop, AFTER_SILENT
    silent, room = max(0.0, expected - press), real[depth, ROOM] - real[depth, LEAST_PRESS]
    since = whole[depth, SINCE] + 1
    _push(frames, depth + 1, silent_start, silent_start + stop - start, steps - 1, since, silent, room)
    return True


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
    table, exact, order, real, whole = frames.table, frames.exact, frames.order, frames.real, frames.whole
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
            real[depth, VALUE], whole[depth, PHASE] = value, AFTER_PRESS
            start, stop, steps = whole[depth, STOP], whole[depth, PRESS_STOP], whole[depth, STEPS] - 1
            _push(frames, depth + 1, start, stop, steps, 0, real[depth, PRESS], real[depth, ROOM] - value)
            depth += 1
            continue
        else:
            action = order[depth, whole[depth, AT]]
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
        at, actions = whole[depth, AT], graph.choices[path.trail[depth]]
        limit = min(real[depth, LEAST] + real[depth, SLACK], real[depth, CUTOFF])
        done = whole[depth, STEPS] <= 2 or at == actions
        if done or table[depth, BOUND, order[depth, at]] >= limit:
            value = np.inf
            for a in range(actions):
                value = min(value, table[depth, BOUND, a])
            depth -= 1
            continue
        if not _descend(teacher, graph, path, rows, notes, frames, depth, order[depth, at], limit, gamma):
            return -1, depth
        depth += 1
    return nodes, -1
