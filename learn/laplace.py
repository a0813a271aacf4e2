"""One teacher's own trials and what is known of teachers, put together: the posterior's mode and width.

What a teacher's trials say is smooth only piecewise (MODEL.md, section 7), so the curvature at the mode
may be that of one side of a kink, or none. Here it is taken over a secant as long as the prior is wide,
which sees a kink as the bend that it is at that scale. The result is where draws are made (`learn.draws`),
which are then weighed by the exact likelihood; it is not relied on to be right. On the shipped study it gives
posterior variances 0 to 5% too small; EM that took it at its word found spreads up to a quarter too small.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from learn.ascent import ascend, climb_from
from learn.normal import Normal
from taskcomm.lattice import Floats

STEPS = 200
GAIN = 1e-9
SECANT = 0.5  # half the length of a secant, in standard deviations of the prior


class LogLikelihood(Protocol):
    """What the trials of one teacher say of coordinates within their bounds, in nats."""

    def value(self, point: Floats) -> float: ...

    def value_and_rates(self, point: Floats) -> tuple[float, Floats]: ...


@dataclass(frozen=True)
class Own:
    """The log-likelihood of one teacher's own trials, within bounds `least` and `most`.

    Beyond a bound it is what it is at the bound: below one step a rise changes nothing, and a cue is
    not seen before it shows. So a normal distribution that reaches beyond holds teachers at the bound.
    `likelihood` None stands for no trials.
    """

    likelihood: LogLikelihood | None
    least: Floats
    most: Floats

    def values(self, points: Floats) -> Floats:
        """Log-likelihoods at points (k, n), in nats."""
        if self.likelihood is None:
            return np.zeros(len(points))
        within = np.clip(points, self.least, self.most)
        return np.array([self.likelihood.value(point) for point in within])

    def value_and_rates(self, point: Floats) -> tuple[float, Floats]:
        """The log-likelihood and its rates at a point within the bounds."""
        if self.likelihood is None:
            return 0.0, np.zeros_like(point)
        return self.likelihood.value_and_rates(point)


def posterior_mode(own: Own, prior: Normal, starts: Sequence[Floats] = ()) -> tuple[Floats, float]:
    """Where log-likelihood + log prior density is greatest, and how great (prior up to a constant).

    Climbs from `starts`, by default from the mean of the prior.
    """

    def posterior(point: Floats) -> tuple[float, Floats]:
        value, rates = own.value_and_rates(point)
        pull = prior.precision @ (point - prior.mean)
        return value - float(pull @ (point - prior.mean)) / 2, rates - pull

    best, best_value = prior.mean, -np.inf
    for start in starts or (prior.mean,):
        climb = climb_from(posterior, np.clip(start, own.least, own.most))
        for _ in range(2):  # once more with a new metric: a climb may be stuck at a kink
            climb.metric = None
            climb = ascend(posterior, climb, own.least, own.most, STEPS, GAIN)
        if climb.value > best_value:
            best, best_value = climb.point, climb.value
    return best, best_value


def bend(own: Own, prior: Normal, point: Floats) -> Floats:
    """Minus the second derivatives of the log-likelihood at the scale of the prior, (n, n).

    Differences of exact rates over secants of SECANT standard deviations to either side.
    """
    size = len(point)
    rows = np.zeros((size, size))
    for j, reach in enumerate(SECANT * prior.spread):
        ends = np.tile(point, (2, 1))
        ends[:, j] += [-reach, reach]
        ends = np.clip(ends, own.least, own.most)
        length = ends[1, j] - ends[0, j]
        if length > 0:
            rows[j] = (own.value_and_rates(ends[0])[1] - own.value_and_rates(ends[1])[1]) / length
    return (rows + rows.T) / 2


def laplace(own: Own, prior: Normal, starts: Sequence[Floats] = ()) -> Normal:
    """The posterior as a normal: its mode and, as covariance, the inverse of prior precision + `bend`.

    Directions in which the log-likelihood bends upwards count as flat: the posterior is nowhere wider
    than the prior. A Gaussian log-likelihood gives the exact posterior.
    """
    mode, _ = posterior_mode(own, prior, starts)
    root = prior.root
    bends, axes = np.linalg.eigh(root.T @ bend(own, prior, mode) @ root)
    along = root @ axes
    return Normal(mode, along @ np.diag(1 / (1 + np.maximum(bends, 0))) @ along.T)
