# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Pairs of actions that show most tasks the same, compiled: what to sum again, and what not.

After action a, action e shows most tasks what some action e' (its twin) shows them after the first action
instead of a. For a task that a leaves alone, the pair (a, e) does what (first, e') does unless they show it
something else at the end; for one that a changes, it does what a and then the first action do, unless e or
e' changes it too. Only the tasks for which this does not hold are `apart`: all others need not be summed
again.
"""

import numpy as np

from taskcomm._entropy import called, compiled


@compiled
def _apart(after_a, after_first, shown, shown_first, shown_twin, shown_usual):
    """How many tasks are apart; the patterns that they are shown, by task."""
    number = 0
    for t in range(len(shown)):
        moved = after_a[t] != after_first[t]
        again = (shown[t] != shown_first[t]) | (shown_twin[t] != shown_usual[t])
        number += int((moved & again) | (~moved & (shown[t] != shown_twin[t])))
    return number


@called
def compare(graph, twins, node):
    """Find the twins of the pairs of actions at `node`, if they are not there; their place."""
    at = node & (len(twins.node) - 1)
    if twins.node[at] == node:
        return at
    twins.node[at] = node
    first, pattern, successor = graph.first[node], graph.pattern, graph.successor
    usual = successor[first]
    links, others = graph.first[usual], graph.choices[usual]
    after_first, shown_usual = pattern[usual], pattern[successor[links]]
    for a in range(1, graph.choices[node]):
        child = successor[first + a]
        begin = graph.first[child]
        after_a, shown_first = pattern[child], pattern[successor[begin]]
        for e in range(graph.choices[child]):
            shown = pattern[successor[begin + e]]
            twin, least = 0, len(shown) + 1
            for k in range(others):
                other = (e + k) % others  # most often it stands in the same place
                shown_twin = pattern[successor[links + other]]
                number = _apart(after_a, after_first, shown, shown_first, shown_twin, shown_usual)
                if number < least:
                    twin, least = other, number
                    if least == 0:
                        break
            twins.twin[at, a, e] = twin
            shown_twin, bits = pattern[successor[links + twin]], twins.apart[at, a, e]
            bits[:] = 0
            for t in range(len(shown)):
                if after_a[t] != after_first[t]:
                    differs = shown[t] != shown_first[t] or shown_twin[t] != shown_usual[t]
                else:
                    differs = shown[t] != shown_twin[t]
                bits[t >> 6] |= np.uint64(differs) << np.uint64(t & 63)
    return at
