"""How sure a population is of what teachers have in common: errors, and whether they differ at all."""

from collections.abc import Sequence

import numpy as np

from learn.draws import Weighed, weigh
from learn.normal import Normal
from learn.population import ALIKE, Common
from learn.spread import Aim
from taskcomm.lattice import Floats

ALL_ALIKE = 0.02  # the spread that stands for none
STEPS = 10
LITTLE = 1.353  # nats; twice that is the 95% point of 0 and chi-square(1), half and half


def in_common(
    names: Sequence[str], normal: Normal, aim: Aim, points: Floats, log_ratio: Floats
) -> tuple[Common, ...]:
    """Every coordinate of a population, from draws of its teachers (see `weigh`).

    Errors are from the observed information of the penalised log-likelihood: that of complete data less
    what is missing (Louis 1982). The gain of a coordinate compares with a spread of next to none in it, its
    mean put where it is best then, the rest kept.
    """
    weighed = weigh(points, log_ratio, normal)
    mean_error = np.sqrt(np.diag(_inverse(_of_mean(weighed, normal, aim))))
    spread_error = 1 / np.sqrt(_of_log_spread(weighed, points, normal, aim))
    found = []
    for j, name in enumerate(names):
        gain = float((weighed.log_marginal - _alike(j, normal, aim, points, log_ratio).log_marginal).sum())
        found.append(
            Common(
                name=name,
                mean=float(normal.mean[j]),
                mean_error=float(mean_error[j]),
                spread=float(normal.spread[j]),
                spread_error=float(spread_error[j]),
                gain=max(0.0, gain),
                mark=ALIKE if gain < LITTLE else "",
            )
        )
    return tuple(found)


def _of_mean(weighed: Weighed, normal: Normal, aim: Aim) -> Floats:
    """Observed information in the mean, (n, n)."""
    precision, count = normal.precision, len(weighed.mean)
    missing = precision @ weighed.covariance.sum(axis=0) @ precision
    return np.asarray(count * precision - missing + np.eye(len(precision)) / aim.prior.mean**2)


def _inverse(information: Floats) -> Floats:
    """The inverse, with what the noise of draws made negative held to be next to nothing."""
    values, axes = np.linalg.eigh(information)
    return np.asarray(axes @ np.diag(1 / np.maximum(values, 1e-3)) @ axes.T, dtype=np.float64)


def _of_log_spread(weighed: Weighed, points: Floats, normal: Normal, aim: Aim) -> Floats:
    """Observed information in each log spread, (n,), the others held."""
    squares = ((points - normal.mean) / normal.spread) ** 2
    first = (weighed.weights[:, None] @ squares)[:, 0]
    second = (weighed.weights[:, None] @ squares**2)[:, 0]
    own = (2 * first - (second - first**2)).sum(axis=0)
    information = own + 2 * aim.prior.teachers * (aim.prior.spread / normal.spread) ** 2
    return np.asarray(np.maximum(information, 1e-3), dtype=np.float64)


def _alike(j: int, normal: Normal, aim: Aim, points: Floats, log_ratio: Floats) -> Weighed:
    """The draws weighed as if teachers were alike in coordinate j."""
    covariance = normal.covariance.copy()
    covariance[j], covariance[:, j] = 0.0, 0.0
    covariance[j, j] = min(ALL_ALIKE**2, normal.covariance[j, j])
    alike = Normal(normal.mean, covariance)
    for _ in range(STEPS):
        mean = normal.mean.copy()
        mean[j] = aim.centred(weigh(points, log_ratio, alike), alike)[j]
        alike = Normal(mean, covariance)
    return weigh(points, log_ratio, alike)
