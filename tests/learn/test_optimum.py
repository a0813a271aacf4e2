"""The traps of MODEL.md, section 7, each fallen into without its cure; and the test of an optimum."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from resetfilter import log_likelihoods as plainly
from taught import CUES, WORLD, by_hand, operator_trials, teacher

from learn import FitResult, MistakePrior, fit, log_likelihood
from learn.coordinates import Bounds, Coordinates, parameters_at, vector_of
from learn.estep import Evidence
from learn.exposure import expose
from learn.mstep import Objective
from learn.optimum import TOLERANCE, breakpoints, one_sided_slopes
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial

Floats = NDArray[np.float64]
REACH, FAN = 1e-6, 16
SHORT = teacher(falls=(0.5, 0.5, 0.5), rises=(0.5, 0.5, 0.5))
LINGERING = teacher(peaks=(0.2, 0.2, 0.2), rises=(2.0, 2.0, 2.0), falls=(6.0, 6.0, 6.0))


def plain_objective(trials: tuple[Trial, ...], vectors: Floats, prior: MistakePrior | None) -> Floats:
    """Log-likelihood plus log prior by the unmerged filter, for many parameter sets."""
    total = np.sum([plainly(trial, list(CUES.values()), vectors) for trial in trials], axis=0)
    weight = [0.0 if prior is None else prior.log_density(float(vector[0])) for vector in vectors]
    return np.asarray(total + np.array(weight))


def plain_slopes(trials: tuple[Trial, ...], model: TeacherModel) -> Floats:
    """One-sided slopes in nats per unit of log parameter: both ways along each, and a fan of
    directions in every (rise, fall) plane; -inf where that leaves the bounds (0.5 to 10 s)."""
    here = np.log(vector_of(model)[:10])
    axes = np.eye(10)
    angles = 2 * np.pi * np.arange(FAN) / FAN
    fans = [np.outer(np.cos(angles), axes[4 + m]) + np.outer(np.sin(angles), axes[7 + m]) for m in range(3)]
    directions = np.concatenate([axes, -axes, *fans])
    there = np.exp(here + REACH * directions)
    inside = ((there[:, 4:] >= 0.5 - 1e-12) & (there[:, 4:] <= 10 + 1e-12)).all(axis=1)
    vectors = np.pad(np.vstack([np.exp(here), there]), ((0, 0), (0, 3)))
    values = plain_objective(trials, vectors, MistakePrior())
    return np.where(inside, (values[1:] - values[0]) / REACH, -math.inf)


def objective_of(trials: tuple[Trial, ...], model: TeacherModel) -> Objective:
    free = np.arange(19) < 10
    space = Coordinates(model, Bounds(), free)
    base = model.parameters(WORLD.cue_names)
    exposure = expose(trials, WORLD, model, space.extent(base))
    return Objective(Evidence(exposure), base, space, MistakePrior())


@cache
def fitted() -> FitResult:
    return fit(operator_trials(12, teacher(), seed=1), WORLD)


def test_no_one_sided_slope_of_the_independent_likelihood_rises_at_the_optimum() -> None:
    assert fitted().converged
    assert plain_slopes(operator_trials(12, teacher(), seed=1), fitted().model).max() < 2 * TOLERANCE


def test_the_one_sided_test_finds_that_the_truth_is_no_optimum() -> None:
    assert plain_slopes(operator_trials(12, teacher(), seed=1), teacher()).max() > 1


def test_at_a_kink_the_gradient_test_fails_and_the_one_sided_test_passes() -> None:
    trials, result = operator_trials(12, teacher(), seed=1), fitted()
    kinks = [name for name, mark in result.marks.items() if mark == "at a kink"]
    assert kinks
    objective = objective_of(trials, result.model)
    point = objective.space.point(vector_of(result.model))
    _, rates = objective.value_and_rates(point)
    index = [objective.space.index.tolist().index(result.parameters.index(name)) for name in kinks]
    assert np.abs(rates[index]).max() > 10 * TOLERANCE
    slopes = one_sided_slopes(objective.value, objective.space, point)
    assert (slopes.up[index] < -TOLERANCE).all()
    assert (slopes.down[index] < -TOLERANCE).all()
    assert slopes.steepest <= TOLERANCE
    assert any("at a kink" in remark for remark in result.remarks)


def test_from_a_short_fall_em_alone_is_stuck_and_the_search_gets_out() -> None:
    """A press at level 0 has responsibility 0: EM never learns that a longer fall explains it."""
    trials = operator_trials(24, LINGERING)
    stuck = fit(trials, WORLD, SHORT, starts=1, search=False)
    assert stuck.starts[0].converged
    assert not stuck.converged
    assert stuck.status.startswith("not converged: a slope of")
    assert all(top.fall == 0.5 for top in stuck.model.approvals.values())
    searched = fit(trials, WORLD, SHORT, starts=1)
    assert searched.em_alone == pytest.approx(stuck.objective)
    assert searched.search_gain > 15
    assert searched.converged
    assert max(top.fall for top in searched.model.approvals.values()) > 3


def test_from_a_short_fall_wide_starts_alone_get_out() -> None:
    trials = operator_trials(24, LINGERING)
    stuck = fit(trials, WORLD, SHORT, starts=1, search=False)
    wide = fit(trials, WORLD, SHORT, starts=6, search=False)
    assert wide.best_start > 0
    assert wide.objective > stuck.objective + 15


@cache
def glimpses() -> tuple[Trial, ...]:
    """The light is on for two steps at a time: a rise of 2 s never gets its level past a half."""
    rng = np.random.default_rng(0)
    cycle = ["light_on(1)", "noa", "light_off(1)", *["noa"] * 11]
    trials = []
    for number in range(40):
        lit = [start + 1 for start in range(0, 56, 14) if rng.random() < 0.25]
        lit += [start + 2 for start in range(0, 56, 14) if rng.random() < 0.12 and start + 1 not in lit]
        trials.append(by_hand(cycle * 4, sorted(lit), trial_id=f"g{number}"))
    return tuple(trials)


def test_where_no_level_reaches_1_the_fit_says_that_only_ratios_are_known() -> None:
    longer = replace(teacher(), approvals=dict(teacher(rises=(6.0,) * 3, falls=(6.0,) * 3).approvals))
    result = fit(glimpses(), WORLD, longer, starts=2)
    top = result.model.approvals["that_mov"]
    marks = {result.marks[f"that_mov.{name}"] for name in ("peak", "rise", "fall")}
    assert marks == {"ridge"}
    stretched = replace(top, peak=top.peak * 1.5, rise=top.rise * 1.5, fall=top.fall * 1.5)
    approvals = dict(result.model.approvals) | {"that_mov": stretched}
    along = log_likelihood(glimpses(), WORLD, replace(result.model, approvals=approvals))
    assert along == pytest.approx(result.log_likelihood, abs=1e-9)
    assert any("only peak/rise and peak/fall are known" in remark for remark in result.remarks)


def test_mistake_goes_to_0_without_a_prior_and_stays_above_it_with_one() -> None:
    trials = operator_trials(10, teacher(mistake=1e-9), seed=4)
    without = fit(trials, WORLD, starts=2, mistake_prior=None)
    assert without.model.mistake < 1e-6
    assert without.marks["mistake"] == "at its bound"
    with_prior = fit(trials, WORLD, starts=2)
    assert with_prior.model.mistake > 5e-4


def test_the_prior_weighs_about_one_trial() -> None:
    """Quiet trials: the mode is that of 150 more steps at 0.005."""
    trials = [by_hand(["noa"] * 150, [], trial_id=str(number)) for number in range(3)]
    result = fit(trials, WORLD, starts=1)
    assert result.model.mistake == pytest.approx(150 * 0.005 / (4 * 150), rel=1e-3)


def test_breakpoints_hold_the_lattice_on_which_levels_meet_0_and_1() -> None:
    space = objective_of(operator_trials(1, teacher()), teacher()).space
    rise = space.index.tolist().index(4)
    values = np.exp(breakpoints(space, rise))
    for seconds in (0.5, 1.0, 1.5, 4.5 / 2, 3.5 / 3, 10.0):
        assert np.abs(values - seconds).min() < 1e-9
    assert values.min() >= 0.5 - 1e-12
    assert values.max() <= 10 + 1e-12


def test_the_plain_filter_and_the_objective_agree() -> None:
    trials = operator_trials(12, teacher(), seed=1)
    objective = objective_of(trials, teacher())
    rng = np.random.default_rng(0)
    points = objective.space.point(vector_of(teacher())) + rng.normal(0, 0.2, (4, 10))
    points = np.clip(points, objective.space.least, objective.space.most)
    vectors = np.array([objective.space.vector(point) for point in points])
    expected = plain_objective(trials, vectors, MistakePrior())
    np.testing.assert_allclose([objective.value(point) for point in points], expected, rtol=1e-11)
    assert parameters_at(vectors[0], objective.base).dt == 0.5
