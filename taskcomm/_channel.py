# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""What the next two steps tell about the task, in closed form and compiled.

A step is a channel from task to press or no press. With W_g the weight of group g, P_g that of its press
branch, W and P their totals, it tells, in nats times mass,

    told = W h2(P / W) - sum_g W_g h2(P_g / W_g)

and the expected entropy falls by that much. The second step is such a channel for each branch of the first.
What a group does is known of its history (`_histories`): here it is only summed. Few tasks see after one
action what they do not see after another (`changed`): only they are summed again.
"""

import numpy as np

from taskcomm._arrays import BEGIN, GROUPS, MASS
from taskcomm._bits import lowest
from taskcomm._entropy import called, compiled, fused, log, xlogx
from taskcomm._histories import history_after, step_of
from taskcomm._rows import fill

NEVER = 1e-280  # of a mass: nothing can be said of so little


@compiled
def merge(graph, histories, groups, outlook, depth, number):
    """Make one of adjacent groups that no step to come can tell apart; how many are left.

    `run[outlook]` numbers the runs of tasks that the coming steps treat alike.
    """
    task, history = groups.task[depth], groups.history[depth]
    last = 0
    for g in range(1, number):
        if history[g] == history[last] and graph.run[outlook, task[g]] == graph.run[outlook, task[last]]:
            groups.weight[depth, last] += groups.weight[depth, g]
            groups.own[depth, last] += groups.own[depth, g]
            continue
        last += 1
        task[last], history[last] = task[g], history[g]
        groups.weight[depth, last], groups.own[depth, last] = groups.weight[depth, g], groups.own[depth, g]
    return last + 1


@compiled
def lay_out(teacher, path, histories, groups, depth, number):
    """Number the tasks that groups are found by, and see that they have their rows; the mass of all."""
    total = 0.0
    groups.heads[depth, :] = 0
    for g in range(number):
        t, h = groups.task[depth, g], groups.history[depth, g]
        if histories.of[h, BEGIN] < 0:
            fill(teacher, path, histories, np.int64(h))
        groups.group[depth, t] = g
        groups.heads[depth, t >> 6] |= np.uint64(1) << np.uint64(t & 63)
        total += groups.weight[depth, g] * histories.has[h, MASS]
    return total


@compiled
def show(teacher, graph, histories, groups, frames, node, depth):
    """Set step[g] to the step of each group to `node`."""
    for g in range(frames.whole[depth, GROUPS]):
        what = graph.pattern[node, groups.task[depth, g]]
        groups.step[g] = step_of(teacher, histories, groups.history[depth, g], what)


@compiled
def go_on(teacher, path, histories, groups, frames, depth, branch):
    """Set after[g] to the history of each group after step[g], without a press or with one."""
    for g in range(frames.whole[depth, GROUPS]):
        h = groups.history[depth, g]
        groups.after[g] = history_after(teacher, path, histories, h, groups.step[g], branch)


@fused
def channels(teacher, graph, histories, groups, frames, at, node, depth, channel):
    """Set channel[c] to what the groups, of histories `at`, do in a step to successor c of `node`."""
    begin, press, apart, owes = graph.first[node], 0.0, 0.0, groups.owes
    for g in range(frames.whole[depth, GROUPS]):
        what = graph.pattern[graph.successor[begin], groups.task[depth, g]]
        step, weight = histories.step[step_of(teacher, histories, at[g], what)], groups.weight[depth, g]
        one, other = weight * step["press"], weight * step["apart"]
        owes[g, 0], owes[g, 1] = one, other
        press, apart = press + one, apart + other
    channel[0, 0], channel[0, 1] = press, apart
    for c in range(1, graph.choices[node]):
        child, more, further = graph.successor[begin + c], press, apart
        for word in range(graph.changed.shape[1]):
            left = graph.changed[begin + c, word] & groups.heads[depth, word]
            while left != 0:
                t = np.uint64(word << 6) + lowest(left)
                left &= left - np.uint64(1)
                g = groups.group[depth, t]
                what, weight = graph.pattern[child, t], groups.weight[depth, g]
                step = histories.step[step_of(teacher, histories, at[g], what)]
                more += weight * step["press"] - owes[g, 0]
                further += weight * step["apart"] - owes[g, 1]
        channel[c, 0], channel[c, 1] = max(0.0, more), further


@fused
def told_by(mass, m_ln_m, press, apart):
    """What a step tells for which `press` of the mass presses; `m_ln_m` is the mass times its logarithm."""
    return m_ln_m - xlogx(press) - xlogx(mass - press) + apart


@compiled
def most_told(channel, choices, mass):
    """The most that a step of the weight `mass` tells, of the `choices` that `channel` has.

    The entropy of the output is concave in the mass of presses, so a line that touches it says which
    actions cannot tell the most.
    """
    m_ln_m, press = xlogx(mass), channel[0, 0]
    rest = mass - press
    steep, base, slope = press > NEVER and rest > NEVER, 0.0, 0.0
    if steep:
        slope = log(rest) - log(press)
        base = m_ln_m - mass * log(rest) + press * slope
    else:
        base = told_by(mass, m_ln_m, press, 0.0)
    most = max(0.0, base + channel[0, 1])
    for c in range(1, choices):
        more, further = channel[c, 0], channel[c, 1]
        if steep and base + slope * (more - press) + further <= most:
            continue
        most = max(most, told_by(mass, m_ln_m, more, further))
    return most


@called
def told_next(teacher, graph, histories, groups, frames, node, depth, mass, row):
    """The most that a step from `node` tells to the groups, of weight `mass`, with the histories `after`.

    What its actions do is left in channel[depth, row].
    """
    channel = groups.channel[depth, row]
    if mass <= NEVER:
        channel[: graph.choices[node]] = 0.0
        return 0.0
    channels(teacher, graph, histories, groups, frames, groups.after, node, depth, channel)
    return most_told(channel, graph.choices[node], mass)


@compiled
def cost_of_press(histories, groups, frames, depth):
    """C of the branch with a press after step[g]: P ln P - sum_theta P_theta ln P_theta."""
    mass = cost = 0.0
    for g in range(frames.whole[depth, GROUPS]):
        press, weight = histories.step[groups.step[g]]["press"], groups.weight[depth, g]
        mass += weight * press
        cost -= weight * xlogx(press) + press * groups.own[depth, g]
    return max(0.0, xlogx(mass) + cost)


@compiled
def descend(groups, frames, depth):
    """Give depth + 1 the groups of `depth` with the histories `after`."""
    for g in range(frames.whole[depth, GROUPS]):
        groups.task[depth + 1, g], groups.history[depth + 1, g] = groups.task[depth, g], groups.after[g]
        groups.weight[depth + 1, g], groups.own[depth + 1, g] = groups.weight[depth, g], groups.own[depth, g]
    frames.whole[depth + 1, GROUPS] = frames.whole[depth, GROUPS]
