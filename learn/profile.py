"""Profile likelihood: how far one parameter can go while the others make up for it as well as they can.

Holds where the log-likelihood has kinks, bounds and ridges, on which its curvature says nothing.
"""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from learn.ascent import Climb, ascend, climb_from
from learn.optimum import breakpoints
from learn.slices import Slice
from taskcomm.lattice import Floats

STEPS, GAIN = 30, 1e-3  # of each climb, in nats
CLOSE = 0.01  # of the drop to the one asked for, in nats
BEYOND = 2.0  # nats below it at which no separate piece is looked for any more
MOST_POINTS = 60
LOOKS, GRID, BEST, AGAIN = 4, 10, 2, 0.03
LIMITS_AT_REST = ("delay", "hold")  # whose least value, 0, ends them; others are open there
SLOPE = 0.05


@dataclass
class End:
    """One end of an interval: the `value` held there, the `point`, and whether the end is open: the
    log-likelihood has not dropped enough where a bound was met."""

    value: float
    point: Floats
    open: bool


class Visit(NamedTuple):
    """A value, how far down the log-likelihood is there (nats), and where the rest of the coordinates are."""

    value: float
    drop: float
    rest: Floats


@dataclass
class Profile:
    """The log-likelihood over one parameter, the rest at their best: walked outward from an optimum.

    `visits` are the places that were climbed to.
    """

    slice: Slice
    centre: Floats
    top: float
    bend: Floats
    visits: list[Visit] = field(default_factory=list)

    def __post_init__(self) -> None:
        inner = self.slice.bend(self.centre, self.bend)
        sizes, axes = np.linalg.eigh(inner[:-1, :-1])
        self._metric = np.asarray((axes / np.maximum(sizes, 1.0)) @ axes.T)
        self._tangent = -self._metric @ inner[:-1, -1]
        left = float(inner[-1, -1] + inner[:-1, -1] @ self._tangent)
        self._step = 0.5 / math.sqrt(left) if left > 1.0 else 0.5
        self._start = self.slice.value(self.centre)

    def _best(self, value: float, rest: Floats, steps: int = STEPS, gain: float = GAIN) -> Visit:
        """The place with `value` held and the rest at their best, climbing from `rest`."""
        inside = self.slice
        function = inside.at(value)
        climb: Climb = climb_from(function, np.clip(rest, inside.least, inside.most))
        climb.metric = self._metric
        if math.isfinite(climb.value):
            climb = ascend(function, climb, inside.least, inside.most, steps, gain)
        self.visits.append(Visit(value, self.top - climb.value, climb.point))
        return self.visits[-1]

    @property
    def above(self) -> float:
        """How much higher than the optimum some place was, in nats: more than a little, and it was none."""
        return max([0.0, *(-visit.drop for visit in self.visits)])

    def highest(self) -> Floats:
        """The highest place of all, in all coordinates."""
        best = min(self.visits, key=lambda visit: visit.drop, default=None)
        if best is None or best.drop >= 0:
            return self.centre
        return self.slice.point(best.value, best.rest)

    def within(self, drop: float) -> Floats:
        """The natural parameters of the places visited that are at most `drop` down, (places, 1 + 6 M)."""
        vector, point = self.slice.objective.space.vector, self.slice.point
        inside = [visit for visit in self.visits if visit.drop <= drop]
        size = len(self.slice.objective.space.base)
        return np.array([vector(point(v.value, v.rest)) for v in inside]).reshape(len(inside), size)

    def end(self, direction: int, drop: float) -> End:
        """Where the log-likelihood is last `drop` nats below the optimum, going up (1) or down (-1).

        The walk goes on until it is BEYOND further down, in case it rises again; and from the end found, if
        climbs from elsewhere find it higher there. That is not rare even where the end is as far as the
        curvature at the optimum has it: climbs end at kinks.
        """
        space, held = self.slice.objective.space, self.slice.held
        limit = float((space.least if direction < 0 else space.most)[held])
        here = Visit(self._start, 0.0, self.centre[self.slice.keep])
        for _ in range(LOOKS):
            inside, outside = self._walk(here, direction, drop, limit)
            if outside is None:
                return self._open(inside, direction)
            at = self._crossing(inside, outside, drop)
            here = self._looked_again(at)
            if here.drop > at.drop - AGAIN:
                break
        opens = direction > 0 and self._needs_longer_rise(at)
        return End(at.value, self.slice.point(at.value, at.rest), opens)

    def swept(self, values: Floats) -> list[Visit]:
        """The places with these values, in order and the optimum among them: climbed to from the next place
        inward and outward, and from elsewhere."""
        here = Visit(self._start, 0.0, self.centre[self.slice.keep])
        places = [here]
        for way in (values[values > here.value], values[values < here.value][::-1]):
            last = here
            for value in way.tolist():
                last = self._looked_again(self._best(value, last.rest))
                places.append(last)
        places.sort(key=lambda visit: visit.value)
        for order in (range(1, len(places)), range(len(places) - 2, -1, -1)):
            for i in order:
                beside = places[i - 1] if order.step > 0 else places[i + 1]
                again = self._best(places[i].value, beside.rest)
                places[i] = min(places[i], again, key=lambda visit: visit.drop)
        return places

    def _walk(self, here: Visit, direction: int, drop: float, limit: float) -> tuple[Visit, Visit | None]:
        """The last place visited that is less than `drop` down, and the one after it, if any."""
        held, space = self.slice.held, self.slice.objective.space
        stops = breakpoints(space, held) if held >= len(space.odds) else np.zeros(0)
        slope, step = self._tangent, self._step
        inside, outside = here, None
        for _ in range(MOST_POINTS):
            if (limit - here.value) * direction <= 1e-9 or here.drop > drop + BEYOND:
                break
            there = _snapped(here.value + direction * step, stops, 0.35 * step)
            there = min(there, limit) if direction > 0 else max(there, limit)
            after = self._best(there, here.rest + slope * (there - here.value))
            slope = (after.rest - here.rest) / (there - here.value)
            change, here = after.drop - here.drop, after
            if here.drop < drop:
                inside, outside = here, None
            elif outside is None:
                outside = here
            step *= 1.6 if change < 0.3 else (0.6 if change > 1.0 else 1.0)
        return inside, outside

    def _looked_again(self, at: Visit) -> Visit:
        """The same place, the rest climbed to from elsewhere, if that is better.

        What is missed is mostly a rise or fall across breakpoints: the best of moving each of them anywhere
        are climbed from, and one random point.
        """
        function = self.slice.at(at.value)
        starts = [at.rest + np.random.default_rng(len(self.visits)).normal(0, 0.5, len(at.rest))]
        moved = []
        for i in self._doubtful():
            for value in np.linspace(self.slice.least[i], self.slice.most[i], GRID):
                start = at.rest.copy()
                start[i] = value
                moved.append((function(start)[0], start))
        starts += [start for _, start in sorted(moved, key=lambda pair: -pair[0])[:BEST]]
        return min((at, *(self._best(at.value, start) for start in starts)), key=lambda visit: visit.drop)

    def _doubtful(self) -> list[int]:
        """The places in the rest of the times of the held parameter's state; of all states for mistake."""
        space, inside = self.slice.objective.space, self.slice
        state = (space.index - 1) % space.states
        own = inside.held < len(space.odds) and space.index[inside.held] == 0
        return [
            place
            for place, i in enumerate(inside.keep)
            if space.kinds[i] != "odds" and (own or state[i] == state[inside.held])
        ]

    def _open(self, inside: Visit, direction: int) -> End:
        kind = self.slice.objective.space.kinds[self.slice.held]
        at_rest = direction < 0 and (kind in LIMITS_AT_REST or kind == "odds")
        return End(inside.value, self.slice.point(inside.value, inside.rest), not at_rest)

    def _crossing(self, inside: Visit, outside: Visit, drop: float) -> Visit:
        """Where the drop is the one asked for: its root is nearly a line in the value.

        Beyond where a value is possible at all, it is the last that was found possible.
        """
        aim = math.sqrt(drop)
        for _ in range(8 if outside.drop < math.inf else 16):
            a, b = math.sqrt(max(inside.drop, 0.0)), math.sqrt(outside.drop)
            share = float(np.clip((aim - a) / (b - a), 0.05, 0.95)) if b < math.inf else 0.5
            value = inside.value + share * (outside.value - inside.value)
            found = self._best(value, inside.rest + share * (outside.rest - inside.rest))
            if abs(found.drop - drop) < CLOSE:
                return found
            inside, outside = (found, outside) if found.drop < drop else (inside, found)
        return outside if outside.drop < math.inf else inside

    def _needs_longer_rise(self, at: Visit) -> bool:
        """Whether a peak could be greater still if its rise were not at its longest."""
        inside, space = self.slice, self.slice.objective.space
        state = int(space.index[inside.held]) - 1
        if inside.held >= len(space.odds) or state < 0 or inside.over is not None:
            return False
        rise = np.flatnonzero(space.index[inside.keep] == 1 + space.states + state)
        if not (at.rest[rise] >= inside.most[rise] - 1e-9).any():
            return False
        return bool((inside.at(at.value)(at.rest)[1][rise] > SLOPE).any())


def _snapped(value: float, stops: Floats, reach: float) -> float:
    """The nearest of the places where levels meet the lattice, if within reach."""
    if not len(stops):
        return value
    nearest = float(stops[np.abs(stops - value).argmin()])
    return nearest if abs(nearest - value) <= reach else value
