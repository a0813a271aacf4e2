"""World states interned to numbers: successors and cue patterns as arrays, grown as needed."""

import math
import time
from collections.abc import Hashable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taskcomm.world import World

MAX_CUES = 16
MAX_TASKS = 1 << 16


class WorldGraph:
    """The part of a World that lies within some steps of the states asked for.

    Node n is `states[n]`, with actions `actions[n]` (canonical order) leading to the nodes
    `successor[first[n] : first[n] + count[n]]` once it is expanded (`count[n]` > 0).
    `pattern[n, task]` has bit m set where the cue of approval m is on. What 1 to d steps from n can show is
    filled for d <= `depth[n]`, and stands in the row `slot[n, d]` of three arrays; row 0, of zeros, is for
    d = 0 and for what is not filled:
    `reach[row, task]` has bit m set where the cue is on in some state that 1 to d steps from n lead to;
    `climb[row, task]` is the most that d steps on one path from n can collect where each state pays
    `worth[m]` for each cue that is on; `run[row, task]` numbers runs of adjacent tasks that no path of d
    steps from n can tell apart. `cue` (M,) are the rows of `world.cues(state)` that the teacher model uses.
    The arrays are reserved at once for `memory` bytes in all, which the system commits as they are filled.
    """

    def __init__(
        self,
        world: World,
        cue: NDArray[np.int64],
        worth: NDArray[np.float64],
        horizon: int,
        memory: int = 512 << 20,
    ) -> None:
        tasks = len(world.tasks)
        if len(cue) > MAX_CUES:
            raise ValueError(f"at most {MAX_CUES} approval states, not {len(cue)}")
        if tasks > MAX_TASKS:
            raise ValueError(f"at most {MAX_TASKS} tasks, not {tasks}")
        self.world, self.cue, self.worth, self.horizon = world, cue, worth, horizon
        self.states: list[Any] = []
        self.actions: list[tuple[Any, ...]] = []
        self._index: dict[Hashable, int] = {}
        self._bits = (1 << np.arange(len(cue))).astype(np.uint16)[:, None]
        nodes = memory // 2 // (10 * tasks + 4 * (horizon + 1) + 1000)
        rows = memory // 2 // (12 * tasks)
        self.first = np.zeros(nodes, dtype=np.int64)
        self.count = np.zeros(nodes, dtype=np.int64)
        self.depth = np.zeros(nodes, dtype=np.int64)
        self.pattern = np.zeros((nodes, tasks), dtype=np.uint16)
        self.pay = np.zeros((nodes, tasks))
        self.slot = np.zeros((nodes, horizon + 1), dtype=np.int32)
        self.reach = np.zeros((rows, tasks), dtype=np.uint16)
        self.climb = np.zeros((rows, tasks))
        self.run = np.zeros((rows, tasks), dtype=np.uint16)
        self.successor = np.zeros(32 * nodes, dtype=np.int32)
        self._used, self._rows = 0, 1

    def node(self, state: Hashable) -> int:
        """The number of a state, new ones being added."""
        index = self._index.get(state)
        if index is not None:
            return index
        index = len(self.states)
        if index == len(self.first):
            raise MemoryError(f"the graph of {self.world} is full: {index} states")
        self.states.append(state)
        self.actions.append(())
        self._index[state] = index
        on = np.asarray(self.world.cues(state), dtype=np.bool_)[self.cue]
        self.pattern[index] = np.where(on, self._bits, 0).sum(axis=0)
        self.pay[index] = self.worth @ on
        return index

    def expand(self, node: int) -> None:
        """Add the successors of a node, one for each action."""
        if self.count[node]:
            return
        state = self.states[node]
        actions = tuple(self.world.actions(state))
        if not actions:
            raise ValueError(f"no action is valid in {state}; a World must always offer one")
        successors = [self.node(self.world.step(state, action)) for action in actions]
        self.successor[self._used : self._used + len(actions)] = successors
        self.first[node], self.count[node] = self._used, len(actions)
        self.actions[node] = actions
        self._used += len(actions)

    def grow(self, root: int, depth: int, until: float = math.inf) -> bool:
        """Expand all nodes less than `depth` steps from `root`, and fill in what they lead to.

        False if `until` (on the clock of time.perf_counter) came first; what was done is kept.
        """
        if self.depth[root] >= depth:
            return True
        layers, seen = [[root]], {root}
        for _ in range(depth):
            layer: list[int] = []
            for node in layers[-1]:
                if time.perf_counter() >= until:
                    return False
                self.expand(node)
                for reached in self._after(node):
                    if reached not in seen:
                        seen.add(reached)
                        layer.append(reached)
            layers.append(layer)
        for steps in range(1, depth + 1):
            for layer in layers[: depth - steps + 1]:
                for node in layer:
                    if self.depth[node] < steps:
                        if time.perf_counter() >= until:
                            return False
                        self._fill(node, steps)
        return True

    def _fill(self, node: int, steps: int) -> None:
        """What `steps` steps from a node can show, from what one step less can show from its successors."""
        after = self._after(node)
        row, before = self._rows, self.slot[after, steps - 1]
        if row == len(self.reach):
            raise MemoryError(f"the graph of {self.world} is full: {row} rows")
        shown = self.pattern[after]
        self.reach[row] = np.bitwise_or.reduce(shown | self.reach[before], axis=0)
        self.climb[row] = (self.pay[after] + self.climb[before]).max(axis=0)
        differ = (np.diff(shown, axis=1) != 0) | (np.diff(self.run[before], axis=1) != 0)
        self.run[row, 1:] = np.cumsum(differ.any(axis=0))
        self.slot[node, steps], self.depth[node] = row, steps
        self._rows += 1

    def _after(self, node: int) -> list[int]:
        first = self.first[node]
        return self.successor[first : first + self.count[node]].tolist()  # type: ignore[no-any-return]
