"""EM for mean and spread, on grids of points in place of draws, where every average is a sum."""

import numpy as np
import pytest
from scipy.optimize import minimize

from learn.draws import Draws
from learn.in_common import in_common
from learn.normal import Normal
from learn.population import ALIKE
from learn.spread import Aim, PopulationPrior, climb_spread, stacked
from taskcomm.lattice import Floats

GRID = np.linspace(-6, 6, 1201)[:, None]
WIDTH = float(GRID[-1, 0] - GRID[0, 0])
PRIOR = PopulationPrior()


def teachers_at(centres: Floats, error: float) -> list[Draws]:
    """Teachers of whom own trials say: about `centre`, give or take `error`."""
    flat = np.full(len(GRID), -np.log(WIDTH))
    return [Draws(GRID, -(((GRID[:, 0] - centre) / error) ** 2) / 2, flat) for centre in centres]


def aim(prior: PopulationPrior = PRIOR, size: int = 1, full: bool = False) -> Aim:
    return Aim(prior, np.zeros(size), np.full(size, -5.0), np.full(size, 5.0), full)


def settled(draws: list[Draws], start: Normal, aim: Aim) -> Normal:
    """Where EM ends; a grid serves on when draws would be renewed."""
    while True:
        climbed = climb_spread(draws, start, aim, 3000)
        start = climbed.normal
        if not climbed.worn:
            return start


@pytest.mark.parametrize("error", [0.2, 0.5])
def test_mean_and_spread_are_those_of_greatest_likelihood(error: float) -> None:
    centres = np.random.default_rng(4).normal(0.5, 0.7, size=12)
    found = settled(teachers_at(centres, error), Normal(np.zeros(1), np.eye(1)), aim())

    def minus(at: Floats) -> float:  # centres are normal about the mean with variance v + error^2
        mean, v = at[0], np.exp(2 * at[1])
        own = (np.log(v + error**2) + (centres - mean) ** 2 / (v + error**2)).sum()
        weak = PRIOR.teachers * (np.log(v) + PRIOR.spread**2 / v) + mean**2 / PRIOR.mean**2
        return float(own + weak) / 2

    best = minimize(minus, np.zeros(2), tol=1e-12).x
    assert abs(found.mean[0] - best[0]) < 0.002
    assert abs(np.log(found.spread[0]) - best[1]) < 0.01


@pytest.mark.parametrize("full", [False, True])
def test_on_fixed_draws_the_objective_never_falls(full: bool) -> None:
    rng = np.random.default_rng(5)
    draws = []
    for centre in rng.normal(0, 0.7, size=(8, 3)):
        points = rng.normal(size=(500, 3))
        own = -3 * ((points - centre) ** 2).sum(axis=1)
        draws.append(Draws(points, own, -(points**2).sum(axis=1) / 2))
    normal, values = Normal(np.full(3, 0.2), 0.5 * np.eye(3)), list[float]()
    for _ in range(20):
        climbed = climb_spread(draws, normal, aim(size=3, full=full))
        normal, values = climbed.normal, values + list(climbed.values)
    assert len(set(values)) > 10
    assert np.diff(values).min() > -1e-9


def test_teachers_who_are_alike_are_found_so_and_not_where_they_differ() -> None:
    names, start = ["x"], Normal(np.zeros(1), np.eye(1))
    found = {}
    for name, spread in (("alike", 0.0), ("different", 1.0)):
        centres = 0.5 + spread * np.linspace(-1.5, 1.5, 10)
        draws = teachers_at(centres, 0.3)
        normal = settled(draws, start, aim())
        (found[name],) = in_common(names, normal, aim(), *stacked(draws))
    assert found["alike"].mark == ALIKE
    assert found["alike"].gain < 0.5
    assert found["different"].mark == ""
    assert found["different"].gain > 5
    assert found["different"].spread_error < found["alike"].spread_error


def test_of_teachers_pinned_to_one_place_the_least_spread_is_found() -> None:
    draws = teachers_at(np.full(15, 0.5), 0.02)
    normal = settled(draws, Normal(np.full(1, 0.5), 0.1 * np.eye(1)), aim())
    assert normal.spread[0] == pytest.approx(PRIOR.least_spread(15), rel=0.1)


def test_without_any_data_the_spread_is_that_of_the_prior() -> None:
    flat = [Draws(GRID, np.zeros(len(GRID)), np.full(len(GRID), -np.log(WIDTH))) for _ in range(5)]
    normal = settled(flat, Normal(np.zeros(1), 0.3 * np.eye(1)), aim())
    assert normal.spread[0] == pytest.approx(PRIOR.spread, rel=0.05)
    assert abs(normal.mean[0]) < 1e-6


@pytest.mark.parametrize("name", ["spread", "teachers", "mean"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan")])
def test_a_prior_of_what_is_not_positive_is_named(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"{name} must be positive"):
        PopulationPrior(**{name: value})
