"""The arrays that the compiled search works on, by what they are about.

Numbers of tasks, world nodes, rows and depths of the search index them. Kernels change them in place, and
make none: there is nothing to be counted or freed.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

WEIGHT, OWN, LEVEL = range(3)  # columns of Rows.row: the levels begin at LEVEL, the on-times after them
PEAK, UP, DOWN, FIRST_UP, FIRST_DOWN, FIRST, LAST, LATE, DECAY, HOLD = range(10)  # columns of Teacher.top
SILENT, PRESSED, YES, NO, W_LN_W, NEXT = 0, 1, 2, 3, 4, 6  # columns of Notes.once
LIKELY, APART, KEY, KEPT = range(4)  # columns of Notes.kept, and how many they are
ONCE, TWICE = 8, 32  # patterns and pairs of patterns kept in Notes
HIGHEST, OTHERS, BEST, INFORMATION, CAPACITY, REACHED, ALL = range(7)  # columns of Frames.gain
EXPECTED, PRESSES, BOUND, TOLD = range(4)  # rows of Frames.table[depth]
COST, CUTOFF, SLACK, LEAST, ROOM, LEAST_PRESS, PRESS, VALUE = range(8)  # columns of Frames.real
START, STOP, STEPS, SINCE, AT, PHASE, GROUPS, STAMP = range(8)  # columns of Frames.whole


class Teacher(NamedTuple):
    """The model: `top[m]` is the table-top of approval m, `mu` P(mistake)."""

    top: Floats
    mu: float
    rest_steps: int


class Graph(NamedTuple):
    """The world: `WorldGraph`, whose `count` is `choices` here."""

    first: Ints
    choices: Ints
    successor: NDArray[np.int32]
    pattern: NDArray[np.uint16]
    slot: NDArray[np.int32]
    reach: NDArray[np.uint16]
    climb: Floats
    run: NDArray[np.uint16]
    changed: NDArray[np.uint64]


class Path(NamedTuple):
    """`trail[d]` is the node at depth d; `past` the patterns shown before depth 0 and at it, newest last."""

    past: NDArray[np.uint16]
    trail: Ints


class Rows(NamedTuple):
    """The measures on the path, one after the other.

    `row[r]` is (weight, own, levels, on-times) and `task[r]` its task; rows of one task are adjacent, and the
    first of them has the task's `own`. `ahead[r, m, shown]` is (level, P(M = m), on-time) after a step
    that shows the cue or does not; `second[r, m, shown, then, reset]` P(M = m) in the step after it,
    `then` whether that shows the cue, `reset` whether M was m in the first.
    """

    task: Ints
    row: Floats
    ahead: Floats
    second: Floats


class Notes(NamedTuple):
    """What the tasks of a belief do, worked out once.

    Task number g of depth d is `tasks[d, g]` and has the rows from `begins[d, g]` to the next;
    `group[d, task]` is g for the tasks whose bit is set in `heads[d]`. `shown[g]` is the pattern it sees now.

    `once[d, g, pattern]` is (weight without a press, weight with one, all of it times s ln s and
    (1 - s) ln(1 - s) for the share s of presses, w ln w of the weights without and with a press; then by
    approval, by whether the second step shows its cue, and by branch: the weight of P(M = m) in the second
    step). `kept[branch, g, pair of patterns]` is (weight of a press in the second step, weight times its
    entropy, key). Both are found by the lowest bits of the patterns, and hold where `known` and the key, an
    integer's bits, say so. `usual[g]` is what `kept` has for what the first action shows in the second step.
    """

    tasks: Ints
    begins: Ints
    group: Ints
    heads: NDArray[np.uint64]
    shown: Ints
    known: Ints
    once: Floats
    kept: Floats
    usual: Floats


class Frames(NamedTuple):
    """The stack of the search, by depth.

    `table[d]` has C after each action, the mass of its press branch, Q or a lower bound on it (Q where
    `exact`), and the most that the second step tells if the first has no press. `order[d]` are the actions
    by that bound, at first by `before`. `gain[d, k]` says what step k + 1 can tell at most;
    `window` is room to find it. `real` and `whole` are what a frame remembers; the last row of `whole`
    counts all frames. `before` (actions,) is what a shorter look said of the first actions, if finite: the
    least of it is searched first.
    """

    table: Floats
    exact: NDArray[np.bool_]
    order: Ints
    gain: Floats
    window: Ints
    real: Floats
    whole: Ints
    before: Floats
