"""World states interned to numbers: successors and cue patterns as arrays, grown as needed."""

import math
import time
from collections.abc import Hashable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taskcomm.world import World

MAX_CUES = 16


class WorldGraph:
    """The part of a World that lies within some steps of the states asked for.

    Node n is `states[n]`, with actions `actions[n]` (canonical order) leading to the nodes
    `successor[first[n] : first[n] + count[n]]` once it is expanded (`count[n]` > 0).
    `pattern[n, task]` has bit m set where the cue of approval m is on; `reach[n, d, task]` has it
    set where the cue is on in some state that 1 to d steps from n lead to; `climb[n, d, task]` is the most
    that d steps on one path from n can collect where each state pays `worth[m]` for each cue that
    is on; `run[n, d, task]` numbers runs of adjacent tasks that no path of d steps from n can tell apart
    (all filled up to `depth[n]`). `cue` (M,) are the rows of `world.cues(state)` that the teacher
    model uses.
    """

    def __init__(
        self, world: World, cue: NDArray[np.int64], worth: NDArray[np.float64], horizon: int
    ) -> None:
        if len(cue) > MAX_CUES:
            raise ValueError(f"at most {MAX_CUES} approval states, not {len(cue)}")
        self.world, self.cue, self.worth, self.horizon = world, cue, worth, horizon
        self.states: list[Any] = []
        self.actions: list[tuple[Any, ...]] = []
        self._index: dict[Hashable, int] = {}
        self._bits = (1 << np.arange(len(cue))).astype(np.uint16)[:, None]
        tasks = len(world.tasks)
        self.first = np.zeros(256, dtype=np.int64)
        self.count = np.zeros(256, dtype=np.int64)
        self.depth = np.zeros(256, dtype=np.int64)
        self.pattern = np.zeros((256, tasks), dtype=np.uint16)
        self.pay = np.zeros((256, tasks))
        self.reach = np.zeros((256, horizon + 1, tasks), dtype=np.uint16)
        self.climb = np.zeros((256, horizon + 1, tasks))
        self.run = np.zeros((256, horizon + 1, tasks), dtype=np.int32)
        self.successor = np.zeros(1024, dtype=np.int64)
        self._used = 0

    def node(self, state: Hashable) -> int:
        """The number of a state, new ones being added."""
        index = self._index.get(state)
        if index is not None:
            return index
        index = len(self.states)
        if index == len(self.first):
            for name in ("first", "count", "depth", "pattern", "pay", "reach", "climb", "run"):
                setattr(self, name, _doubled(getattr(self, name)))
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
        while self._used + len(actions) > len(self.successor):
            self.successor = _doubled(self.successor)
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
        shown = self.pattern[after]
        self.reach[node, steps] = np.bitwise_or.reduce(shown | self.reach[after, steps - 1], axis=0)
        self.climb[node, steps] = (self.pay[after] + self.climb[after, steps - 1]).max(axis=0)
        differ = np.diff(shown, axis=1) != 0
        if steps > 1:
            differ |= np.diff(self.run[after, steps - 1], axis=1) != 0
        self.run[node, steps, 1:] = np.cumsum(differ.any(axis=0))
        self.depth[node] = steps

    def _after(self, node: int) -> list[int]:
        first = self.first[node]
        return self.successor[first : first + self.count[node]].tolist()  # type: ignore[no-any-return]


def _doubled(array: NDArray[Any]) -> NDArray[Any]:
    return np.concatenate([array, np.zeros_like(array)])
