"""Is it an optimum? One-sided slopes, and the search across breakpoints that EM cannot do.

The log-likelihood is smooth only piecewise in rise, fall and delay: levels reach 0 and 1 on the time
lattice. So the test of an optimum is that no one-sided slope rises, along any coordinate either way
or along a fan of directions in the (rise, fall) plane of any approval state (MODEL.md, section 7).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from learn.ascent import ascend, climb_from
from learn.coordinates import Coordinates
from learn.mstep import Objective
from taskcomm.lattice import Floats

TOLERANCE = 0.01
REACH = 1e-6
COARSE = 1e-4
FAN = 32
NEAR, MOST, APART = 10.0, 6, 0.5
Value = Callable[[Floats], float]


@dataclass(frozen=True)
class Slopes:
    """One-sided slopes of a function at a point, in nats per unit of coordinate.

    `directions` (n, coordinates) are of unit length; `slopes` (n,) those of moving along them, -inf
    where that leaves the bounds. `up` and `down` (coordinates,) are those of each coordinate alone.
    """

    directions: Floats
    slopes: Floats
    up: Floats
    down: Floats

    @property
    def steepest(self) -> float:
        """The greatest slope: at an optimum, not above the tolerance."""
        return float(self.slopes.max(initial=-math.inf))


def directions_of(space: Coordinates) -> Floats:
    """Plus and minus every coordinate, then a fan in every (log rise, log fall) plane."""
    index = space.index.tolist()
    states = space.states
    axes = np.eye(len(index))
    rows = [axes, -axes]
    angles = 2 * np.pi * (np.arange(FAN) + 0.5) / FAN
    for m in range(states):
        rise, fall = 1 + states + m, 1 + 2 * states + m
        if rise in index and fall in index:
            plane = np.outer(np.cos(angles), axes[index.index(rise)])
            rows.append(plane + np.outer(np.sin(angles), axes[index.index(fall)]))
    return np.concatenate(rows)


def one_sided_slopes(value: Value, space: Coordinates, point: Floats, reach: float = REACH) -> Slopes:
    """Slopes of `value` at `point` over a step of `reach`, along `directions_of(space)`."""
    directions, here = directions_of(space), value(point)
    slopes = np.full(len(directions), -math.inf)
    for i, direction in enumerate(directions):
        there = point + reach * direction
        if ((there >= space.least) & (there <= space.most)).all():
            slopes[i] = (value(there) - here) / reach
    return Slopes(directions, slopes, slopes[: len(point)], slopes[len(point) : 2 * len(point)])


def climb_line(value: Value, space: Coordinates, point: Floats, direction: Floats) -> tuple[Floats, float]:
    """The best point found on the ray from `point`: doubling steps while it rises, then golden section."""

    def at(length: float) -> float:
        return value(np.clip(point + length * direction, space.least, space.most))

    length, here, nearer = REACH, value(point), 0.0
    best, best_length = here, 0.0
    while (there := at(length)) > best and length < 8.0:
        nearer, best, best_length = best_length, there, length
        length *= 2.0
    low, high, ratio = nearer, length, (math.sqrt(5) - 1) / 2
    for _ in range(60):
        if high - low < 1e-13 + 1e-10 * high:
            break
        a, b = high - ratio * (high - low), low + ratio * (high - low)
        value_a, value_b = at(a), at(b)
        for there, where in ((value_a, a), (value_b, b)):
            if there > best:
                best, best_length = there, where
        low, high = (low, b) if value_a > value_b else (a, high)
    return np.clip(point + best_length * direction, space.least, space.most), best


def polish(
    objective: Objective, point: Floats, rng: np.random.Generator, rounds: int = 40
) -> tuple[Floats, Slopes]:
    """Climb until no one-sided slope is above TOLERANCE, or for `rounds`; the point and its slopes.

    Each round climbs from a point a little aside, since a climb that starts at a kink sees one side of
    it only, and then along the steepest of the one-sided slopes.
    """
    space = objective.space
    point, value = climb_smoothly(objective, point)
    slopes = one_sided_slopes(objective.value, space, point)
    for number in range(rounds):
        if slopes.steepest <= TOLERANCE:
            break
        before, aside = value, 10.0 ** -(2 + number % 4)
        nudged = np.clip(point + rng.normal(0, aside, len(point)), space.least, space.most)
        moved, there = climb_smoothly(objective, nudged)
        if there > value:
            point, value = moved, there
        else:
            direction = slopes.directions[int(slopes.slopes.argmax())]
            moved, there = climb_line(objective.value, space, point, direction)
            if there > value:
                point, value = climb_smoothly(objective, moved)
        if value > before:
            slopes = one_sided_slopes(objective.value, space, point)
    return point, slopes


def climb_smoothly(
    objective: Objective, point: Floats, steps: int = 300, gain: float = 0.0
) -> tuple[Floats, float]:
    """Quasi-Newton steps on the log-likelihood itself, restarted once where they get stuck.

    Stuck is a step that gains no more than `gain` nats.
    """
    value = -math.inf
    for _ in range(2):
        climb = climb_from(objective.value_and_rates, point)
        before = climb.value
        climb = ascend(
            objective.value_and_rates, climb, objective.space.least, objective.space.most, steps, gain
        )
        point, value = climb.point, climb.value
        if climb.value - before <= max(gain, 1e-9):
            break
    return point, value


def breakpoints(space: Coordinates, coordinate: int) -> Floats:
    """Values of one rise, fall or delay to try: a log grid, and those at which levels meet the lattice.

    A level that rises for n steps of dt reaches 1 at rise = n dt; over k on-off rounds, at n dt / k.
    """
    least, most = space.least[coordinate], space.most[coordinate]
    if space.kinds[coordinate] in ("delay", "hold"):
        lattice = np.arange(0.0, most + space.dt / 4, space.dt / 4)
        return np.asarray(lattice[(lattice >= least) & (lattice <= most)], dtype=np.float64)
    n, k = np.meshgrid(np.arange(1, 41), np.arange(1, 4))
    values = np.concatenate([np.log(np.unique(n * space.dt / k)), np.linspace(least, most, 25)])
    return np.unique(values[(values >= least) & (values <= most)])


def across_breakpoints(objective: Objective, point: Floats, value: float) -> tuple[Floats, float]:
    """The best point found by moving one rise, fall, delay, decay or hold, or a (rise, fall) pair, anywhere.

    The best places of each approval state, apart from one another and no more than NEAR nats down, are
    climbed from before they are judged: a better optimum is often lower before the rest has followed.
    """
    space = objective.space
    index = space.index.tolist()
    moved: list[tuple[int, float, Floats]] = []

    def attempt(state: int, coordinates: list[int], values: list[float]) -> None:
        trial = point.copy()
        trial[coordinates] = values
        moved.append((state, objective.value(trial), trial))

    for coordinate in range(len(space.odds), len(index)):
        for where in breakpoints(space, coordinate):
            attempt((index[coordinate] - 1) % space.states, [coordinate], [where])
    for m in range(space.states):
        rise, fall = 1 + space.states + m, 1 + 2 * space.states + m
        if rise in index and fall in index:
            pair = [index.index(rise), index.index(fall)]
            grids = [np.linspace(space.least[i], space.most[i], 11) for i in pair]
            for a in grids[0]:
                for b in grids[1]:
                    attempt(m, pair, [float(a), float(b)])
    best, best_value = point, value
    for start, there in _apart(moved, point, value - NEAR):
        climbed, reached = climb_smoothly(objective, start, gain=COARSE)
        for trial, level in ((start, there), (climbed, reached)):
            if level > best_value:
                best, best_value = trial, level
    return best, best_value


def _apart(moved: list[tuple[int, float, Floats]], point: Floats, least: float) -> list[tuple[Floats, float]]:
    """Of each state the MOST best places above `least`, each at least APART from `point` and the others."""
    kept: list[tuple[int, Floats, float]] = []
    for state, value, trial in sorted(moved, key=lambda move: -move[1]):
        own = [other for of, other, _ in kept if of == state]
        if (
            value > least
            and len(own) < MOST
            and all(np.abs(trial - at).max() > APART for at in (point, *own))
        ):
            kept.append((state, trial, value))
    return [(trial, value) for _, trial, value in kept]


def recombine(
    objective: Objective, point: Floats, value: float, others: list[Floats], near: float = 3.0
) -> tuple[Floats, float]:
    """The best of `point` and what comes of it with one approval state taken from another point.

    Approval states are nearly independent, so each may have its best values at the end of another
    start. Points within `near` nats are climbed from before they are judged.
    """
    space = objective.space
    states = space.states
    for m in range(states):
        own = np.flatnonzero((space.index - 1) % states == m)
        own = own[space.index[own] > 0]
        for other in others:
            trial = point.copy()
            trial[own] = other[own]
            if np.abs(trial - point).max(initial=0.0) < 1e-3:
                continue
            there = objective.value(trial)
            if there > value - near:
                trial, there = climb_smoothly(objective, trial, gain=COARSE)
            if there > value + 1e-9:
                point, value = trial, there
    return point, value
