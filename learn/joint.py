"""Table-tops and observation model climbed together, where both are learned.

EM moves them in turns, and slowly where they make up for each other: a key that misses often, or a low peak.
"""

import numpy as np

from learn.ascent import ascend, climb_from
from learn.emission_coordinates import FURTHEST, EmissionCoordinates
from learn.mstep import Objective
from learn.optimum import TOLERANCE, Slopes, one_sided_slopes, polish
from learn.path import Path
from taskcomm.lattice import Floats

STEPS, ROUNDS = 100, 6


class Joint:
    """The objective over both at once: the coordinates of the table-tops, then `EmissionCoordinates`."""

    def __init__(self, objective: Objective) -> None:
        assert objective.observing is not None
        self.objective, self.observing = objective, objective.observing
        self.emissions = EmissionCoordinates(self.observing)
        far = np.full(len(self.emissions.labels), FURTHEST)
        self.least = np.append(objective.space.least, np.minimum(-far, self.emissions.point()))
        self.most = np.append(objective.space.most, np.maximum(far, self.emissions.point()))

    def value_and_rates(self, both: Floats) -> tuple[float, Floats]:
        """The objective and its rates; the observation model stands there afterwards."""
        point, shown = np.split(both, [len(self.objective.space.index)])
        self.observing.set(self.emissions.model(shown))
        value, rates = self.objective.value_and_rates(point)
        return value, np.append(rates, self.rates(point))

    def rates(self, point: Floats) -> Floats:
        """Rates in the coordinates of the observation model, where it stands."""
        expectation = self.objective.expect(point)
        return self.emissions.rates(self.observing.responsibilities(expectation))

    def climb(self, point: Floats) -> tuple[Floats, float]:
        """Quasi-Newton steps from a point and where the observation model stands, to where it then stands.

        Coordinates at a kink, which would stop the others, are held there.
        """
        slopes = one_sided_slopes(self.objective.value, self.objective.space, point)
        kinked = np.maximum(slopes.up, slopes.down) < -TOLERANCE
        start = np.append(point, self.emissions.point())
        held = np.append(kinked, np.zeros(len(start) - len(point), dtype=np.bool_))
        least, most = (np.where(held, start, bound) for bound in (self.least, self.most))
        climb = ascend(self.value_and_rates, climb_from(self.value_and_rates, start), least, most, STEPS)
        point, shown = np.split(climb.point, [len(point)])
        self.observing.set(self.emissions.model(shown))
        return point, climb.value


def settle_jointly(objective: Objective, path: Path, rng: np.random.Generator) -> None:
    """Climb both, then the table-tops across their kinks, until no slope of either is left; nothing else
    where no observation model is learned."""
    if objective.observing is None:
        return
    joint = Joint(objective)
    for _ in range(ROUNDS):
        before = objective.observing.observation
        point, value = joint.climb(path.point)
        if value > path.values[-1]:
            path.stand(objective, point)
        else:
            objective.observing.set(before)
        path.move(objective, polish(objective, path.point, rng)[0])
        if slopes_of(objective, path.point).steepest <= TOLERANCE:
            break


def slopes_of(objective: Objective, point: Floats) -> Slopes:
    """One-sided slopes at a point in the table-tops and, where one is learned, the observation model."""
    slopes = one_sided_slopes(objective.value, objective.space, point)
    if objective.observing is None:
        return slopes
    rates = Joint(objective).rates(point)
    size, count = len(point), len(rates)
    axes = np.hstack([np.zeros((count, size)), np.eye(count)])
    directions = np.hstack([slopes.directions, np.zeros((len(slopes.directions), count))])
    return Slopes(
        np.vstack([directions, axes, -axes]),
        np.concatenate([slopes.slopes, rates, -rates]),
        slopes.up,
        slopes.down,
    )


def labels_of_emissions(objective: Objective) -> tuple[str, ...]:
    """What the further coordinates of `slopes_of` are called."""
    return () if objective.observing is None else EmissionCoordinates(objective.observing).labels
