"""The objective of a fit with one of its parameters held: what a profile likelihood climbs."""

import math
from collections.abc import Callable

import numpy as np

from learn.mstep import Objective
from taskcomm.lattice import Floats


class Slice:
    """The objective with one parameter held, as a function of the `rest` of the coordinates.

    Held is, at `value`, coordinate `held` itself where it is a time; where it is the odds of mistake or a
    peak p, the log odds of p against all else, log(p / (1 - p)), or with `over` (the coordinate of a rise
    or a fall) log(p / rise). So an interval for p is one for p, not for its odds against waiting.
    """

    def __init__(self, objective: Objective, held: int, over: int | None = None) -> None:
        space = objective.space
        self.objective, self.held, self.over = objective, held, over
        self.keep = np.delete(np.arange(len(space.index)), held)
        self.least, self.most = space.least[self.keep], space.most[self.keep]
        self._odds = self.keep[self.keep < len(space.odds)] if held < len(space.odds) else None

    def value(self, point: Floats) -> float:
        """What is held, at a point."""
        space = self.objective.space
        if self._odds is None:
            return float(point[self.held])
        p = float(space.vector(point)[space.index[self.held]])
        if self.over is None:
            return _log_odds(p, space.room)
        return math.log(p) - float(point[self.over])

    def point(self, value: float, rest: Floats) -> Floats:
        """All coordinates; not a number where none has this value."""
        point = np.empty(len(rest) + 1)
        point[self.keep], point[self.held] = rest, value
        if self._odds is not None:
            if self.over is not None:
                value = _log_odds(math.exp(value + point[self.over]), self.objective.space.room)
            point[self.held] = value + _log_all_else(point[self._odds])
        return point

    def natural(self, point: Floats) -> float:
        """The parameter, or the ratio, at a point."""
        space = self.objective.space
        own = float(space.vector(point)[space.index[self.held]])
        return own if self.over is None else own / float(space.vector(point)[space.index[self.over]])

    def at(self, value: float) -> Callable[[Floats], tuple[float, Floats]]:
        """The objective and its rates in the rest."""

        def function(rest: Floats) -> tuple[float, Floats]:
            point = self.point(value, rest)
            if not np.isfinite(point).all():
                return -math.inf, np.zeros_like(rest)
            there, rates = self.objective.value_and_rates(point)
            return there, rates[self.keep] + rates[self.held] * self.slopes(point)

        return function

    def slopes(self, point: Floats) -> Floats:
        """How the held coordinate must move with each of the rest."""
        slopes = np.zeros(len(point))
        if self._odds is None:
            return slopes[1:]
        slopes[self._odds] = np.exp(point[self._odds] - _log_all_else(point[self._odds]))
        if self.over is not None:
            slopes[self.over] = self.stretch(point)
        return slopes[self.keep]

    def stretch(self, point: Floats) -> float:
        """How the held coordinate moves with the value."""
        if self._odds is None or self.over is None:
            return 1.0
        space = self.objective.space
        return float(1.0 / (1.0 - space.vector(point)[space.index[self.held]] / space.room))

    def bend(self, point: Floats, bend: Floats) -> Floats:
        """The information in (rest, value) from that in the coordinates, at an optimum."""
        change = np.zeros_like(bend)
        change[self.keep, np.arange(len(self.keep))] = 1.0
        change[self.held] = np.append(self.slopes(point), self.stretch(point))
        return np.asarray(change.T @ bend @ change)


def _log_odds(p: float, room: float) -> float:
    p /= room
    return math.log(p) - math.log1p(-p) if 0 < p < 1 else math.nan


def _log_all_else(odds: Floats) -> float:
    """log(1 + sum of exp(odds)), without overflow."""
    top = max(0.0, *odds.tolist()) if len(odds) else 0.0
    return top + math.log(math.exp(-top) + float(np.exp(odds - top).sum()))
