"""Climbing a function that is smooth only piecewise, within bounds.

A quasi-Newton (BFGS) metric with a line search by bisection that asks for a weak Wolfe condition
climbs such functions well, up to kinks and along them (Lewis and Overton, Nonsmooth optimization via
quasi-Newton methods, 2013).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from taskcomm.lattice import Bools, Floats

Function = Callable[[Floats], tuple[float, Floats]]
ENOUGH_RISE, LESS_STEEP = 1e-4, 0.5


@dataclass
class Climb:
    """Where a climb stands: the best point, its value and rates, and the metric (inverse curvature)."""

    point: Floats
    value: float
    rates: Floats
    metric: Floats | None = None
    stuck: bool = False


def _free(climb: Climb, least: Floats, most: Floats) -> Floats:
    """1 for coordinates that may move uphill, 0 for those held at a bound."""
    below = (climb.point <= least) & (climb.rates < 0)
    above = (climb.point >= most) & (climb.rates > 0)
    return np.where(below | above, 0.0, 1.0)


def climb_from(function: Function, point: Floats) -> Climb:
    """The start of a climb."""
    value, rates = function(point)
    return Climb(point, value, rates)


def ascend(
    function: Function, climb: Climb, least: Floats, most: Floats, steps: int, gain: float = 0.0
) -> Climb:
    """At most `steps` quasi-Newton steps uphill; the value never falls.

    `function` gives value and rates; a value of -inf or nan is a place not to go. Ends `stuck` where no
    step along the metric's direction, then along the rates, rises by more than `gain`.
    """
    for _ in range(steps):
        reset = climb.metric is None
        after = _step(function, climb, least, most, gain)
        if after is None and not reset:
            after = _step(function, Climb(climb.point, climb.value, climb.rates), least, most, gain)
        if after is None:
            climb.stuck = True
            return climb
        climb = after
    return climb


def _step(function: Function, climb: Climb, least: Floats, most: Floats, gain: float) -> Climb | None:
    free = _free(climb, least, most)
    rates = climb.rates * free
    size = float(np.linalg.norm(rates))
    if size == 0.0 or not math.isfinite(size):
        return None
    metric = np.eye(len(rates)) * (0.3 / size) if climb.metric is None else climb.metric
    direction = _direction(metric, rates, free > 0)
    if not float(direction @ rates) > 0.0:
        return None
    longest = float(np.abs(direction).max())
    direction = direction * min(1.0, 3.0 / longest)  # a factor of 20 in one step is enough
    found = _line_search(function, climb, direction, least, most)
    if found is None or not found.value - climb.value > gain:
        return None
    found.metric = _updated(climb, found, climb.metric)
    return found


def _direction(metric: Floats, rates: Floats, free: Bools) -> Floats:
    """The quasi-Newton step of the free coordinates, the others held where they are."""
    direction = np.zeros_like(rates)
    inner = metric[np.ix_(free, free)]
    if not free.all():
        across = metric[np.ix_(free, ~free)]
        inner = inner - across @ np.linalg.pinv(metric[np.ix_(~free, ~free)]) @ across.T
    direction[free] = inner @ rates[free]
    return direction


def _line_search(
    function: Function, climb: Climb, direction: Floats, least: Floats, most: Floats
) -> Climb | None:
    """A point with a higher value where, if possible, the slope along the way has halved."""
    slope = float(direction @ climb.rates)
    low, high, length = 0.0, math.inf, 1.0
    best: Climb | None = None
    for _ in range(40):
        reached = climb.point + length * direction
        point = np.clip(reached, least, most)
        value, rates = function(point)
        if not value >= climb.value + ENOUGH_RISE * length * slope:  # -inf and nan fail too
            high = length
        else:
            if best is None or value > best.value:
                best = Climb(point, value, rates)
            moving = np.where((reached < least) | (reached > most), 0.0, direction)
            if float(moving @ rates) <= LESS_STEEP * slope:
                return Climb(point, value, rates)
            low = length
        length = 2 * low if math.isinf(high) else (low + high) / 2
        if high - low < 1e-14 * (1 + high):
            break
    return best


def _updated(before: Climb, after: Climb, metric: Floats | None) -> Floats | None:
    """The BFGS metric after a step; unchanged where the step shows no downward curvature."""
    step, bend = after.point - before.point, before.rates - after.rates
    product = float(step @ bend)
    if not product > 1e-14 * float(np.linalg.norm(step) * np.linalg.norm(bend)):
        return metric
    if metric is None:
        metric = np.eye(len(step)) * (product / float(bend @ bend))
    shear = np.eye(len(step)) - np.outer(step, bend) / product
    return np.asarray(shear @ metric @ shear.T + np.outer(step, step) / product, dtype=np.float64)
