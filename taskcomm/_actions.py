# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""What each action at one belief costs at least, and which to search first, compiled.

The first step is exact (`_channel`), the second too where there are but two; later ones are bounded
(`_bounds`).
"""

import numpy as np

from taskcomm._arrays import (
    BOUND,
    CAPACITY,
    COST,
    CUTOFF,
    EXPECTED,
    GROUPS,
    INFORMATION,
    ON_PRESS,
    PRESSES,
    SILENTLY,
    SLACK,
    TOLD,
)
from taskcomm._bounds import least_future, second_capacity
from taskcomm._channel import channels, refer, told_after, told_by
from taskcomm._entropy import compiled
from taskcomm._twins import compare


@compiled
def _place(order, keys, a):
    """Give action a its place among the actions before it, lowest key first."""
    at = a
    while at > 0 and keys[order[at - 1]] > keys[a]:
        order[at] = order[at - 1]
        at -= 1
    order[at] = a


@compiled
def first_steps(teacher, graph, histories, groups, frames, node, depth, total):
    """C after every action at `node` and the mass of its press branch, into table."""
    table, cost = frames.table[depth], frames.real[depth, COST]
    channels(teacher, graph, histories, groups, frames, groups.history[depth], node, depth, 2)
    for a in range(graph.choices[node]):
        press = groups.channel[2, a, 0]
        table[PRESSES, a] = press
        table[EXPECTED, a] = max(0.0, cost - max(0.0, told_by(total, press, groups.channel[2, a, 1])))


@compiled
def last_two(teacher, graph, path, histories, groups, frames, twins, node, depth, total, gamma):
    """Q_2 of every action at `node`, or a bound where it is no less than what counts; how many were found."""
    table, exact, real = frames.table, frames.exact, frames.real
    actions, nodes, least, begun = graph.choices[node], 0, np.inf, False
    place = compare(graph, twins, node)
    refer(teacher, graph, path, histories, groups, frames, node, depth, SILENTLY)
    room = second_capacity(teacher, histories, groups, depth, frames.whole[depth, GROUPS])
    for a in range(actions):
        exact[depth, a], expected = False, table[depth, EXPECTED, a]
        table[depth, BOUND, a] = expected + gamma * max(0.0, expected - room * total)
        _place(frames.order[depth], table[depth, BOUND], a)
    for at in range(actions):
        a = frames.order[depth, at]
        cutoff = min(least + real[depth, SLACK], real[depth, CUTOFF])
        if table[depth, BOUND, a] >= cutoff:
            break
        expected, press = table[depth, EXPECTED, a], table[depth, PRESSES, a]
        later = expected - told_after(
            teacher, graph, path, histories, groups, twins, place, node, a, depth, SILENTLY, total - press
        )
        bound = expected + gamma * (later - room * press)
        table[depth, BOUND, a] = max(table[depth, BOUND, a], bound)
        nodes += 1
        if table[depth, BOUND, a] < cutoff:
            if not begun:
                refer(teacher, graph, path, histories, groups, frames, node, depth, ON_PRESS)
                begun = True
            later -= told_after(
                teacher, graph, path, histories, groups, twins, place, node, a, depth, ON_PRESS, press
            )
            table[depth, BOUND, a], exact[depth, a] = expected + gamma * later, True
            least = min(least, table[depth, BOUND, a])
            nodes += 1
    return nodes


@compiled
def least_of(frames, depth, a, told, steps, gamma):
    """A lower bound on Q of action a whose second step tells `told` at most, later ones what `gain` says."""
    expected = frames.table[depth, EXPECTED, a]
    later = max(0.0, expected - min(told, frames.gain[depth, 1, INFORMATION]))
    rest = least_future(frames, depth, INFORMATION, 1.0, 2, steps, later, gamma)
    return expected + gamma * (later + gamma * rest)


@compiled
def bounds_on(teacher, graph, path, histories, groups, frames, twins, node, depth, steps, total, gamma):
    """Find lower bounds on Q of every action at `node`, and put the actions in their order.

    The first step is exact, the second for the branch without a press; later ones are bounded by `gain`.
    """
    table = frames.table
    keys = frames.before if depth == 0 and frames.before[0] < np.inf else table[depth, BOUND]
    place = compare(graph, twins, node)
    refer(teacher, graph, path, histories, groups, frames, node, depth, SILENTLY)
    for a in range(graph.choices[node]):
        press = table[depth, PRESSES, a]
        told = told_after(
            teacher, graph, path, histories, groups, twins, place, node, a, depth, SILENTLY, total - press
        )
        table[depth, TOLD, a], frames.exact[depth, a] = told, False
        told += press * frames.gain[depth, 1, CAPACITY]
        table[depth, BOUND, a] = least_of(frames, depth, a, told, steps, gamma)
        _place(frames.order[depth], keys, a)
