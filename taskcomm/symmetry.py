"""Symmetry reduction: of actions that differ only in which of things that are alike they take, one is left.

Let g exchange two things, in states, actions and tasks, and let it change neither belief b nor state w. Then
Q_h(b, w, g a) = Q_h(b, w, a), and after an action that g does not change, it changes nothing of what follows
(MODEL.md, section 6).
"""

from collections.abc import Sequence
from functools import cached_property
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from taskcomm.belief import Belief
from taskcomm.world import World

MOST = 64  # pairs of things looked at, the first
ROUNDING = 1e-13  # relative difference of weights that are equal but for rounding


class Reduced(NamedTuple):
    """A state, and the pairs of things that neither it nor what is believed tells apart: bits of a number."""

    state: Any
    pairs: int

    def __str__(self) -> str:
        return str(self.state)


def says_what_is_alike(world: World) -> bool:
    """Whether the World has `alike` and `exchanged`, and they speak of it as it is.

    Not so where a class has them from another whose tasks, actions, states or cues it has changed.
    """
    said = [_defined(world, name) for name in ("alike", "exchanged")]
    done = [_defined(world, name) for name in ("tasks", "start", "actions", "step", "cues")]
    return None not in said and all(a <= b for a in said for b in done if a is not None and b is not None)


def _defined(world: World, name: str) -> int | None:
    """How far up the classes of the world an attribute is defined; -1 for a method of its own."""
    if callable(getattr(world, "__dict__", {}).get(name)):
        return -1
    return next((k for k, one in enumerate(type(world).__mro__) if name in vars(one)), None)


class ReducedWorld:
    """The World with fewer actions: those that an exchange makes an earlier action of are left out.

    Earlier as text, the shorter first, so that it does not depend on the state. One action is left of all
    that exchanges make of one another. Raises ValueError where an exchange makes what is no task or action.
    """

    def __init__(self, world: Any) -> None:
        self.world, self.tasks, self.cue_names = world, world.tasks, world.cue_names
        self._masks: dict[Any, tuple[int, int]] = {}

    def start(self) -> Reduced:
        """The World's, with nothing alike."""
        return Reduced(self.world.start(), 0)

    def actions(self, at: Reduced) -> Sequence[Any]:
        """Those left, in canonical order."""
        actions: Sequence[Any] = self.world.actions(at.state)
        if at.pairs == 0:
            return actions
        return [action for action in actions if not self._exchanges(action)[1] & at.pairs]

    def step(self, at: Reduced, action: Any) -> Reduced:
        """The next state; what the action does not change is as much alike as before."""
        pairs = at.pairs and at.pairs & ~self._exchanges(action)[0]
        return Reduced(self.world.step(at.state, action), pairs)

    def cues(self, at: Reduced) -> NDArray[np.bool_]:
        """The World's."""
        return np.asarray(self.world.cues(at.state), dtype=np.bool_)

    def reduced(self, belief: Belief, state: Any) -> Reduced:
        """The state, with what neither it nor the belief tells apart."""
        told, bit, pairs = _Told(belief), self._bit, 0
        groups: list[list[Any]] = []
        label = self.world.alike(state)
        for thing in label:
            for group in groups:  # what is alike to one of a group is alike to all
                pair = group[0], thing
                if (
                    label[group[0]] == label[thing]
                    and pair in bit
                    and told.unchanged(self._orders[bit[pair]])
                ):
                    pairs |= sum(1 << bit[one, thing] for one in group if (one, thing) in bit)
                    group.append(thing)
                    break
            else:
                groups.append([thing])
        return Reduced(state, pairs)

    def instead(self, at: Reduced) -> list[int]:
        """By action of the World, the number of the one that is left for it."""
        number = {action: a for a, action in enumerate(self.actions(at))}
        left = [self._left(action, at.pairs) for action in self.world.actions(at.state)]
        for action in left:
            if action not in number:
                raise ValueError(
                    f"alike: exchanges make {action} of an action in {at}, where there is none such"
                )
        return [number[action] for action in left]

    @cached_property
    def pairs(self) -> list[tuple[Any, Any]]:
        """The pair of bit k."""
        return list(combinations(self.world.alike(self.world.start()), 2))[:MOST]

    @cached_property
    def _bit(self) -> dict[tuple[Any, Any], int]:
        return {pair: k for k, pair in enumerate(self.pairs)}

    @cached_property
    def _orders(self) -> list[NDArray[np.int64]]:
        """For each pair, the number of what each task becomes."""
        number = {task: t for t, task in enumerate(self.tasks)}
        orders = []
        for pair in self.pairs:
            become = [self.world.exchanged(task, *pair) for task in self.tasks]
            if set(become) != number.keys():
                raise ValueError(f"alike: to exchange {pair[0]} and {pair[1]} makes of tasks what is none")
            orders.append(np.array([number[task] for task in become]))
        return orders

    def _exchanges(self, action: Any) -> tuple[int, int]:
        """The pairs whose exchange changes the action, and those that make an earlier one of it."""
        found = self._masks.get(action)
        if found is None:
            own, changes, earlier = _order(action), 0, 0
            for k, pair in enumerate(self.pairs):
                other = _order(self.world.exchanged(action, *pair))
                changes |= (other != own) << k
                earlier |= (other < own) << k
            found = self._masks[action] = changes, earlier
        return found

    def _left(self, action: Any, pairs: int) -> Any:
        while earlier := self._exchanges(action)[1] & pairs:
            action = self.world.exchanged(action, *self.pairs[earlier.bit_length() - 1])
        return action


def _order(action: Any) -> tuple[int, str]:
    text = str(action)
    return len(text), text


class _Told:
    """What a belief tells apart."""

    def __init__(self, belief: Belief) -> None:
        self.belief = belief

    def unchanged(self, order: NDArray[np.int64]) -> bool:
        """Whether the belief is the same when task t becomes task order[t]."""
        if not _close(self._marginal[order], self._marginal):
            return False
        belief, own = self.belief, self._rows
        new = np.argsort(order[belief.task], kind="stable")
        return bool(
            (belief.task[own] == order[belief.task][new]).all()
            and _close(belief.weight[new], belief.weight[own])
            and (belief.level[own] == belief.level[new]).all()
            and (belief.on_time[own] == belief.on_time[new]).all()
            and (belief.seen == belief.seen[:, :, order]).all()
        )

    @cached_property
    def _marginal(self) -> NDArray[np.float64]:
        return self.belief.marginal()

    @cached_property
    def _rows(self) -> NDArray[np.int64]:
        return np.argsort(self.belief.task, kind="stable")


def _close(one: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    return bool((np.abs(one - other) <= ROUNDING * other).all())
