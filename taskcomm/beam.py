"""Which memories of a trial are too improbable to be kept, and how much is lost with them.

Where a key state is unknown, or a key can miss, a reset is possible in every such step and memories
multiply. A beam keeps the probable ones. What is left out makes the likelihood smaller, never larger, so
a fit on a pruned lattice climbs a lower bound of the likelihood; how far below it can be is known at the
parameters that the beam was made with.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from taskcomm.levels import advance, approval_probability
from taskcomm.teacher import Parameters

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


class Beam(NamedTuple):
    """At each event, memories are left out that hold no more than `mass` of the weight together.

    The weight is that of the filter at `parameters`: P(memory | observations up to the event).
    """

    parameters: Parameters
    mass: float


class Ray:
    """A beam along one unit: the filter over its memories, and the bound on what was left out.

    `bound` is how much higher, at most, the log-likelihood would be with all memories, in nats. A path left
    out at an event has the weight D it had there; what follows multiplies it by no more than U, the
    product over the later steps of the greatest probability of their observations over all levels that any
    reset could leave. So exact <= pruned + sum of D U. It is infinite where what is left cannot be what was
    observed, at the parameters of the beam: a later label, say, needs what was left out.
    """

    def __init__(
        self, beam: Beam, cues: Bools, rests: NDArray[np.uint8], weights: Floats, events: Ints
    ) -> None:
        self._mass, self._weights, self._mistake = beam.mass, weights, beam.parameters.mistake
        self._first = np.concatenate([[0], events + 1])
        self._events = events
        self._probability = _approvals(beam.parameters, cues, rests, np.concatenate([[-1], events]))
        self._filter, self._log = np.ones(1), 0.0
        self._lost: list[float] = []
        self._possible = True
        self._future = self._greatest_future()
        self.bound = 0.0

    def _greatest_future(self) -> Floats:
        """Log of the greatest probability of all observations after each step, (T + 1,)."""
        most, least = self._probability.max(axis=1), self._probability.min(axis=1)  # (M, T)
        quiet = 1 - self._mistake - least.sum(axis=0)
        each = [self._weights[:, 0] * quiet, self._weights[:, 1] * self._mistake]
        each += [self._weights[:, 2 + m] * row for m, row in enumerate(most)]
        with np.errstate(divide="ignore"):
            steps = np.log(np.sum(each, axis=0))
        return np.append(np.cumsum(steps[::-1])[::-1], 0.0)

    def _silence(self, memories: Ints, first: int, end: int) -> Floats:
        """Log-probability of the steps from `first` up to `end`, which are no events, by memory."""
        approvals = sum(self._probability[m, memories[:, m], first:end] for m in range(memories.shape[1]))
        with np.errstate(divide="ignore"):
            steps = np.log(self._weights[first:end, 0] * (1 - self._mistake - approvals))
        return np.asarray(steps.sum(axis=1))

    def _arrive(self, memories: Ints, first: int, end: int) -> None:
        """The filter of a layer's memories, when its event comes."""
        with np.errstate(divide="ignore"):
            logs = np.log(self._filter) + self._silence(memories, first, end)
        best = float(logs.max())
        self._filter = np.exp(logs - best)
        self._log += best

    def pruned(self, before: Ints, k: int, after: Ints, move: Ints) -> tuple[Ints, Ints]:
        """The memories after event k and where the old ones go, without what is too improbable."""
        step, states = int(self._events[k]), before.shape[1]
        self._arrive(before, int(self._first[k]), step)
        own = np.stack([self._probability[m, before[:, m], step] for m in range(states)], axis=1)
        weight = self._weights[step]
        chance = np.column_stack(
            [weight[0] * (1 - self._mistake - own.sum(axis=1)) + weight[1] * self._mistake, weight[2:] * own]
        )
        reached = np.zeros(len(after))
        rows, resets = np.nonzero(move >= 0)
        np.add.at(reached, move[rows, resets], self._filter[rows] * chance[rows, resets])
        total = float(reached.sum())
        if not total > 0:  # impossible at these parameters: nothing to judge by
            self._filter, self._possible = np.full(len(after), 1 / len(after)), False
            return after, move
        self._log += math.log(total)
        reached /= total
        order = np.argsort(reached, kind="stable")
        gone = order[: int(np.searchsorted(np.cumsum(reached[order]), self._mass, side="right"))]
        lost = float(reached[gone].sum())
        if lost > 0:
            self._lost.append(math.log(lost) + self._log + self._future[step + 1])
        kept = np.setdiff1d(np.arange(len(after)), gone)
        where = np.full(len(after) + 1, -1, dtype=np.int64)  # the last is where -1 points
        where[kept] = np.arange(len(kept))
        self._filter = reached[kept] / (1 - lost)
        self._log += math.log1p(-lost)
        return after[kept], where[move]

    def finish(self, memories: Ints) -> None:
        """After the last event: the likelihood itself, and the bound."""
        if not self._possible:
            self.bound = math.inf if self._lost else 0.0
            return
        steps = len(self._weights)
        self._arrive(memories, int(self._first[-1]), steps)
        likelihood = self._log + math.log(float(self._filter.sum()))
        if self._lost:
            self.bound = float(np.logaddexp(0.0, np.logaddexp.reduce(self._lost) - likelihood))


def _approvals(parameters: Parameters, cues: Bools, rests: NDArray[np.uint8], resets: Ints) -> Floats:
    """P(M_t = m | last reset of m), shape (M, resets, T); before the reset, what it is without any."""
    steps, states = cues.shape
    level, on_time = np.zeros((2, len(resets), states))
    result = np.zeros((states, len(resets), steps))
    at = np.arange(states)
    seen = np.concatenate([np.zeros((int(parameters.steps_late.max()) + 1, states), dtype=np.bool_), cues])
    offset = len(seen) - steps
    for t in range(steps):
        newest = t + offset - parameters.steps_late
        older, newer = seen[newest - 1, at], seen[newest, at]
        level, on_time = advance(level, on_time, older, newer, parameters)
        probability = approval_probability(level, on_time, bool(rests[t]), parameters)
        result[:, :, t] = probability.T
        level[resets == t] = 0.0
        on_time[resets == t] = 0.0
    return result
