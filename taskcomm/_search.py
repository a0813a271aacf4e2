# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""The exact closed-loop tree search, compiled: arrays in, arrays out, no balls.

The law is Q_h of MODEL.md, section 6, on unnormalised measures: with w the weights of
(task, memory), W_theta their sums by task and W the total, the cost is total weight times entropy:

    C(w) = W ln W - sum_theta W_theta ln W_theta
    V_h(w) = min_a [ C(w_a0) + C(w_a1) + gamma (V_{h-1}(w_a0) + V_{h-1}(w_a1)) ]

with w_a0, w_a1 the measures after action a without and with a press. Branch and bound keeps it
exact: only what cannot change the result is left out. The last two steps are closed forms (`_channel`);
before them, those two steps in closed form and bounds on what the others can tell (`_bounds`) say which
actions are worth searching, the most promising first, press branches last. What single tasks do is worked out
once for all frames (`_histories`).

One frame of the explicit stack (one per depth) is a row of `real` and of `whole`, and of `table`, `order`
and `exact` by action.
"""

import numpy as np

from taskcomm._actions import bounds_on, first_steps, last_two, least_of, pressed, second_told
from taskcomm._arrays import (
    AT,
    BOUND,
    CAME,
    CAPACITY,
    COST,
    CUTOFF,
    EXPECTED,
    FULL,
    GROUPS,
    INFORMATION,
    LEAST,
    LEAST_PRESS,
    ON_PRESS,
    PHASE,
    PRESS,
    PRESSES,
    ROOM,
    SILENTLY,
    SLACK,
    STEPS,
    TOLD,
    VALUE,
)
from taskcomm._bounds import gains, least_future
from taskcomm._channel import cost_of_press, descend, go_on, lay_out, merge, show
from taskcomm._entropy import compiled, entry
from taskcomm._roots import crowded, forget, plant

ENTER, AFTER_SILENT, AFTER_PRESS = range(3)  # phases


@compiled
def _push(frames, depth, steps, cost, cutoff, row):
    """Begin the search of the groups at `depth`: exact below `cutoff`.

    What its actions do is in that row of the `channel` of the depth before (the root's: will be, of its own).
    """
    frames.real[depth, COST], frames.real[depth, CUTOFF], frames.real[depth, SLACK] = cost, cutoff, 0.0
    frames.whole[depth, STEPS], frames.whole[depth, PHASE], frames.whole[depth, CAME] = steps, ENTER, row


@compiled
def _enter(teacher, graph, path, histories, groups, frames, depth, gamma):
    """Bound Q of every action of the frame at `depth`, or find it where two steps are left.

    Returns the nodes visited: none where the frame's value cannot be below its cutoff.
    """
    table, exact, real, whole = frames.table, frames.exact, frames.real, frames.whole
    node, steps = path.trail[depth], whole[depth, STEPS]
    number = merge(graph, histories, groups, graph.slot[node, steps], depth, whole[depth, GROUPS])
    whole[depth, GROUPS], whole[depth, AT], real[depth, LEAST] = number, 0, np.inf
    total = lay_out(teacher, path, histories, groups, depth, number)
    if steps > 2:
        gains(teacher, graph, path, histories, groups, frames, depth, number, total, steps)
        real[depth, VALUE] = least_future(frames, depth, INFORMATION, 1.0, 0, steps, real[depth, COST], gamma)
        if real[depth, VALUE] >= real[depth, CUTOFF]:
            return 0
    first_steps(teacher, graph, histories, groups, frames, node, depth, total)
    if steps == 2:
        return 1 + last_two(teacher, graph, path, histories, groups, frames, node, depth, total, gamma)
    if steps > 2:
        bounds_on(teacher, graph, path, histories, groups, frames, node, depth, steps, total, gamma)
        return 1
    for a in range(graph.choices[node]):
        table[depth, BOUND, a], exact[depth, a] = table[depth, EXPECTED, a], True
    return 1


@compiled
def _descend(teacher, graph, path, histories, groups, frames, depth, action, limit, gamma):
    """Begin the search of the branch of `action` without a press, and say whether it was begun.

    It is not where what the branch with a press can tell next leaves the action nothing below `limit`.
    """
    table, real, whole = frames.table, frames.real, frames.whole
    steps = whole[depth, STEPS]
    child = graph.successor[graph.first[path.trail[depth]] + action]
    expected, mass = table[depth, EXPECTED, action], table[depth, PRESSES, action]
    row = pressed(groups)
    show(teacher, graph, histories, groups, frames, child, depth)
    told = second_told(teacher, graph, path, histories, groups, frames, ON_PRESS, child, depth, mass, row)
    bound = least_of(frames, depth, action, table[depth, TOLD, action] + told, steps, gamma)
    table[depth, BOUND, action] = max(table[depth, BOUND, action], bound)
    if bound >= limit:
        return False
    press = cost_of_press(histories, groups, frames, depth)
    go_on(teacher, path, histories, groups, frames, depth, SILENTLY)
    descend(groups, frames, depth)
    later = max(0.0, press - told)
    rest = least_future(frames, depth, CAPACITY, mass, 2, steps, later, gamma)
    real[depth, PRESS], real[depth, ROOM] = press, (limit - expected) / gamma
    real[depth, LEAST_PRESS] = later + gamma * rest
    path.trail[depth + 1], whole[depth, PHASE] = child, AFTER_SILENT
    silent, room = max(0.0, expected - press), real[depth, ROOM] - real[depth, LEAST_PRESS]
    _push(frames, depth + 1, steps - 1, silent, room, action)
    return True


@compiled
def _descend_pressed(teacher, graph, path, histories, groups, frames, depth, silent):
    """Begin the search of the branch with a press, after that without, which is worth `silent`."""
    real, whole, child = frames.real, frames.whole, path.trail[depth + 1]
    show(teacher, graph, histories, groups, frames, child, depth)
    go_on(teacher, path, histories, groups, frames, depth, ON_PRESS)
    descend(groups, frames, depth)
    real[depth, VALUE], whole[depth, PHASE] = silent, AFTER_PRESS
    room = real[depth, ROOM] - silent
    _push(frames, depth + 1, whole[depth, STEPS] - 1, real[depth, PRESS], room, pressed(groups))


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
def _next(teacher, graph, path, histories, groups, frames, depth, gamma):
    """Begin the search of the next action that may lie below what counts; whether there is one."""
    table, real, whole = frames.table, frames.real, frames.whole
    actions = graph.choices[path.trail[depth]] if whole[depth, STEPS] > 2 else 0
    limit = min(real[depth, LEAST] + real[depth, SLACK], real[depth, CUTOFF])
    while whole[depth, AT] < actions:
        action = frames.order[depth, whole[depth, AT]]
        if table[depth, BOUND, action] < limit and _descend(
            teacher, graph, path, histories, groups, frames, depth, action, limit, gamma
        ):
            return True
        whole[depth, AT] += 1
    return False


@entry
def search(
    teacher,
    graph,
    path,
    given,
    histories,
    groups,
    frames,
    steps,
    since,
    cost,
    slack,
    gamma,
    resume,
    budget,
):
    """Q_steps of every action at trail[0] for the belief `given`, whose own C is `cost`.

    Into table[0, BOUND] and exact: Q, or a lower bound on it; exact for every action within
    `slack` of the least. Stops after `budget` nodes, and goes on from there if called again with the same
    arrays and the depth it returned as `resume` (at first -1); what stands in the table is right at any time.
    Returns the number of nodes visited, or -1 where the histories did not fit, and the depth reached: -1 at
    the end.
    """
    real, whole = frames.real, frames.whole
    depth, nodes, value = max(resume, 0), 0, 0.0
    if resume < 0:
        whole[0, GROUPS] = plant(teacher, path, histories, groups, given, since)
        _push(frames, 0, steps, cost, np.inf, pressed(groups))
        real[0, SLACK] = slack
    while depth >= 0:
        if whole[depth, PHASE] == ENTER:
            if nodes >= budget:
                return nodes, depth
            if crowded(histories):
                forget(teacher, path, histories, groups, whole[:, GROUPS], depth)
            visited = _enter(teacher, graph, path, histories, groups, frames, depth, gamma)
            nodes += visited
            if visited == 0:
                value = real[depth, VALUE]
                depth -= 1
                continue
        elif whole[depth, PHASE] == AFTER_SILENT and value < real[depth, ROOM] - real[depth, LEAST_PRESS]:
            _descend_pressed(teacher, graph, path, histories, groups, frames, depth, value)
            depth += 1
            continue
        else:
            _settle(frames, depth, value, gamma)
        begun = _next(teacher, graph, path, histories, groups, frames, depth, gamma)
        if histories.used[FULL] != 0:
            return -1, depth
        if begun:
            depth += 1
            continue
        value = _value(frames, depth, graph.choices[path.trail[depth]])
        depth -= 1
    return nodes, -1
