"""Fits: monotone, found again, independent of order, honest about what they know."""

from collections.abc import Hashable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from taught import WORLD, by_hand, operator_trials, teacher
from tinyworld import menu

from learn import Bounds, FitError, FitResult, MistakePrior, fit, log_likelihood, responsibilities
from learn.coordinates import names_of, vector_of
from taskcomm.simulate import SimulatedTeacher
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Step, Trial

TRUTH = teacher()
NAMES = names_of(["that_mov", "that_wrt", "that_dist"])


@cache
def fitted(count: int = 16) -> FitResult:
    return fit(operator_trials(count, TRUTH), WORLD)


def test_the_objective_rises_at_every_iteration_of_every_start() -> None:
    result = fitted()
    assert len(result.paths) == 6
    for path, start in zip(result.paths, result.starts, strict=True):
        assert len(path) > 2
        assert np.diff(path).min() >= -1e-10 * abs(path[0])
        assert path[0] == start.begun
    assert result.monotone
    assert result.paths[result.best_start][-1] == pytest.approx(result.objective, abs=1e-6)


def test_the_search_adds_to_what_em_alone_had_reached() -> None:
    result = fitted()
    assert result.em_alone == max(start.em_alone for start in result.starts)
    assert result.search_gain == result.objective - result.em_alone > 0.1


def test_the_likelihood_of_a_fit_is_that_of_its_model_and_beats_the_truth() -> None:
    result, trials = fitted(), operator_trials(16, TRUTH)
    assert log_likelihood(trials, WORLD, result.model) == pytest.approx(result.log_likelihood, rel=1e-12)
    prior = MistakePrior()
    assert result.objective > log_likelihood(trials, WORLD, TRUTH) + prior.log_density(TRUTH.mistake)
    assert result.objective == result.log_likelihood + prior.log_density(result.model.mistake)
    assert result.log_likelihoods.sum() == pytest.approx(result.log_likelihood)


def test_simulated_parameters_are_found_again_within_their_spread() -> None:
    """120 trials, ten parameters: twice the gain over the truth is chi-squared, above 30 once in 1000;
    what more than 15 presses bear on has a standard error of about 0.15 on its logarithm."""
    trials = operator_trials(120, TRUTH, seed=1)
    result = fit(trials, WORLD, starts=3)
    assert result.converged
    assert 0 < 2 * (result.log_likelihood - log_likelihood(trials, WORLD, TRUTH)) < 30
    error = np.log(vector_of(result.model)[:10] / vector_of(TRUTH)[:10])
    informed = [name for name in NAMES[:10] if result.presses[name] > 15]
    assert len(informed) == 7
    assert max(abs(error[NAMES.index(name)]) for name in informed) < 0.45
    intuitive = log_likelihood(trials, WORLD, TeacherModel.intuitive())
    assert result.log_likelihood > intuitive + 50


def test_delays_are_found_again_when_they_are_asked_for() -> None:
    late = teacher(peaks=(0.3, 0.3, 0.3), delays=(0.8, 0.8, 0.8))
    trials = operator_trials(40, late)
    with_delays, without = fit(trials, WORLD, starts=3, delays=True), fit(trials, WORLD, starts=3)
    assert with_delays.log_likelihood > without.log_likelihood + 10
    found = [top.delay for top in with_delays.model.approvals.values()]
    assert all(0.3 < delay < 1.3 for delay in found)
    assert with_delays.num_free == without.num_free + 3 == 13
    assert all(top.delay == 0 for top in without.model.approvals.values())


def test_a_shared_delay_and_decays_are_found_again() -> None:
    late = teacher(peaks=(0.3, 0.3, 0.3), delays=(0.8, 0.8, 0.8))
    tops = {state: replace(top, decay=2.0) for state, top in late.approvals.items()}
    trials = operator_trials(60, replace(late, approvals=tops))
    plain = fit(trials, WORLD, starts=2)
    found = fit(trials, WORLD, starts=3, delays="shared", decays=True)
    assert found.log_likelihood > plain.log_likelihood + 20
    assert found.num_free == plain.num_free + 1 + 3
    delays = {top.delay for top in found.model.approvals.values()}
    assert len(delays) == 1
    assert 0.3 < delays.pop() < 1.3
    decays = [top.decay for top in found.model.approvals.values()]
    assert all(decay is not None and 1 < decay < 5 for decay in decays)


def test_whole_number_weights_count_trials_so_many_times() -> None:
    trials = operator_trials(8, TRUTH)
    weights = [2, 0, 1, 1, 3, 0, 1, 1]
    weighted = fit(trials, WORLD, starts=1, weights=weights)
    repeated = [
        replace(trial, trial_id=f"{trial.trial_id}-{k}")
        for trial, w in zip(trials, weights, strict=True)
        for k in range(w)
    ]
    expected = fit(repeated, WORLD, starts=1)
    assert weighted.objective == pytest.approx(expected.objective, abs=1e-4)
    counted = sum(weighted.presses[name] for name in NAMES[:4])
    assert counted == pytest.approx(sum(trial.presses.sum() for trial in repeated), rel=1e-9)
    np.testing.assert_allclose(
        [r.sum() for r in weighted.responsibilities], [t.presses.sum() for t in trials]
    )


@pytest.mark.parametrize("weights", [[1.0], [0.0] * 8, [1.0] * 7 + [-1.0]])
def test_weights_that_cannot_be_are_one_error(weights: list[float]) -> None:
    with pytest.raises(FitError, match="weights: must be"):
        fit(operator_trials(8, TRUTH), WORLD, weights=weights)


def test_an_unknown_task_costs_little_when_trials_show_it() -> None:
    trials = operator_trials(8, TRUTH)
    blind = tuple(replace(trial, task=None) for trial in trials[:4]) + trials[4:]
    result = fit(blind, WORLD, starts=2)
    assert result.converged
    assert result.monotone
    np.testing.assert_allclose(
        result.responsibilities[0], responsibilities(blind[0], WORLD, result.model), rtol=0, atol=1e-10
    )
    known = fit(trials, WORLD, starts=2)
    assert log_likelihood(trials, WORLD, result.model) > known.log_likelihood - 5


def test_the_order_of_trials_changes_nothing() -> None:
    trials = operator_trials(8, TRUTH)
    one, other = fit(trials, WORLD, starts=2), fit(trials[::-1], WORLD, starts=2)
    assert one.objective == pytest.approx(other.objective, abs=1e-6)
    np.testing.assert_allclose(vector_of(one.model), vector_of(other.model), rtol=1e-3)


def test_a_seed_gives_the_same_fit_to_the_last_digit() -> None:
    trials = operator_trials(6, TRUTH)
    one, other = (fit(trials, WORLD, starts=5, seed=3) for _ in range(2))
    assert one.model.to_json() == other.model.to_json()
    assert all((a == b).all() for a, b in zip(one.paths, other.paths, strict=True))


def test_responsibilities_of_a_fit_are_those_of_its_model() -> None:
    result, trials = fitted(), operator_trials(16, TRUTH)
    assert len(result.responsibilities) == len(trials)
    for trial, reasons in zip(trials, result.responsibilities, strict=True):
        expected = responsibilities(trial, WORLD, result.model)
        np.testing.assert_allclose(reasons, expected, rtol=0, atol=1e-10)


def test_counts_say_how_many_steps_and_presses_informed_each_parameter() -> None:
    result, trials = fitted(), operator_trials(16, TRUTH)
    by_reason = np.concatenate(result.responsibilities).sum(axis=0)
    expected = [result.presses[name] for name in NAMES[:4]]
    np.testing.assert_allclose(expected, by_reason[1:], atol=1e-6)
    assert sum(expected) == pytest.approx(sum(trial.presses.sum() for trial in trials))
    steps = sum(trial.num_steps for trial in trials)
    for name in NAMES:
        assert 0 <= result.presses[name] <= result.steps[name] + 1e-9 <= steps + 1e-6
    assert result.steps["that_mov.rise"] < result.steps["that_mov.peak"] < steps


def test_the_table_shows_every_learned_parameter_once() -> None:
    table = fitted().table()
    assert [row.parameter for row in table[:4]] == [
        "mistake",
        "that_mov.peak",
        "that_mov.rise",
        "that_mov.fall",
    ]
    assert len(table) == 10
    assert table[0].initial == 0.005
    assert table[0].learned == fitted().model.mistake


def test_the_model_carries_where_it_came_from() -> None:
    result = fitted()
    note = result.model.provenance
    assert note["trial_sha256"] == sorted(result.trial_hashes)
    assert note["converged"] is True
    assert note["initial_sha256"] == TeacherModel.intuitive().sha256
    assert note["settings"]["starts"] == 6
    assert note["log_likelihood"] == result.log_likelihood
    assert TeacherModel.from_json(result.model.to_json()).provenance["trial_sha256"] == note["trial_sha256"]


def test_an_exhausted_iteration_limit_is_never_called_converged() -> None:
    result = fit(operator_trials(6, TRUTH), WORLD, starts=1, max_iter=2)
    assert not result.converged
    assert result.status == "not converged: EM still rising after 2 iterations"
    assert result.model.provenance["converged"] is False
    assert result.model != TeacherModel.intuitive()


def test_progress_counts_up_to_its_total() -> None:
    calls: list[tuple[int, int]] = []
    fit(operator_trials(3, TRUTH), WORLD, starts=2, progress=lambda done, total: calls.append((done, total)))
    assert calls == [(1, 4), (2, 4), (3, 4), (4, 4)]


def test_a_cue_never_on_keeps_its_parameters_and_says_so() -> None:
    trials = [by_hand(["light_on(1)", *["noa"] * 8], presses=[4, 8], trial_id=str(n)) for n in range(3)]
    initial = teacher(peaks=(0.1, 0.123, 0.2), rises=(2.0, 1.7, 1.1), falls=(2.0, 1.3, 0.9))
    result = fit(trials, WORLD, initial, starts=5)
    for state in ("that_wrt", "that_dist"):
        assert result.model.approvals[state] == initial.approvals[state]
        assert [result.marks[f"{state}.{name}"] for name in ("peak", "rise", "fall")] == ["no data"] * 3
        assert f"{state}.peak has no data: no step bears on it, and it stays where it was." in result.remarks
    assert result.marks["that_mov.fall"] == "no data"  # the light never goes off
    assert result.model.approvals["that_mov"].fall == 2.0
    assert result.num_free == 4


def test_trials_without_a_press_can_be_fitted_but_the_fit_is_degenerate() -> None:
    trials = [by_hand(["light_on(1)", *["noa"] * 8], presses=[])]
    result = fit(trials, WORLD)
    assert result.status.startswith("degenerate: no press in any trial")
    assert result.model.approvals["that_mov"].peak < 1e-5
    assert result.marks["that_mov.peak"] == "at its bound"
    assert result.responsibilities[0].shape == (0, 5)


def test_ten_thousand_steps_with_500_presses_are_fitted_or_refused_by_a_stated_bound() -> None:
    rng = np.random.default_rng(0)
    presses = sorted(rng.choice(10_000, 500, replace=False).tolist())
    lit = by_hand(["light_on(1)"] + ["noa"] * 9_999, presses)
    assert fit([lit], WORLD, starts=1).log_likelihood > log_likelihood([lit], WORLD, TeacherModel.intuitive())
    restless = by_hand(["light_on(1)", "light_off(1)"] * 5_000, presses)
    with pytest.raises(FitError, match="trial hand: more than 20000 memories by event"):
        fit([restless], WORLD)


def _walk(world: Any, taught: SimulatedTeacher, rng: np.random.Generator) -> Trial:
    state: Hashable = world.start()
    steps = []
    for step in range(40):
        actions = world.actions(state)
        action = actions[int(rng.integers(len(actions)))] if step % 5 == 0 else actions[0]
        state = world.step(state, action)
        steps.append(Step(action, taught.observe(state, rng)))
    return Trial("menu", world, taught.task, tuple(steps))


@pytest.mark.parametrize("num_cues", [1, 3])
def test_a_world_without_balls_is_fitted_like_any_other(num_cues: int) -> None:
    world, truth = menu(num_cues)
    rng = np.random.default_rng(0)
    trials = [_walk(world, SimulatedTeacher(world, truth, task), rng) for task in world.tasks * 4]
    result = fit(trials, world, truth, starts=2)
    assert result.converged
    assert len(result.table()) == 1 + 3 * min(num_cues, 3)
    assert result.log_likelihood >= log_likelihood(trials, world, truth)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"starts": 0}, "starts: must be at least 1, not 0"),
        ({"max_iter": 0}, "max_iter: must be at least 1, not 0"),
        ({"delays": "none"}, "delays: must be False, True or 'shared', not 'none'"),
        ({"task_prior": [1.0]}, "prior: must be 24 probabilities"),
    ],
)
def test_settings_that_cannot_be_are_one_error(options: dict[str, Any], message: str) -> None:
    with pytest.raises(FitError, match=message):
        fit(operator_trials(1, TRUTH), WORLD, **options)


def test_bounds_and_priors_name_what_is_wrong_with_them() -> None:
    with pytest.raises(ValueError, match=r"bounds\.fall: must be a positive number"):
        Bounds(fall=-1.0)
    with pytest.raises(ValueError, match="mistake prior: needs"):
        MistakePrior(mean=0.0)


def test_no_trials_are_an_error() -> None:
    with pytest.raises(FitError, match="no trials"):
        fit([])
