"""World states interned to numbers: successors, cue patterns and outlooks as arrays, bounded in memory."""

import math
import time
from collections.abc import Hashable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taskcomm.garbage import no_collections
from taskcomm.world import World

UNSEEN = -1  # distance of a node that was not reached
MAX_CUES = 16
MAX_TASKS = 1 << 16
STATE_BYTES = 600  # of Python objects for each node: more than a state of a few small tuples takes
_BATCH = 1 << 20  # successors times tasks between two looks at the clock: about a millisecond


class _Full(Exception):
    """No room for another node or row."""


class _Narrow(Exception):
    """A state has more actions than there is room for."""


class WorldGraph:
    """The part of a World that lies within some steps of the states asked for, in `memory` bytes at most.

    Node n is `states[n]`; its actions, in canonical order, lead to the nodes
    `successor[first[n] : first[n] + count[n]]` once it is expanded (`count[n]` > 0); `most` is the largest
    count so far. `pattern[n, task]` has bit m set where the cue of approval m is on; `cue` (M,) are the rows
    of `world.cues(state)` that the teacher model uses. Bit t % 64 of `changed[first[n] + a, t // 64]` is set
    where action a shows task t another pattern than the first action does, once `depth[n]` is 1 or more.

    The outlook of n: what d steps from it can show, filled for d <= `depth[n]`, is the row `slot[n, d]`
    of three arrays. Row 0, of zeros, stands for d = 0 and for what is not filled.
    `reach[row, task]` has bit m set where the cue is on in some state that 1 to d steps lead to;
    `climb[row, task]` is the most that d steps on one path can collect where each state pays `worth[m]`
    for each cue that is on; `run[row, task]` numbers runs of adjacent tasks that no path of d steps can
    tell apart.

    Memory. The arrays are reserved for all they may ever hold, and the system commits what is touched; small
    graphs do with a small part of it. When it is full, what does not lie within the steps asked for of the
    state asked for is dropped, and its numbers are used again: a number is good until the next `grow`. The
    states themselves are counted at STATE_BYTES each.
    """

    first: NDArray[np.int64]
    count: NDArray[np.int64]
    depth: NDArray[np.int64]
    distance: NDArray[np.int16]
    pattern: NDArray[np.uint16]
    slot: NDArray[np.uint32]
    successor: NDArray[np.uint32]
    changed: NDArray[np.uint64]
    reach: NDArray[np.uint16]
    climb: NDArray[np.float64]
    run: NDArray[np.uint16]

    def __init__(
        self,
        world: World,
        cue: NDArray[np.int64],
        worth: NDArray[np.float64],
        horizon: int,
        memory: int = 512 << 20,
    ) -> None:
        if len(cue) > MAX_CUES:
            raise ValueError(f"at most {MAX_CUES} approval states, not {len(cue)}")
        if len(world.tasks) > MAX_TASKS:
            raise ValueError(f"at most {MAX_TASKS} tasks, not {len(world.tasks)}")
        if isinstance(memory, bool) or not isinstance(memory, int) or memory < 1:
            raise ValueError(f"memory must be a whole number of bytes from 1, not {memory!r}")
        self.world, self.cue, self.worth, self.horizon, self.memory = world, cue, worth, horizon, memory
        patterns = np.arange(1 << len(cue))[:, None]
        self._pays = (patterns >> np.arange(len(cue)) & 1) @ worth
        self._differ = np.zeros(len(world.tasks), dtype=np.uint16)
        self.most, self._width = 0, 2 * len(world.actions(world.start()))
        self._empty()

    def _empty(self) -> None:
        """No node at all, and room for few."""
        self.states: list[Any] = []
        self._index: dict[Hashable, int] = {}
        self._alive = bytearray()
        self._rows, self._links = 1, 0  # never used so far: rows and segments of `successor` from here on
        self._gone: list[int] = []  # numbers to use again, but for those that are alive again
        self._free_rows: list[int] = []
        self._free_links: list[int] = []
        self._root, self._layers = -1, [np.zeros(0, dtype=np.int32)]
        self._reserved = 0
        self._reserve(max(1, self.memory // 64))

    def _reserve(self, memory: int) -> None:
        """Make the arrays as large as `memory` bytes allow, what they hold being kept."""
        tasks, steps = len(self.world.tasks), self.horizon + 1
        words = -(-tasks // 64)
        nodes = max(2, memory // 3 * 2 // (2 * tasks + 4 * steps + 26 + STATE_BYTES))
        rows = max(2, memory // 3 // (12 * tasks + (4 + 8 * words) * self._width))
        kinds: dict[str, tuple[tuple[int, ...], type]] = {
            "first": ((nodes,), np.int64),
            "count": ((nodes,), np.int64),
            "depth": ((nodes,), np.int64),
            "distance": ((nodes,), np.int16),
            "pattern": ((nodes, tasks), np.uint16),
            "slot": ((nodes, steps), np.uint32),
            "successor": ((rows * self._width,), np.uint32),
            "changed": ((rows * self._width, words), np.uint64),
            "reach": ((rows, tasks), np.uint16),
            "climb": ((rows, tasks), np.float64),
            "run": ((rows, tasks), np.uint16),
        }
        for name, (shape, kind) in kinds.items():
            array: NDArray[Any] = np.zeros(shape, dtype=kind)
            if self._reserved:
                old = getattr(self, name)
                array[: len(old)] = old
            setattr(self, name, array)
        self._reserved = memory

    @cached_property
    def _kernels(self) -> Any:
        """The compiled part; all of it is loaded at once, that dropping may not wait for it in a deadline."""
        from taskcomm import _outlook  # numba is loaded, and the kernels compiled, only when they are needed

        self._cut(_outlook, 0, 0)
        return _outlook

    def node(self, state: Hashable) -> int:
        """The number of a state, new ones being added."""
        return self._nodes([state])[0]

    def grow(self, state: Hashable, depth: int, until: float = math.inf) -> int | None:
        """The node of `state`, everything less than `depth` steps from it expanded and its outlook filled.

        None if `until` (on the clock of time.perf_counter) came first, or all this does not fit into the
        memory; what was done is kept. Without `until` the latter is a MemoryError. A state without actions
        is a ValueError.
        """
        if not 0 <= depth <= self.horizon:
            raise ValueError(f"depth must lie in 0 to the graph's horizon {self.horizon}, not {depth!r}")
        dropped = False
        while True:
            try:
                with no_collections():
                    root = self.node(state)
                    return root if self._grown(root, depth, until) else None
            except _Narrow as narrow:
                self._width = 2 * narrow.args[0]
                self._empty()
            except _Full:
                if self._reserved < self.memory:
                    self._reserve(self.memory)
                elif not dropped:
                    self._drop(state, depth)
                    dropped = True
                elif math.isinf(until):
                    raise MemoryError(
                        f"the worlds within {depth} steps of {state} do not fit into {self.memory} bytes"
                        f" ({len(self.count)} states, {len(self.reach)} outlooks of {len(self.world.tasks)}"
                        " tasks): take a shorter horizon, a deadline, or more memory"
                    ) from None
                else:
                    return None

    def _grown(self, root: int, depth: int, until: float) -> bool:
        """Expand and fill around `root`; False if `until` came first."""
        if self.depth[root] >= depth:
            return True
        if root != self._root:
            self._root, self._layers = root, [np.array([root], dtype=np.int32)]
            self.distance[: len(self.states)] = UNSEEN
            self.distance[root] = 0
        while len(self._layers) <= depth:
            layer = self._layers[-1]
            for node in layer[self.count[layer] == 0].tolist():
                if time.perf_counter() >= until:
                    return False
                self._expand(node)
            self._layers.append(self._spread(layer, len(self._layers)))
        return all(self._filled(depth - steps, steps, until) for steps in range(1, depth + 1))

    def _spread(self, layer: NDArray[np.int32], steps: int) -> NDArray[np.int32]:
        """The nodes that one step from those of `layer` leads to, if no fewer than `steps` lead there."""
        found = np.empty(len(self.states), dtype=np.int32)
        graph = self.first, self.count, self.successor, self.distance
        return found[: self._kernels.spread(layer, steps, *graph, found)].copy()

    def _filled(self, distance: int, steps: int, until: float) -> bool:
        """Fill the outlook of `steps` steps up to `distance` from the root; False if `until` came first."""
        nodes = np.concatenate(self._layers[: distance + 1])
        nodes = nodes[self.depth[nodes] < steps]
        batch = max(1, _BATCH // (self.most * len(self._differ)))
        while len(nodes):
            if time.perf_counter() >= until:
                return False
            rows = np.array(self._taken(min(batch, len(nodes))), dtype=np.int32)
            done, nodes = nodes[: len(rows)], nodes[len(rows) :]
            graph = self.first, self.count, self.successor, self.pattern, self._pays, self.slot
            self._kernels.fill(done, rows, steps, *graph, self.reach, self.climb, self.run, self._differ)
            if steps == 1:
                self._kernels.compare(done, *graph[:4], self.changed)
            self.depth[done] = steps
        return True

    def _taken(self, most: int) -> list[int]:
        """The numbers of rows to fill, at least one and at `most` so many."""
        rows = self._free_rows[-most:]
        if rows:
            del self._free_rows[-most:]
            return rows
        rows = list(range(self._rows, min(self._rows + most, len(self.reach))))
        if not rows:
            raise _Full
        self._rows += len(rows)
        return rows

    def _expand(self, node: int) -> None:
        """Add the successors of a node, one for each action."""
        state, step = self.states[node], self.world.step
        actions = self.world.actions(state)
        if not actions:
            raise ValueError(f"no action is valid in {state}; a World must always offer one")
        if len(actions) > self._width:
            raise _Narrow(len(actions))
        successors = self._nodes([step(state, action) for action in actions])
        if self._free_links:
            first = self._free_links.pop()
        else:
            first = self._links
            if first == len(self.successor):
                raise _Full
            self._links += self._width
        self.successor[first : first + len(actions)] = successors
        self.first[node], self.count[node] = first, len(actions)
        self.most = max(self.most, len(actions))

    def _nodes(self, states: Sequence[Hashable]) -> list[int]:
        """The numbers of states; the patterns of those that are new are laid out together."""
        numbers, new, shown = [], [], []
        try:
            for state in states:
                number = self._index.get(state)
                if number is None:
                    shown.append(np.asarray(self.world.cues(state), dtype=np.bool_)[self.cue])
                    number = self._added(state)
                    new.append(number)
                self._alive[number] = True
                numbers.append(number)
        finally:
            if new:
                self._kernels.lay(np.stack(shown[: len(new)]), np.array(new), self.pattern)
        return numbers

    def _added(self, state: Hashable) -> int:
        while self._gone:
            number = self._gone.pop()
            if not self._alive[number]:
                del self._index[self.states[number]]
                self.states[number] = state
                break
        else:
            number = len(self.states)
            if number == len(self.count):
                raise _Full
            self.states.append(state)
            self._alive.append(True)
        self._index[state] = number
        self.distance[number] = UNSEEN
        return number

    def _drop(self, state: Hashable, keep: int) -> None:
        """Leave what is known to lie within `keep` steps of `state`; the rest may be overwritten."""
        used, root = len(self.states), self._index.get(state)
        self.distance[:used], self._root = UNSEEN, -1
        if root is not None:
            layer = np.array([root], dtype=np.int32)
            self.distance[root] = 0
            for steps in range(1, keep + 1):
                layer = self._spread(layer, steps)
        gone, rows, links = self._cut(self._kernels, used, keep)
        self._gone = gone.tolist()
        self._free_rows += rows.tolist()
        self._free_links += links.tolist()
        self._alive[:] = (self.distance[:used] != UNSEEN).tobytes()

    def _cut(self, kernels: Any, used: int, keep: int) -> list[NDArray[np.int64]]:
        """Cut off what is further than `keep` steps: the nodes, rows and segments that are free now."""
        freed = [np.empty(most, dtype=np.int64) for most in (used, self._rows, used)]
        graph = self.first, self.count, self.depth, self.slot
        ends = kernels.cut(self.distance[:used], keep, *graph, *freed)
        return [numbers[:end] for numbers, end in zip(freed, ends, strict=True)]
