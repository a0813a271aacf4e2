"""EM for the mean and the spread of teachers, from weighed draws of each.

With the draws fixed, the sum over teachers of the log of the average weight is the log-likelihood of
(mean, covariance), estimated; EM on it never falls (Geyer and Thompson, Constrained Monte Carlo maximum
likelihood for dependent data, 1992). The draws are renewed when the prior has moved away from them.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from learn.draws import Draws, Weighed, weigh
from learn.normal import Normal
from taskcomm.lattice import Floats

MOST_ITERATIONS = 300
SETTLED = 1e-4  # of a standard deviation, in one iteration
WORN = 0.5  # share of a teacher's effective draws that may be lost before they are renewed


@dataclass(frozen=True)
class PopulationPrior:
    """Weak priors on what teachers have in common, in units of the coordinates (logarithms, or seconds).

    As if `teachers` more teachers had been seen, each `spread` from the mean in every coordinate: log
    density -teachers/2 (log det S + spread^2 trace S^-1). A spread does not collapse to 0 where few
    teachers differ, and stays as it is where no teacher's trials say anything. The mean is normal about the
    initial model with standard deviation `mean`, which keeps mistake above 0 where no press falls off-cue.

    Raises ValueError for what is not positive.
    """

    spread: float = 0.25
    teachers: float = 1.0
    mean: float = 2.0

    def __post_init__(self) -> None:
        for name in ("spread", "teachers", "mean"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise ValueError(f"population prior: {name} must be positive, not {getattr(self, name)!r}")

    def log_density(self, normal: Normal, centre: Floats) -> float:
        """Log density of a population whose mean is thought to be near `centre`, up to a constant."""
        size = 2 * float(np.log(np.diag(normal.root)).sum())
        narrow = self.spread**2 * float(np.trace(normal.precision))
        away = float(((normal.mean - centre) ** 2).sum()) / self.mean**2
        return -(self.teachers * (size + narrow) + away) / 2

    def least_spread(self, teachers: int) -> float:
        """The spread that is found where teachers do not differ at all."""
        return self.spread * math.sqrt(self.teachers / (self.teachers + teachers))


@dataclass(frozen=True)
class Aim:
    """What is asked of a population: its `prior` about `centre`, its mean within `least` and `most`,
    and whether coordinates go together (`full` covariance) or each by itself."""

    prior: PopulationPrior
    centre: Floats
    least: Floats
    most: Floats
    full: bool

    def raised(self, weighed: Weighed, normal: Normal) -> Normal:
        """The M-step: the mean given the covariance, then the covariance given the mean."""
        count, mean = len(weighed.mean), self.centred(weighed, normal)
        aside = weighed.mean - mean
        second = weighed.covariance.sum(axis=0) + aside.T @ aside
        second += self.prior.teachers * self.prior.spread**2 * np.eye(len(mean))
        covariance = second / (count + self.prior.teachers)
        if not self.full:
            covariance = np.diag(np.diag(covariance))
        return Normal(mean, covariance)

    def centred(self, weighed: Weighed, normal: Normal) -> Floats:
        """The best mean given the covariance of `normal`."""
        towards = np.eye(len(self.centre)) / self.prior.mean**2
        pull = normal.precision @ weighed.mean.sum(axis=0) + towards @ self.centre
        mean = np.linalg.solve(len(weighed.mean) * normal.precision + towards, pull)
        return np.clip(mean, self.least, self.most)


def stacked(draws: Sequence[Draws]) -> tuple[Floats, Floats]:
    """Points (teachers, k, n) and log-likelihood - log density (teachers, k) of every teacher's draws."""
    points = np.stack([each.points for each in draws])
    return points, np.stack([each.log_likelihood - each.log_density for each in draws])


@dataclass(frozen=True)
class Climbed:
    """A population after EM on fixed draws: the penalised log-likelihood before every iteration and at
    the end, and whether the draws still bore the last of them."""

    normal: Normal
    weighed: Weighed
    values: tuple[float, ...]
    worn: bool


def climb_spread(
    draws: Sequence[Draws],
    normal: Normal,
    aim: Aim,
    iterations: int = MOST_ITERATIONS,
) -> Climbed:
    """EM from `normal` until it stands still, `iterations` are over, or the draws are worn."""
    points, log_ratio = stacked(draws)
    weighed = weigh(points, log_ratio, normal)
    fresh, values = weighed.effective, [_value(weighed, normal, aim)]
    for _ in range(iterations):
        after = aim.raised(weighed, normal)
        moved = after.away_from(normal)
        normal, weighed = after, weigh(points, log_ratio, after)
        values.append(_value(weighed, normal, aim))
        if (weighed.effective < WORN * fresh).any():
            return Climbed(normal, weighed, tuple(values), True)
        if moved < SETTLED:
            break
    return Climbed(normal, weighed, tuple(values), False)


def _value(weighed: Weighed, normal: Normal, aim: Aim) -> float:
    return float(weighed.log_marginal.sum()) + aim.prior.log_density(normal, aim.centre)
