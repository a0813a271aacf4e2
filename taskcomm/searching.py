"""One search for a decision: its arrays, and running it in slices until it ends or time is out."""

import math
import time

import numpy as np

from taskcomm import _arrays
from taskcomm._arrays import Frames, Given, Graph, Groups, Histories, Path, Teacher
from taskcomm.belief import Belief
from taskcomm.levels import Bools, Floats
from taskcomm.teacher import TeacherModel
from taskcomm.worldgraph import WorldGraph

SLICE = 400  # nodes between two looks at the clock: about a millisecond
UNBOUNDED = 1 << 62


class Workspace:
    """What a search leaves to the next one: the model as arrays, and room for groups and histories."""

    def __init__(self) -> None:
        self._histories: Histories | None = None
        self._groups: tuple[tuple[int, ...], Groups] | None = None
        self._teacher: tuple[TeacherModel, Teacher] | None = None

    def teacher(self, belief: Belief) -> Teacher:
        """The model of the belief."""
        if self._teacher is None or self._teacher[0] != belief.model:
            self._teacher = belief.model, _teacher(belief)
        return self._teacher[1]

    def groups(self, belief: Belief, graph: WorldGraph, horizon: int) -> Groups:
        """Room for the groups of a search; what is in it is of searches before."""
        size = horizon, len(belief.world.tasks), graph.most
        if self._groups is None or self._groups[0] != size:
            self._groups = size, _groups(*size)
        return self._groups[1]

    def histories(self, belief: Belief, rows: int) -> Histories:
        """Room for `rows` rows; what is in it is of searches before."""
        if self._histories is None or len(self._histories.row) != rows:
            self._histories = _histories(belief, rows)
        return self._histories


class Search:
    """The compiled search from a belief at a node of the world graph; see `_search.search`.

    After `run`: `bound` (actions,) is Q_horizon where `exact` (actions,), else a lower bound on it, and
    `at_most` an upper bound; `expected` (actions,) is C after the first step, and `told` (horizon,) the
    most that each step can tell, in nats, for horizons of three steps and more; `nodes` counts the nodes
    visited; `fits` is False where `capacity` rows (at least the belief's) were too few. The graph must have
    been grown to `horizon`. `before` (actions,) is the `bound` of a search less far, if there is one: what
    it took for the best comes first. A `workspace` serves one search at a time: one that goes on after
    another has begun in it is undefined.
    """

    def __init__(
        self,
        belief: Belief,
        graph: WorldGraph,
        root: int,
        horizon: int,
        slack: float,
        gamma: float,
        capacity: int,
        before: Floats | None = None,
        workspace: Workspace | None = None,
    ) -> None:
        from taskcomm import _search  # numba is loaded, and the kernel compiled, only when it is needed

        workspace = workspace or Workspace()
        teacher, frames = workspace.teacher(belief), _frames(belief, graph, horizon)
        world = Graph(
            *(graph.first, graph.count, graph.successor, graph.pattern),
            *(graph.slot, graph.reach, graph.climb),
            *(graph.run, graph.changed),
        )
        start = horizon, belief.since_press, belief.entropy(), slack, gamma
        self.horizon, self.nodes, self.fits, self._gamma = horizon, 0, True, gamma
        self._kernel, self._resume = _search.search, -1
        path, given = _path(belief, teacher, root, horizon), _given(belief)
        groups = workspace.groups(belief, graph, horizon)
        histories = workspace.histories(belief, capacity)
        self._arguments = teacher, world, path, given, histories, groups, frames, *start
        count = int(graph.count[root])
        if before is not None:
            frames.before[:count] = before
        self.exact: Bools = frames.exact[0, :count]
        self.bound: Floats = frames.table[0, _arrays.BOUND, :count]
        self.expected: Floats = frames.table[0, _arrays.EXPECTED, :count]
        self.told: Floats = frames.gain[0, :, _arrays.INFORMATION]

    def run(self, until: float = math.inf) -> bool:
        """Search until the end, or about `until` (on the clock of time.perf_counter); whether it ended."""
        budget = UNBOUNDED if math.isinf(until) else SLICE
        while True:
            nodes, self._resume = self._kernel(*self._arguments, self._resume, budget)
            if nodes < 0:
                self.fits = False
                return False
            self.nodes += nodes
            if self._resume < 0:
                return True
            if time.perf_counter() >= until:
                return False

    @property
    def at_most(self) -> Floats:
        """Q by action where `exact`, else an upper bound: no step to come raises the expected entropy."""
        steps = sum(self._gamma**k for k in range(self.horizon))
        return np.where(self.exact, self.bound, self.expected * steps)


def _teacher(belief: Belief) -> Teacher:
    p = belief.parameters
    first = p.part_late * p.dt
    last = p.dt - first
    speeds = [last / p.rise, last / p.fall, first / p.rise, first / p.fall]
    top = np.column_stack([p.peak, *speeds, first, last, p.steps_late, p.decay, p.hold])
    plain = not (p.steps_late.any() or p.part_late.any() or p.decays)
    return Teacher(top, p.mistake, p.rest_steps, bool(plain))


def _path(belief: Belief, teacher: Teacher, root: int, horizon: int) -> Path:
    p = belief.parameters
    late = not teacher.plain and (p.steps_late.any() or p.part_late.any())
    seen = belief.seen if late else belief.seen[-1:]  # nothing before is still to be seen
    bits = np.array([1 << m for m in range(len(p.peak))], dtype=np.uint16)
    return Path(bits @ seen, np.full(horizon + 1, root, dtype=np.uint32))


def row_bytes(belief: Belief) -> int:
    """What one row of a search takes, in bytes, with its share of all else that is kept of histories."""
    few = 64
    return -(-sum(array.nbytes for array in _histories(belief, few)) // few)


def _given(belief: Belief) -> Given:
    rows, states = belief.level.shape
    row = np.empty((rows, _arrays.LEVEL + states * (1 + belief.parameters.decays)))
    row[:, _arrays.WEIGHT] = belief.weight
    row[:, _arrays.LEVEL : _arrays.LEVEL + states] = belief.level
    if belief.parameters.decays:
        row[:, _arrays.LEVEL + states :] = belief.on_time
    return Given(belief.task.astype(np.int64), row)


def _histories(belief: Belief, rows: int) -> Histories:
    """Room for `rows` rows, half as many histories, and their steps."""
    p = belief.parameters
    states, decays = len(p.peak), p.decays
    number = rows // 2 + 1
    steps = number * _arrays.SLOTS + (rows if 1 << states > _arrays.SLOTS else 0)
    return Histories(
        of=np.empty((number, 8), dtype=np.int64),
        has=np.empty((number, _arrays.LIKELY + 2 * states)),
        row=np.empty((rows, 1 + states * (1 + decays))),
        ahead=np.empty((rows, states, 2, 3)),
        shown=np.empty(steps, dtype=np.uint32),
        step=np.empty(steps, dtype=_arrays.STEP),
        link=np.empty(steps, dtype=_arrays.LINK),
        owner=np.empty(rows, dtype=np.uint32),
        renamed=np.empty(number, dtype=np.uint32),
        used=np.zeros(6, dtype=np.int64),
    )


def _groups(horizon: int, tasks: int, actions: int) -> Groups:
    return Groups(
        task=np.empty((horizon, tasks), dtype=np.uint32),
        history=np.empty((horizon, tasks), dtype=np.uint32),
        weight=np.empty((horizon, tasks)),
        own=np.empty((horizon, tasks)),
        group=np.empty((horizon, tasks), dtype=np.uint32),
        heads=np.empty((horizon, -(-tasks // 64)), dtype=np.uint64),
        step=np.empty(tasks, dtype=np.uint32),
        after=np.empty(tasks, dtype=np.uint32),
        channel=np.empty((max(1, horizon - 1), 1 + (actions if horizon > 2 else 0), actions, 2)),
        owes=np.empty((tasks, 2)),
    )


def _frames(belief: Belief, graph: WorldGraph, horizon: int) -> Frames:
    return Frames(
        table=np.zeros((horizon, 4, graph.most)),
        exact=np.zeros((horizon, graph.most), dtype=np.bool_),
        order=np.zeros((horizon, graph.most), dtype=np.int64),
        gain=np.zeros((horizon, horizon, 7)),
        window=np.zeros(belief.seen.shape[0] + horizon, dtype=np.int64),
        real=np.zeros((horizon, 8)),
        whole=np.zeros((horizon, 5), dtype=np.int64),
        before=np.full(graph.most, np.inf),
    )
