"""One search for a decision: its arrays, and running it in slices until it ends or time is out."""

import math
import time

import numpy as np

from taskcomm.belief import Belief
from taskcomm.levels import Bools, Floats
from taskcomm.worldgraph import WorldGraph

SLICE = 400  # nodes between two looks at the clock: some milliseconds
UNBOUNDED = 1 << 62


class Search:
    """The compiled search from a belief at a node of the world graph; see `_search.search`.

    After `run`: `bound` (actions,) is Q_horizon where `exact` (actions,), else a lower bound on it, and
    `at_most` an upper bound; `nodes` counts the nodes visited; `fits` is False where `capacity` rows were
    too few. The graph must have been grown to `horizon`.
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
    ) -> None:
        from taskcomm import _search  # numba is loaded, and the kernel compiled, only when it is needed

        p = belief.parameters
        states, rows, most = len(p.peak), len(belief.task), graph.most
        decays = bool(np.isfinite(p.decay).any())
        capacity = max(capacity, rows * (states + 3))
        task, row = np.zeros(capacity, dtype=np.int64), np.zeros((capacity, 2 + states * (1 + decays)))
        task[:rows], row[:rows, _search.WEIGHT] = belief.task, belief.weight
        row[:rows, _search.LEVEL : _search.LEVEL + states] = belief.level
        if decays:
            row[:rows, _search.LEVEL + states :] = belief.on_time
        bits = (1 << np.arange(states)).astype(np.uint16)[None, :, None]
        past = np.where(belief.seen, bits, np.uint16(0)).sum(axis=1).astype(np.uint16)
        first = p.part_late * p.dt
        last = p.dt - first
        speeds = [last / p.rise, last / p.fall, first / p.rise, first / p.fall]
        table = np.zeros((horizon, 4, most))
        exact = np.zeros((horizon, most), dtype=np.bool_)
        self.horizon, self.nodes, self.fits = horizon, 0, True
        self._kernel, self._resume = _search.search, -1
        self._arguments = (
            np.column_stack([p.peak, *speeds, first, last, p.steps_late, p.decay, p.hold]),
            p.mistake,
            p.rest_steps,
            *(graph.first, graph.count, graph.successor, graph.pattern),
            *(graph.slot, graph.reach, graph.climb, graph.run),
            past,
            task,
            row,
            np.zeros((capacity, states, 2, 3)),
            np.full(horizon + 1, root),
            table,
            exact,
            np.zeros((horizon, most), dtype=np.int64),
            np.zeros((horizon, len(belief.world.tasks) + 2, 11)),
            np.zeros(len(past) + horizon, dtype=np.int64),
            np.zeros((horizon, horizon, 7)),
            np.zeros((horizon, 7)),
            np.zeros((horizon, 7), dtype=np.int64),
            *(rows, horizon, belief.since_press, belief.entropy(), slack, gamma),
        )
        count = int(graph.count[root])
        self.exact: Bools = exact[0, :count]
        self.bound: Floats = table[0, _search.BOUND, :count]
        self._silent, self._press = table[0, _search.SILENT, :count], table[0, _search.PRESS, :count]
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
        return np.asarray((self._silent + self._press) * self._steps, dtype=np.float64)
