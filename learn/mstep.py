"""The M-step: raise the expected log-likelihood jointly over mistake and all table-tops."""

import math
from copy import copy
from dataclasses import dataclass
from typing import Self

from numpy.typing import ArrayLike

from learn.ascent import ascend, climb_from
from learn.coordinates import Coordinates, parameters_at
from learn.estep import Evidence, Expectation
from learn.observing import Observing
from learn.prior import Pull
from taskcomm.lattice import Floats
from taskcomm.teacher import Parameters


@dataclass(frozen=True)
class MistakePrior:
    """A weak prior on mistake, as if `steps` more steps had been seen with a mistake in `mean` of them.

    log prior = steps * (mean log mistake + (1 - mean) log(1 - mistake)), greatest at `mean`. The
    default weighs about as much as one trial. It keeps mistake above 0 where no press falls off-cue.

    >>> prior = MistakePrior()
    >>> prior.log_density(0.005) > prior.log_density(0.006) > prior.log_density(1e-9)
    True
    """

    mean: float = 0.005
    steps: float = 150.0

    def __post_init__(self) -> None:
        if not (0 < self.mean < 1 and math.isfinite(self.steps) and self.steps > 0):
            raise ValueError(
                f"mistake prior: needs 0 < mean < 1 and steps > 0, not {self.mean}, {self.steps}"
            )

    def log_density(self, mistake: float) -> float:
        """Up to a constant, in nats."""
        return self.steps * (self.mean * math.log(mistake) + (1 - self.mean) * math.log1p(-mistake))

    def rate(self, mistake: float) -> float:
        """Derivative of `log_density`."""
        return self.steps * (self.mean / mistake - (1 - self.mean) / (1 - mistake))


class Objective:
    """What a fit climbs: log-likelihood plus log priors, over the free coordinates.

    It counts its evaluations. `prior` (on mistake) and `pull` (on all that is free) may be None.
    """

    def __init__(
        self,
        evidence: Evidence,
        base: Parameters,
        space: Coordinates,
        prior: MistakePrior | None,
        observing: Observing | None = None,
        pull: Pull | None = None,
    ) -> None:
        self.evidence, self.base, self.space, self.prior = evidence, base, space, prior
        self.observing, self.pull = observing, pull
        self.evaluations = 0

    def with_weights(self, weights: ArrayLike | None) -> Self:
        """The same over the same trials, weighted."""
        other = copy(self)
        other.evidence = self.evidence.with_weights(weights)
        return other

    def log_prior(self, vector: Floats) -> float:
        """Log density of the priors: on mistake, on all, on the observation model where that is learned."""
        of_mistake = 0.0 if self.prior is None else self.prior.log_density(float(vector[0]))
        of_all = 0.0 if self.pull is None else self.pull.log_density(self.space.point(vector))
        return of_mistake + of_all + (0.0 if self.observing is None else self.observing.log_prior())

    def _with_prior(self, vector: Floats, value: float, rates: Floats) -> tuple[float, Floats]:
        rates = rates.copy()
        if self.prior is not None:
            rates[0] += self.prior.rate(float(vector[0]))
        rates = self.space.rates(vector, rates)
        if self.pull is not None:
            rates = rates + self.pull.rates(self.space.point(vector))
        return value + self.log_prior(vector), rates

    def expect(self, point: Floats) -> Expectation:
        """The E-step at a point."""
        self.evaluations += 1
        return self.evidence.expect(parameters_at(self.space.vector(point), self.base))

    def value(self, point: Floats) -> float:
        """The objective at a point, in nats."""
        self.evaluations += 1
        vector = self.space.vector(point)
        return self.evidence.value(parameters_at(vector, self.base)) + self.log_prior(vector)

    def value_and_rates(self, point: Floats) -> tuple[float, Floats]:
        """The objective at a point and its rates; at a kink, those of one side."""
        self.evaluations += 1
        vector = self.space.vector(point)
        return self._with_prior(vector, *self.evidence.value_and_rates(parameters_at(vector, self.base)))

    def expected(self, point: Floats, expectation: Expectation) -> tuple[float, Floats]:
        """Q plus log prior at a point, and its rates."""
        self.evaluations += 1
        vector = self.space.vector(point)
        parameters = parameters_at(vector, self.base)
        return self._with_prior(vector, *self.evidence.expected_log_likelihood(parameters, expectation))


def maximise(
    objective: Objective, point: Floats, expectation: Expectation, metric: Floats | None, steps: int = 2
) -> tuple[Floats, Floats | None]:
    """A point where Q is at least what it is at `point`, some quasi-Newton steps up, and the metric.

    Any increase of Q raises the log-likelihood at least as much, so a few steps do (generalised EM).
    Q changes little between iterations, so the metric of the last one, if given, serves the next.
    """
    space = objective.space
    climb = climb_from(lambda at: objective.expected(at, expectation), point)
    climb.metric = metric
    climb = ascend(lambda at: objective.expected(at, expectation), climb, space.least, space.most, steps)
    return climb.point, climb.metric
