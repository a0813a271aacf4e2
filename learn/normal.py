"""Teachers as draws from one normal distribution over the free coordinates of a model."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from taskcomm.lattice import Floats


@dataclass(frozen=True)
class Normal:
    """A normal distribution: `mean` (n,) and `covariance` (n, n), positive definite."""

    mean: Floats
    covariance: Floats

    @cached_property
    def root(self) -> Floats:
        """Lower triangular L with L L' = covariance."""
        return np.asarray(np.linalg.cholesky(self.covariance), dtype=np.float64)

    @cached_property
    def inverse_root(self) -> Floats:
        """The inverse of `root`."""
        return np.asarray(np.linalg.inv(self.root), dtype=np.float64)

    @cached_property
    def precision(self) -> Floats:
        """The inverse of the covariance."""
        return np.asarray(self.inverse_root.T @ self.inverse_root, dtype=np.float64)

    @property
    def spread(self) -> Floats:
        """Standard deviations, (n,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)), dtype=np.float64)

    def squares(self, points: Floats) -> Floats:
        """Squared Mahalanobis distance from the mean of points (..., n)."""
        return np.asarray((((points - self.mean) @ self.inverse_root.T) ** 2).sum(axis=-1))

    def log_density(self, points: Floats) -> Floats:
        """Log density at points (..., n).

        >>> float(Normal(np.zeros(1), np.eye(1)).log_density(np.zeros((1, 1)))[0])
        -0.9189385332046727
        """
        size = len(self.mean) * math.log(2 * math.pi) / 2 + float(np.log(np.diag(self.root)).sum())
        return np.asarray(-self.squares(points) / 2 - size, dtype=np.float64)

    def away_from(self, other: "Normal") -> float:
        """The greatest difference of means, in spreads of `other`, or of log spreads, in any coordinate."""
        means = np.abs((self.mean - other.mean) / other.spread)
        return float(max(means.max(), np.abs(np.log(self.spread / other.spread)).max()))
