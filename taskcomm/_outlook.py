# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""The compiled part of the world graph: patterns, distances, and what the coming steps can show."""

import numpy as np

from taskcomm.compiling import kernel

_kernel = kernel(__name__, "the planner's world graph", error_model="numpy")


@_kernel
def lay(shown, nodes, pattern):
    """The patterns of nodes from what each shows, (nodes, approvals, tasks)."""
    for i in range(len(nodes)):
        row = pattern[nodes[i]]
        row[:] = 0
        for m in range(shown.shape[1]):
            on = shown[i, m]
            for t in range(len(row)):
                row[t] |= on[t] << m


@_kernel
def spread(layer, steps, first, count, successor, distance, found):
    """Give the distance `steps` to the successors of `layer` that have none, a negative one.

    They go into `found`; returns their number.
    """
    number = 0
    for node in layer:
        for at in range(first[node], first[node] + count[node]):
            reached = successor[at]
            if distance[reached] < 0:
                distance[reached] = steps
                found[number] = reached
                number += 1
    return number


@_kernel
def fill(nodes, rows, steps, first, count, successor, pattern, pays, slot, reach, climb, run, differ):
    """What `steps` steps from each node can show, into its row, from one step less from its successors.

    See `WorldGraph` for `reach`, `climb` and `run`; `pays[pattern]` is what a pattern pays.
    """
    tasks = pattern.shape[1]
    for i in range(len(nodes)):
        node, row = nodes[i], rows[i]
        can, most, number = reach[row], climb[row], run[row]
        can[:], most[:], differ[:] = 0, -np.inf, 0
        for at in range(first[node], first[node] + count[node]):
            reached = successor[at]
            before = slot[reached, steps - 1]
            shown, can_later, later, number_later = (
                pattern[reached],
                reach[before],
                climb[before],
                run[before],
            )
            for t in range(tasks):  # three loops, since the compiler makes vector code of each
                can[t] |= shown[t] | can_later[t]
            for t in range(tasks):
                most[t] = max(most[t], pays[shown[t]] + later[t])
            for t in range(1, tasks):
                differ[t] |= (shown[t] ^ shown[t - 1]) | (number_later[t] ^ number_later[t - 1])
        number[0] = 0
        for t in range(1, tasks):
            number[t] = number[t - 1] + (differ[t] != 0)
        slot[node, steps] = row


@_kernel
def compare(nodes, first, count, successor, pattern, changed):
    """For each action at the nodes, the tasks to which it shows what the first action there does not."""
    for node in nodes:
        usual = pattern[successor[first[node]]]
        for at in range(first[node], first[node] + count[node]):
            shown, bits = pattern[successor[at]], changed[at]
            bits[:] = 0
            for t in range(len(usual)):
                bits[t >> 6] |= np.uint64(shown[t] != usual[t]) << np.uint64(t & 63)


@_kernel
def cut(distance, keep, first, count, depth, slot, gone, rows, links):
    """Leave the part of the graph within `keep` steps; `distance` is that from the root, negative where it
    was not reached.

    What is beyond goes into `gone`, the rows no longer needed into `rows`, and the `first` of nodes no
    longer expanded, which are those at `keep` steps too, into `links`; returns how many they are. Nodes
    nearer lose what looks further than `keep`.
    """
    nodes_gone, rows_gone, links_gone = 0, 0, 0
    for node in range(len(distance)):
        left = 0
        if distance[node] < 0:
            gone[nodes_gone] = node
            nodes_gone += 1
        else:
            left = keep - distance[node]
        for steps in range(left + 1, depth[node] + 1):
            rows[rows_gone] = slot[node, steps]
            rows_gone += 1
            slot[node, steps] = 0
        depth[node] = min(depth[node], left)
        if left == 0 and count[node] > 0:
            links[links_gone] = first[node]
            links_gone += 1
            count[node] = 0
    return nodes_gone, rows_gone, links_gone
