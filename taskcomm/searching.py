"""One search for a decision: its arrays, and running it in slices until it ends or time is out."""

import math
import time

import numpy as np

from taskcomm import _arrays
from taskcomm._arrays import Frames, Graph, Notes, Path, Rows, Teacher
from taskcomm.belief import Belief
from taskcomm.levels import Bools, Floats
from taskcomm.worldgraph import WorldGraph

SLICE = 400  # nodes between two looks at the clock: about a millisecond
UNBOUNDED = 1 << 62


class Search:
    """The compiled search from a belief at a node of the world graph; see `_search.search`.

    After `run`: `bound` (actions,) is Q_horizon where `exact` (actions,), else a lower bound on it, and
    `at_most` an upper bound; `expected` (actions,) is C after the first step, and `told` (horizon,) the most
    that each step can tell, in nats, for horizons of three steps and more; `nodes` counts the nodes visited;
    `fits` is False where `capacity` rows (at least the belief's) were too few. The graph must have been grown
    to `horizon`. `before` (actions,) is the `bound` of a search less far, if there is one: what it took for
    the best comes first.
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
    ) -> None:
        from taskcomm import _search  # numba is loaded, and the kernel compiled, only when it is needed

        number = len(belief.task)
        teacher, frames = _teacher(belief), _frames(belief, graph, horizon)
        rows = _rows(belief, capacity)
        world = Graph(
            *(graph.first, graph.count, graph.successor, graph.pattern),
            *(graph.slot, graph.reach, graph.climb),
            *(graph.run, graph.changed),
        )
        start = number, horizon, belief.since_press, belief.entropy(), slack, gamma
        self.horizon, self.nodes, self.fits = horizon, 0, True
        self._kernel, self._resume = _search.search, -1
        path, notes = _path(belief, root, horizon), _notes(belief, graph, horizon)
        self._arguments = teacher, world, path, rows, notes, frames, *start
        count = int(graph.count[root])
        if before is not None:
            frames.before[:count] = before
        self.exact: Bools = frames.exact[0, :count]
        self.bound: Floats = frames.table[0, _arrays.BOUND, :count]
        self.expected: Floats = frames.table[0, _arrays.EXPECTED, :count]
        self.told: Floats = frames.gain[0, :, _arrays.INFORMATION]
        self._steps = sum(gamma**k for k in range(horizon))

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
        """An upper bound on Q by action: no step to come raises the expected entropy."""
        return np.asarray(self.expected * self._steps, dtype=np.float64)


def _teacher(belief: Belief) -> Teacher:
    p = belief.parameters
    first = p.part_late * p.dt
    last = p.dt - first
    speeds = [last / p.rise, last / p.fall, first / p.rise, first / p.fall]
    top = np.column_stack([p.peak, *speeds, first, last, p.steps_late, p.decay, p.hold])
    return Teacher(top, p.mistake, p.rest_steps)


def _path(belief: Belief, root: int, horizon: int) -> Path:
    p = belief.parameters
    bits = (1 << np.arange(len(p.peak))).astype(np.uint16)[None, :, None]
    past = np.where(belief.seen, bits, np.uint16(0)).sum(axis=1).astype(np.uint16)
    if not (p.steps_late.any() or p.part_late.any()):
        past = past[-1:]  # nothing before is still to be seen
    return Path(past, np.full(horizon + 1, root))


def row_bytes(belief: Belief) -> int:
    """What one row of a search takes, in bytes."""
    return sum(array.itemsize * array[0].size for array in _rows(belief, len(belief.task)))


def _rows(belief: Belief, capacity: int) -> Rows:
    p, number = belief.parameters, len(belief.task)
    states, decays = len(p.peak), bool(np.isfinite(p.decay).any())
    task, row = np.empty(capacity, dtype=np.int64), np.empty((capacity, 2 + states * (1 + decays)))
    task[:number], row[:number, _arrays.WEIGHT] = belief.task, belief.weight
    row[:number, _arrays.LEVEL : _arrays.LEVEL + states] = belief.level
    if decays:
        row[:number, _arrays.LEVEL + states :] = belief.on_time
    return Rows(task, row, np.empty((capacity, states, 2, 3)), np.empty((capacity, states, 2, 2, 2)))


def _notes(belief: Belief, graph: WorldGraph, horizon: int) -> Notes:
    tasks, columns = len(belief.world.tasks), _arrays.NEXT + 4 * len(belief.parameters.peak)
    return Notes(
        tasks=np.empty((horizon, tasks), dtype=np.int64),
        begins=np.empty((horizon, tasks + 1), dtype=np.int64),
        group=np.empty((horizon, tasks), dtype=np.int64),
        heads=np.empty((horizon, graph.changed.shape[1]), dtype=np.uint64),
        shown=np.empty(tasks, dtype=np.int64),
        known=np.zeros((horizon, tasks, _arrays.ONCE), dtype=np.int64),
        once=np.empty((horizon, tasks, _arrays.ONCE, columns)),
        kept=np.zeros((2, tasks, _arrays.TWICE, _arrays.KEPT)),
        usual=np.empty((tasks, 2)),
    )


def _frames(belief: Belief, graph: WorldGraph, horizon: int) -> Frames:
    return Frames(
        table=np.zeros((horizon, 4, graph.most)),
        exact=np.zeros((horizon, graph.most), dtype=np.bool_),
        order=np.zeros((horizon, graph.most), dtype=np.int64),
        gain=np.zeros((horizon, horizon, 7)),
        window=np.zeros(belief.seen.shape[0] + horizon, dtype=np.int64),
        real=np.zeros((horizon, 8)),
        whole=np.zeros((horizon + 1, 8), dtype=np.int64),
        before=np.full(graph.most, np.inf),
    )
