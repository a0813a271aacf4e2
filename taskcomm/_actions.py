# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""What each action at one belief costs at least, and which to search first, compiled.

The first step is exact (`_channel`), the second too where there are but two; later ones are bounded
(`_bounds`).
"""

import numpy as np

from taskcomm._arrays import (
    BOUND,
    CAME,
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
from taskcomm._channel import channels, go_on, show, told_by, told_next
from taskcomm._entropy import compiled, xlogx


@compiled
def _place(order, keys, a):
    """Give action a its place among the actions before it, lowest key first."""
    at = a
    while at > 0 and keys[order[at - 1]] > keys[a]:
        order[at] = order[at - 1]
        at -= 1
    order[at] = a


@compiled
def pressed(groups):
    """The row of `channel` for what follows a press, and for what is not kept."""
    return groups.channel.shape[1] - 1


@compiled
def first_steps(teacher, graph, histories, groups, frames, node, depth, total):
    """C after every action at `node` and the mass of its press branch, into table.

    What they do, `told_next` has found when the step to the belief was looked at, but for the root.
    """
    table, cost, t_ln_t = frames.table[depth], frames.real[depth, COST], xlogx(total)
    channel = groups.channel[max(depth - 1, 0), frames.whole[depth, CAME]]
    if depth == 0:
        channels(teacher, graph, histories, groups, frames, groups.history[0], node, 0, channel)
    for a in range(graph.choices[node]):
        press = channel[a, 0]
        table[PRESSES, a] = press
        table[EXPECTED, a] = max(0.0, cost - max(0.0, told_by(total, t_ln_t, press, channel[a, 1])))


@compiled
def second_told(teacher, graph, path, histories, groups, frames, branch, node, depth, mass, row):
    """The most that a step from `node` tells after that to it, in the branch of the weight `mass`."""
    go_on(teacher, path, histories, groups, frames, depth, branch)
    return told_next(teacher, graph, histories, groups, frames, node, depth, mass, row)


@compiled
def last_two(teacher, graph, path, histories, groups, frames, node, depth, total, gamma):
    """Q_2 of every action at `node`, or a bound where it is no less than what counts; how many were found."""
    table, exact, real = frames.table, frames.exact, frames.real
    actions, nodes, least = graph.choices[node], 0, np.inf
    room = second_capacity(teacher, histories, groups, depth, frames.whole[depth, GROUPS])
    for a in range(actions):
        exact[depth, a], expected = False, table[depth, EXPECTED, a]
        table[depth, BOUND, a] = expected + gamma * max(0.0, expected - room * total)
        _place(frames.order[depth], table[depth, BOUND], a)
    row = pressed(groups)
    for at in range(actions):
        a = frames.order[depth, at]
        cutoff = min(least + real[depth, SLACK], real[depth, CUTOFF])
        if table[depth, BOUND, a] >= cutoff:
            break
        child = graph.successor[graph.first[node] + a]
        show(teacher, graph, histories, groups, frames, child, depth)
        expected, press = table[depth, EXPECTED, a], table[depth, PRESSES, a]
        silent = total - press
        told = second_told(
            teacher, graph, path, histories, groups, frames, SILENTLY, child, depth, silent, row
        )
        later = expected - told
        bound = expected + gamma * (later - room * press)
        table[depth, BOUND, a] = max(table[depth, BOUND, a], bound)
        nodes += 1
        if table[depth, BOUND, a] < cutoff:
            later -= second_told(
                teacher, graph, path, histories, groups, frames, ON_PRESS, child, depth, press, row
            )
            table[depth, BOUND, a], exact[depth, a] = expected + gamma * max(0.0, later), True
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
def bounds_on(teacher, graph, path, histories, groups, frames, node, depth, steps, total, gamma):
    """Find lower bounds on Q of every action at `node`, and put the actions in their order.

    The first step is exact, the second for the branch without a press; later ones are bounded by `gain`.
    """
    table = frames.table
    keys = frames.before if depth == 0 and frames.before[0] < np.inf else table[depth, BOUND]
    for a in range(graph.choices[node]):
        child, press = graph.successor[graph.first[node] + a], table[depth, PRESSES, a]
        silent = total - press
        show(teacher, graph, histories, groups, frames, child, depth)
        told = second_told(teacher, graph, path, histories, groups, frames, SILENTLY, child, depth, silent, a)
        table[depth, TOLD, a], frames.exact[depth, a] = told, False
        told += press * frames.gain[depth, 1, CAPACITY]
        table[depth, BOUND, a] = least_of(frames, depth, a, told, steps, gamma)
        _place(frames.order[depth], keys, a)
