"""Priors: none at strength 0, all at great strength, monotone between; worth the trials that they say."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from taught import WORLD, by_hand, operator_trials, teacher
from tinyworld import menu

from learn import FitError, FitResult, fit, log_likelihood
from learn.certainty import uncertainty
from learn.coordinates import vector_of
from learn.em import prepare
from learn.imagined import imagined, pull_of
from learn.prior import Prior
from learn.settings import Settings
from taskcomm.simulate import SimulatedTeacher
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Step, Trial
from taskcomm.world import World

TRIALS = operator_trials(8, teacher())
INTUITIVE = TeacherModel.intuitive()
BELIEVED = teacher(peaks=(0.2, 0.15, 0.2), rises=(1.3, 1.7, 1.2), falls=(1.2, 0.9, 1.4))
STRENGTHS = (1.0, 10.0, 100.0, 10_000.0)


@cache
def fitted(strength: float) -> FitResult:
    return fit(TRIALS, WORLD, starts=2, prior=Prior(strength))


def test_a_prior_worth_nothing_is_no_prior() -> None:
    none = fit(TRIALS, WORLD, starts=2)
    assert fitted(0.0).model == none.model
    assert fitted(0.0).objective == none.objective


def test_a_strong_prior_gives_its_model_back() -> None:
    strong = fit(TRIALS, WORLD, starts=2, prior=Prior(1e6))
    informed = strong.free & (np.array(list(strong.steps.values())) > 0)
    close = vector_of(strong.model)[informed] / vector_of(INTUITIVE)[informed]
    assert np.abs(np.log(close)).max() < 0.05
    believed = fit(TRIALS, WORLD, starts=2, prior=Prior(1e6, BELIEVED)).model
    assert believed.approvals["that_mov"].peak == pytest.approx(0.2, rel=0.01)
    assert believed.approvals["that_dist"].rise == pytest.approx(1.2, rel=0.01)


def test_the_stronger_the_prior_the_nearer_to_its_model_and_the_less_likely_the_presses() -> None:
    space = prepare(TRIALS, WORLD, INTUITIVE, Settings()).space
    pull = pull_of(Prior(1.0), TRIALS, WORLD, INTUITIVE, space)
    results = [fitted(strength) for strength in (0.0, *STRENGTHS)]
    away = [-pull.log_density(space.point(vector_of(result.model))) for result in results]
    assert np.diff(away).max() < 1e-6
    assert np.diff([result.log_likelihood for result in results]).max() < 1e-4
    assert away[0] > 10 * away[-1]


def test_the_likelihood_that_is_reported_is_that_of_the_trials_alone() -> None:
    result = fitted(10.0)
    assert result.log_likelihood == pytest.approx(log_likelihood(TRIALS, WORLD, result.model), rel=1e-12)
    assert result.objective < result.log_likelihood
    assert result.trial_ids == tuple(trial.trial_id for trial in TRIALS)
    assert sum(map(len, result.responsibilities)) == sum(trial.presses.sum() for trial in TRIALS)


def test_a_fit_with_a_prior_ends_with_a_certificate_like_any_other() -> None:
    result = fitted(10.0)
    assert result.certificate.trusted
    assert result.monotone
    assert result.steepest <= result.certificate.tolerance
    assert result.model.provenance["settings"]["prior"]["trials"] == 10.0


def test_one_trial_of_the_prior_holds_what_one_trial_of_such_teachers_does() -> None:
    """The observed information of 150 trials under the truth, off all kinks, against the expected one."""
    trials = operator_trials(150, BELIEVED)
    objective = prepare(trials, WORLD, BELIEVED, Settings(mistake_prior=None))
    point = objective.space.point(vector_of(BELIEVED))
    step = 1e-4 * np.eye(len(point))
    rates = [[objective.value_and_rates(point + s * row)[1] for s in (1, -1)] for row in step]
    observed = -np.array([(ahead - behind) / 2e-4 for ahead, behind in rates]) / len(trials)
    pull = pull_of(Prior(1.0, draws=150), trials, WORLD, BELIEVED, objective.space)
    ratio = np.diag(pull.precision) / np.diag(observed)
    assert ratio[:7].min() > 0.5
    assert ratio[:7].max() < 2.0
    assert np.linalg.eigvalsh(pull.precision)[0] > -1e-12


def test_the_rates_of_the_log_prior_are_those_of_its_values() -> None:
    objective = prepare(TRIALS, WORLD, INTUITIVE, Settings(prior=Prior(5.0), mistake_prior=None))
    assert objective.pull is not None
    rng = np.random.default_rng(0)
    point = objective.pull.centre + rng.normal(0, 0.3, len(objective.pull.centre))
    for row in 1e-6 * np.eye(len(point)):
        ahead, behind = (objective.log_prior(objective.space.vector(point + s * row)) for s in (1, -1))
        expected = float(objective.pull.rates(point) @ row) / 1e-6
        assert (ahead - behind) / 2e-6 == pytest.approx(expected, rel=1e-5, abs=1e-5)
    assert objective.log_prior(objective.space.vector(objective.pull.centre)) == pytest.approx(0, abs=1e-9)


def test_what_has_no_data_stays_where_it_was_whatever_the_prior() -> None:
    trials = [by_hand(["light_on(1)", *["noa"] * 12], [4, 8, 11], trial_id=str(n)) for n in range(3)]
    initial = teacher(falls=(2.5, 1.3, 0.9))
    result = fit(trials, WORLD, initial, starts=2, prior=Prior(50.0, INTUITIVE))
    assert result.model.approvals["that_dist"] == initial.approvals["that_dist"]
    assert result.model.approvals["that_mov"].fall == 2.5
    assert result.marks["that_mov.fall"] == "no data"
    assert abs(result.model.approvals["that_mov"].peak - 0.1) < 0.05


def test_imaginary_trials_have_the_cues_of_the_trials_and_a_seed() -> None:
    prior = Prior(1.0, draws=20)
    one, other = (imagined(prior, TRIALS, WORLD, INTUITIVE) for _ in range(2))
    assert [t.presses.tolist() for t in one] == [t.presses.tolist() for t in other]
    assert {t.trial_id for t in one} == {t.trial_id for t in TRIALS}
    assert all(t.actions in {real.actions for real in TRIALS} for t in one)
    weights = [1.0] + [0.0] * (len(TRIALS) - 1)
    assert {t.trial_id for t in imagined(prior, TRIALS, WORLD, INTUITIVE, weights)} == {TRIALS[0].trial_id}
    gap = replace(TRIALS[0], steps=(replace(TRIALS[0].steps[0], pressed=None), *TRIALS[0].steps[1:]))
    assert all(t.steps[0].pressed is None for t in imagined(prior, [gap], WORLD, INTUITIVE))


def test_the_fit_remembers_whom_the_prior_was_centred_on() -> None:
    """So what is prepared anew from its settings, for intervals, has its maximum where the fit ended."""
    result = fitted(10.0)
    assert result.settings.prior is not None
    assert result.settings.prior.model == INTUITIVE
    objective = prepare(TRIALS, WORLD, result.model, result.settings)
    assert objective.value(objective.space.point(vector_of(result.model))) == pytest.approx(result.objective)


def test_a_stronger_prior_narrows_the_intervals() -> None:
    wide, narrow = (
        uncertainty(result, TRIALS, method="wald") for result in (fitted(STRENGTHS[0]), fitted(STRENGTHS[1]))
    )
    both = [
        (wide[name].standard_error, narrow[name].standard_error)
        for name in ("mistake", "that_mov.peak", "that_dist.peak")
    ]
    ratios = [after / before for before, after in both if before and after]
    assert len(ratios) >= 2
    assert max(ratios) < 1.0


def _walk(world: World, taught: SimulatedTeacher, rng: np.random.Generator) -> Trial:
    state, steps = world.start(), []
    for step in range(30):
        actions = world.actions(state)
        action = actions[int(rng.integers(len(actions)))] if step % 5 == 0 else actions[0]
        state = world.step(state, action)
        steps.append(Step(action, taught.observe(state, rng)))
    return Trial("menu", world, taught.task, tuple(steps))


def test_any_world_and_unknown_tasks_and_delays_take_a_prior() -> None:
    world, truth = menu(3)
    rng = np.random.default_rng(0)
    trials = [_walk(world, SimulatedTeacher(world, truth, task), rng) for task in world.tasks * 2]
    trials[0] = replace(trials[0], task=None)
    result = fit(trials, world, truth, starts=2, delays="shared", prior=Prior(3.0))
    assert result.converged


@pytest.mark.parametrize("strength", [-1.0, float("nan"), float("inf")])
def test_a_strength_that_cannot_be_is_one_error(strength: float) -> None:
    with pytest.raises(ValueError, match=r"prior\.trials: must be a number of trials"):
        Prior(strength)


def test_a_prior_of_another_kind_of_teacher_is_one_error() -> None:
    _, other = menu(2)
    with pytest.raises(FitError, match=r"prior\.model: approval states and their cues"):
        fit(TRIALS, WORLD, prior=Prior(1.0, other))
    with pytest.raises(FitError, match=r"prior\.model: dt"):
        fit(TRIALS, WORLD, prior=Prior(1.0, INTUITIVE.with_dt(0.25)))
