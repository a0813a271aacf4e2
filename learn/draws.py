"""Draws from about a teacher's posterior, weighed by the exact likelihood.

Laplace's approximation is biased where the likelihood has kinks and bounds. Draws from a heavy-tailed
version of it, mixed with draws from the prior, each weighed by likelihood * prior / proposal, are not
(but for their number), and can be weighed anew when the prior moves.
"""

import math
from dataclasses import dataclass

import numpy as np

from learn.laplace import Own, laplace
from learn.normal import Normal
from taskcomm.lattice import Floats

FREEDOM = 5  # degrees of freedom of the t distribution about the mode
FROM_PRIOR = 0.25  # share of the draws made from the prior: bounds every weight


@dataclass(frozen=True)
class Draws:
    """Points (k, n) drawn from a known density, with log-likelihood and log density of each, (k,)."""

    points: Floats
    log_likelihood: Floats
    log_density: Floats


@dataclass(frozen=True)
class Weighed:
    """Draws of several teachers under one prior: `weights` (teachers, k), each row with sum 1.

    `log_marginal` (teachers,) is the log-likelihood of each teacher's trials averaged over the prior;
    `mean` (teachers, n) and `covariance` (teachers, n, n) are those of the posteriors.
    """

    weights: Floats
    log_marginal: Floats
    mean: Floats
    covariance: Floats

    @property
    def effective(self) -> Floats:
        """How many equally weighed draws each teacher's are worth, (teachers,)."""
        return np.asarray(1 / (self.weights**2).sum(axis=1))


def draw(own: Own, prior: Normal, about: Normal, count: int, rng: np.random.Generator) -> Draws:
    """`count` draws from a mixture of the prior and a t distribution with mode and width of `about`."""
    size, from_prior = len(prior.mean), max(1, round(FROM_PRIOR * count))
    normal = rng.standard_normal((count, size))
    tails = np.sqrt(FREEDOM / rng.chisquare(FREEDOM, count))
    points = about.mean + tails[:, None] * (normal @ about.root.T)
    points[:from_prior] = prior.mean + normal[:from_prior] @ prior.root.T
    share = from_prior / count
    parts = [np.log(share) + prior.log_density(points)]
    if share < 1:
        parts.append(np.log1p(-share) + _log_t(about, points))
    return Draws(points, own.values(points), np.logaddexp.reduce(parts, axis=0))


def _log_t(about: Normal, points: Floats) -> Floats:
    """Log density of the t distribution with FREEDOM degrees of freedom about `about`."""
    size = len(about.mean)
    constant = math.lgamma((FREEDOM + size) / 2) - math.lgamma(FREEDOM / 2)
    constant -= size * math.log(FREEDOM * math.pi) / 2 + float(np.log(np.diag(about.root)).sum())
    return constant - (FREEDOM + size) / 2 * np.log1p(about.squares(points) / FREEDOM)


def weigh(points: Floats, log_ratio: Floats, prior: Normal) -> Weighed:
    """Weights of draws (teachers, k, n) whose log-likelihood - log density is `log_ratio` (teachers, k)."""
    logs = log_ratio + prior.log_density(points)
    top = logs.max(axis=1)
    weights = np.exp(logs - top[:, None])
    total = weights.sum(axis=1)
    weights /= total[:, None]
    mean = (weights[:, None] @ points)[:, 0]
    aside = points - mean[:, None]
    covariance = (weights[:, :, None] * aside).transpose(0, 2, 1) @ aside
    return Weighed(weights, top + np.log(total / points.shape[1]), mean, covariance)


@dataclass(frozen=True)
class Posterior:
    """One teacher given the own trials and the prior: `mode`, `mean` (n,), `covariance` (n, n).

    `log_marginal` is the log-likelihood of the own trials averaged over the prior, in nats; `effective`
    how many equally weighed draws all this rests on, but for the mode, which rests on none.
    """

    mode: Floats
    mean: Floats
    covariance: Floats
    log_marginal: float
    effective: float


def posterior(own: Own, prior: Normal, count: int, rng: np.random.Generator) -> Posterior:
    """The posterior of one teacher, from `count` draws."""
    about = laplace(own, prior)
    draws = draw(own, prior, about, count, rng)
    weighed = weigh(draws.points[None], (draws.log_likelihood - draws.log_density)[None], prior)
    return Posterior(
        about.mean,
        weighed.mean[0],
        weighed.covariance[0],
        float(weighed.log_marginal[0]),
        float(weighed.effective[0]),
    )
