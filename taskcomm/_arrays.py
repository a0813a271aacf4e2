"""The arrays that the compiled search works on, by what they are about.

Numbers of tasks, world nodes, histories, rows and depths of the search index them. Kernels change them in
place, and make none: there is nothing to be counted or freed.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Numbers = NDArray[np.uint32]  # to index with: without a sign, that none be wrapped around

WEIGHT, LEVEL = range(2)  # columns of Histories.row: the levels begin at LEVEL, the on-times after them
PEAK, UP, DOWN, FIRST_UP, FIRST_DOWN, FIRST, LAST, LATE, DECAY, HOLD = range(10)  # columns of Teacher.top
BEGIN, END, BEFORE, SHOWN, DEPTH, SINCE, TASK, BRANCH = range(8)  # columns of Histories.of
MASS, M_LN_M, HIGHEST_SECOND, LIKELY = range(4)  # columns of Histories.has: LIKELY and what follows
SILENTLY, ON_PRESS = range(2)  # branches
STEP = np.dtype([("press", np.float64), ("apart", np.float64)])
LINK = np.dtype([("next", np.uint32), ("silently", np.uint32), ("on_press", np.uint32)])
NOTHING = 0xFFFFFFFF  # shown: no pattern
USED_HISTORIES, USED_STEPS, USED_ROWS, FULL, KEPT_HISTORIES, KEPT_ROWS = range(6)  # of Histories.used
SLOTS = 8  # steps of a history that have their own place, found by the lowest bits of their patterns
HIGHEST, OTHERS, BEST, INFORMATION, CAPACITY, REACHED, ALL = range(7)  # columns of Frames.gain
EXPECTED, PRESSES, BOUND, TOLD = range(4)  # rows of Frames.table[depth]
COST, CUTOFF, SLACK, LEAST, ROOM, LEAST_PRESS, PRESS, VALUE = range(8)  # columns of Frames.real
STEPS, AT, PHASE, GROUPS, CAME = range(5)  # columns of Frames.whole


class Teacher(NamedTuple):
    """The model: `top[m]` is the table-top of approval m, `mu` P(mistake).

    It is `plain` where nothing is seen late and nothing decays.
    """

    top: Floats
    mu: float
    rest_steps: int
    plain: bool


class Graph(NamedTuple):
    """The world: `WorldGraph`, whose `count` is `choices` here."""

    first: Ints
    choices: Ints
    successor: Numbers
    pattern: NDArray[np.uint16]
    slot: Numbers
    reach: NDArray[np.uint16]
    climb: Floats
    run: NDArray[np.uint16]
    changed: NDArray[np.uint64]


class Path(NamedTuple):
    """`trail[d]` is the node at depth d; `past` the patterns shown before depth 0 and at it, newest last."""

    past: NDArray[np.uint16]
    trail: Numbers


class Given(NamedTuple):
    """The belief: `task[r]`, and `row[r]`: (weight, levels, on-times); rows of one task are adjacent."""

    task: Ints
    row: Floats


class Histories(NamedTuple):
    """What a task may have seen and the teacher done since the root, and her memory then; see `_histories`.

    History h has the rows of (weight, levels, on-times) from `of[h, BEGIN]` to END, of the weight `has[h,
    MASS]` together; it came of history BEFORE, DEPTH steps from the root, by a step that showed the pattern
    SHOWN and was without or with a press (BRANCH), SINCE steps after the last press; tasks that begin as
    TASK does share it. BEGIN is -1 while its rows are not needed. From has[h, LIKELY + 2 m] on stand the
    weights of M = m in the next step, if that shows the cue of m not and if it does; M_LN_M is MASS times
    its logarithm, HIGHEST_SECOND the most that P(press) can be two steps on, where there are rows.
    `ahead[r, m, shown]` is (level, P(M = m), on-time) of row r a step on, whether that shows the cue or
    not.

    Step s showed the pattern `shown[s]`; in `step[s]`, `press` is the weight of a press, `apart` that of what
    the step may observe times its logarithm, less that of the weight before. By `link[s]` it leads to the
    histories `silently` and `on_press`, 0 where they are not worked out, and to the `next` step of its
    history with the same lowest bits, 0 for none: the first of these is number SLOTS * h + shown % SLOTS, the
    others come after all first ones. Number 0 of both stands for what there is no room for.
    `owner[r]` is the history whose rows begin with r, `renamed` room to forget some; `used` says how much
    of all this is.
    """

    of: Ints
    has: Floats
    row: Floats
    ahead: Floats
    shown: Numbers
    step: NDArray[Any]
    link: NDArray[Any]
    owner: Numbers
    renamed: Numbers
    used: Ints


class Groups(NamedTuple):
    """The tasks of the measures on the path, by depth: those of one group nothing to come tells apart.

    Group g of depth d stands for tasks of the weights b at the root: `weight[d, g]` is sum b and `own[d,
    g]` sum b ln b; task[d, g] is one of them, history[d, g] what they have behind them. `group[d, task]` is
    g for the tasks whose bit is set in `heads[d]`. `step[g]` is the step of a group to the node looked at,
    `after[g]` the history it has then. `channel[d, a, c]` is the (weight of a press, `apart`) of the step to
    successor c after action a of depth d without a press; the last row is for the one searched, with a
    press, and for what is not kept. `owes[g]` is what c = 0 owes to group g.
    """

    task: Numbers
    history: Numbers
    weight: Floats
    own: Floats
    group: Numbers
    heads: NDArray[np.uint64]
    step: Numbers
    after: Numbers
    channel: Floats
    owes: Floats


class Frames(NamedTuple):
    """The stack of the search, by depth.

    `table[d]` has C after each action, the mass of its press branch, Q or a lower bound on it (Q where
    `exact`), and the most that the second step tells if the first has no press. `order[d]` are the actions
    by that bound, at first by `before`. `gain[d, k]` says what step k + 1 can tell at most;
    `window` is room to find it. `real` and `whole` are what a frame remembers. `before` (actions,) is what a
    shorter look said of the first actions, if finite: the least of it is searched first.
    """

    table: Floats
    exact: NDArray[np.bool_]
    order: Ints
    gain: Floats
    window: Ints
    real: Floats
    whole: Ints
    before: Floats
