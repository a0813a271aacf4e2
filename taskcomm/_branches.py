# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Expected entropy after a step with many outcomes, for many beliefs over the same memories, compiled."""

import numpy as np

from taskcomm.compiling import kernel

compiled = kernel(__name__, "the planner's tree over signals")


@compiled
def costs_after(begins, task, weight, mental, table, likely, result):
    """sum_o C(w_ao) into `result` (actions, beliefs).

    Rows `begins[g]` to `begins[g + 1]` are of task g; `weight` (beliefs, rows), `mental` (actions, rows,
    2 + M) is P(M), `table` (outcomes, tasks, 2 + M) is P(outcome | M); `likely` (outcomes, rows) is scratch.
    """
    outcomes, states = table.shape[0], table.shape[2]
    for a in range(len(mental)):
        for o in range(outcomes):
            for r in range(len(task)):
                one = 0.0
                for s in range(states):
                    one += mental[a, r, s] * table[o, task[r], s]
                likely[o, r] = one
        for b in range(len(weight)):
            cost = 0.0
            for o in range(outcomes):
                total = 0.0
                for g in range(len(begins) - 1):
                    one = 0.0
                    for r in range(begins[g], begins[g + 1]):
                        one += weight[b, r] * likely[o, r]
                    if one > 0.0:
                        cost -= one * np.log(one)
                    total += one
                if total > 0.0:
                    cost += total * np.log(total)
            result[a, b] = cost
