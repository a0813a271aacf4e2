"""Things of a world that are alike: what differs only in which of them it takes is worth the same.

Let g exchange two things, in states, actions and tasks, and let it change neither belief b nor state w. Then
Q_h(b, w, g a) = Q_h(b, w, a), and after an action that g does not change, it changes nothing of what follows
(MODEL.md, section 6).
"""

from collections.abc import Sequence
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taskcomm.belief import Belief
from taskcomm.world import World

MOST = 11  # things looked at, the first: their pairs fit into a word of 64 bits
ROUNDING = 1e-13  # relative difference of weights that are equal but for rounding


class Exchanges:
    """The pairs of things that may be exchanged, as bits of a word; none in a World that says nothing of it.

    See `World` for its `alike` and `exchanged`.
    """

    def __init__(self, world: World) -> None:
        self.tasks = world.tasks
        self._start = world.start()
        self._world: Any = world if hasattr(world, "alike") and hasattr(world, "exchanged") else None
        self._masks: dict[Any, tuple[int, int]] = {}

    @cached_property
    def pairs(self) -> list[tuple[Any, Any]]:
        """The pair of bit k."""
        return list(combinations(list(self._world.alike(self._start))[:MOST], 2))

    def masks(self, action: Any) -> tuple[int, int]:
        """The pairs whose exchange changes `action`, and those that make of it one that is earlier.

        Earlier in alphabetical order, or any that does not depend on the state.
        """
        if self._world is None:
            return 0, 0
        found = self._masks.get(action)
        if found is None:
            own, changes, earlier = str(action), 0, 0
            for k in range(len(self.pairs)):
                other = str(self._exchanged(action, k))
                changes |= (other != own) << k
                earlier |= (other < own) << k
            found = self._masks[action] = changes, earlier
        return found

    def alike(self, belief: Belief, state: Any) -> int:
        """The pairs whose exchange changes neither the state nor the belief."""
        if self._world is None:
            return 0
        label, marginal, pairs = self._world.alike(state), belief.marginal(), 0
        for k, (one, other) in enumerate(self.pairs):
            if label[one] == label[other]:
                order = self._orders[k]
                if _close(marginal[order], marginal) and _unchanged(belief, order):
                    pairs |= 1 << k
        return pairs

    def instead(self, actions: Sequence[Any], pairs: int) -> NDArray[np.int64]:
        """For each of the `actions`, the number of the one that is searched for it, where `pairs` are alike:
        its own, unless an exchange makes an earlier one of it."""
        number = {action: a for a, action in enumerate(actions)}
        return np.array([number[self._first(action, pairs)] for action in actions], dtype=np.int64)

    def _first(self, action: Any, pairs: int) -> Any:
        while earlier := self.masks(action)[1] & pairs:
            action = self._exchanged(action, earlier.bit_length() - 1)
        return action

    def _exchanged(self, value: Any, k: int) -> Any:
        return self._world.exchanged(value, *self.pairs[k])

    @cached_property
    def _orders(self) -> list[NDArray[np.int64]]:
        """For each pair, the number of what each task becomes."""
        number = {task: t for t, task in enumerate(self.tasks)}
        return [
            np.array([number[self._exchanged(task, k)] for task in self.tasks])
            for k in range(len(self.pairs))
        ]


def _close(one: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    return bool((np.abs(one - other) <= ROUNDING * other).all())


def _unchanged(belief: Belief, order: NDArray[np.int64]) -> bool:
    """Whether the belief is the same when task t becomes task order[t]."""
    exchanged = order[belief.task]
    own, new = np.argsort(belief.task, kind="stable"), np.argsort(exchanged, kind="stable")
    return bool(
        (belief.task[own] == exchanged[new]).all()
        and _close(belief.weight[new], belief.weight[own])
        and (belief.level[own] == belief.level[new]).all()
        and (belief.on_time[own] == belief.on_time[new]).all()
        and (belief.seen == belief.seen[:, :, order]).all()
    )
