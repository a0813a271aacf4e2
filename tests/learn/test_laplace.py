"""One teacher's posterior: against closed forms where there are some, against quadrature where not."""

from dataclasses import dataclass

import numpy as np
import pytest

from learn.draws import posterior, weigh
from learn.laplace import Own, laplace, posterior_mode
from learn.normal import Normal
from taskcomm.lattice import Floats

WIDE = 1e3


@dataclass
class Gaussian:
    """-(x - centre)' A (x - centre) / 2."""

    centre: Floats
    bend: Floats

    def value(self, point: Floats) -> float:
        return self.value_and_rates(point)[0]

    def value_and_rates(self, point: Floats) -> tuple[float, Floats]:
        pull = self.bend @ (point - self.centre)
        return -float(pull @ (point - self.centre)) / 2, -pull


@dataclass
class Tent:
    """-slope |x - top|: all of it a kink."""

    top: float
    slope: float

    def value(self, point: Floats) -> float:
        return self.value_and_rates(point)[0]

    def value_and_rates(self, point: Floats) -> tuple[float, Floats]:
        aside = point - self.top
        return -self.slope * float(np.abs(aside).sum()), -self.slope * np.sign(aside)


def random_definite(rng: np.random.Generator, size: int) -> Floats:
    root = rng.normal(size=(size, size))
    return root @ root.T + 0.3 * np.eye(size)


@pytest.mark.parametrize("seed", range(4))
def test_of_a_gaussian_likelihood_mode_width_and_log_marginal_are_exact(seed: int) -> None:
    rng = np.random.default_rng(seed)
    own = Gaussian(rng.normal(size=3), random_definite(rng, 3))
    prior = Normal(rng.normal(size=3), random_definite(rng, 3))
    covariance: Floats = np.asarray(np.linalg.inv(own.bend + prior.precision), dtype=np.float64)
    mean = covariance @ (own.bend @ own.centre + prior.precision @ prior.mean)
    within = Own(own, np.full(3, -WIDE), np.full(3, WIDE))
    found = laplace(within, prior)
    np.testing.assert_allclose(found.mean, mean, atol=5e-4)  # GAIN is 1e-9 nats
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-6, atol=1e-9)
    at_mean = own.value(mean) + float(prior.log_density(mean[None])[0])
    log_marginal = at_mean - float(Normal(mean, covariance).log_density(mean[None])[0])
    drawn = posterior(within, prior, 4000, rng)
    error = 4 / np.sqrt(drawn.effective)
    assert abs(drawn.log_marginal - log_marginal) < error
    assert (np.abs(drawn.mean - mean) < error * np.sqrt(np.diag(covariance))).all()
    assert drawn.effective > 1000


@pytest.mark.parametrize(("top", "slope", "least"), [(0.5, 3.0, -WIDE), (1.2, 0.8, -WIDE), (-0.4, 3.0, 0.0)])
def test_at_a_kink_and_beyond_a_bound_draws_agree_with_quadrature(
    top: float, slope: float, least: float
) -> None:
    own, prior = (
        Own(Tent(top, slope), np.array([least]), np.array([WIDE])),
        Normal(np.full(1, 0.1), np.eye(1)),
    )
    grid = np.linspace(-8, 8, 16001)
    logs = -slope * np.abs(np.maximum(grid, least) - top) + prior.log_density(grid[:, None])
    weights = np.exp(logs)
    marginal = float(weights.sum() * (grid[1] - grid[0]))
    mean = float(weights @ grid / weights.sum())
    variance = float(weights @ (grid - mean) ** 2 / weights.sum())
    found = posterior(own, prior, 20000, np.random.default_rng(0))
    error = 4 / np.sqrt(found.effective)
    assert abs(found.log_marginal - np.log(marginal)) < error
    assert abs(found.mean[0] - mean) < error * np.sqrt(variance)
    assert abs(found.covariance[0, 0] / variance - 1) < 4 * error


def test_the_mode_is_no_lower_than_any_point_tried() -> None:
    rng = np.random.default_rng(1)
    own, prior = (
        Own(Tent(0.7, 2.0), np.full(4, -1.0), np.full(4, 1.0)),
        Normal(np.zeros(4), random_definite(rng, 4)),
    )
    _, best = posterior_mode(own, prior)
    tried = rng.uniform(-1, 1, size=(500, 4))
    values = own.values(tried) - prior.squares(tried) / 2
    assert best >= values.max()


def test_without_trials_the_posterior_is_the_prior() -> None:
    prior = Normal(np.array([0.3, -0.2]), random_definite(np.random.default_rng(2), 2))
    found = laplace(Own(None, np.full(2, -WIDE), np.full(2, WIDE)), prior)
    np.testing.assert_allclose(found.mean, prior.mean)
    np.testing.assert_allclose(found.covariance, prior.covariance)


def test_weights_sum_to_one_and_follow_the_prior() -> None:
    rng = np.random.default_rng(3)
    points, log_ratio = rng.normal(size=(2, 50, 1)), rng.normal(size=(2, 50))
    near, far = (weigh(points, log_ratio, Normal(np.array([at]), np.eye(1))) for at in (0.0, 2.0))
    np.testing.assert_allclose(near.weights.sum(axis=1), 1.0)
    assert (far.mean > near.mean).all()
