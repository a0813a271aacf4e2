"""Accounts of the same presses: what each one is, and that they are scored alike."""

import json
from dataclasses import replace

import numpy as np
import pytest
from cuestudy import TRUE, WORLD, cue_trials, slower
from hypothesis import given
from hypothesis import strategies as st

from learn import Bounds, FitError, fit, log_likelihoods
from learn.baselines import BINS, CONSTANT, DECAY, FITTED, Baselines, compare_baselines, informed_parameters
from learn.freebins import EDGES, FreeBins, cells, steps_since_change
from learn.settings import Settings
from learn.timescale import settings_at
from taskcomm.cueworld import CueWorld, intuitive_for
from taskcomm.trials import Step, Trial

GIVEN = {"intuitive": intuitive_for(WORLD, 0.5)}
FAST = Settings(starts=1, bounds=Bounds(rise=4.0, fall=4.0))


@pytest.fixture(scope="module")
def found() -> Baselines:
    fitted = fit(cue_trials(), WORLD, GIVEN["intuitive"], settings=FAST)
    return compare_baselines(cue_trials(), fitted, GIVEN, folds=2)


def trial_of(cues: list[str], presses: list[bool | None]) -> Trial:
    world = CueWorld(("a", "b"))
    steps = tuple(Step(world.show(on), pressed) for on, pressed in zip(cues, presses, strict=True))
    return Trial("t", world, world.tasks[0], steps)


@given(st.lists(st.sampled_from(["", "a", "b", "ab"]), min_size=1, max_size=60))
def test_the_cells_of_a_trial_are_its_steps_each_once(cues: list[str]) -> None:
    trial = trial_of(cues, [False] * len(cues))
    steps = np.concatenate([at for _, at in cells(trial)])
    assert steps.tolist() == list(range(len(cues)))
    table = np.array([["a" in on, "b" in on] for on in cues])
    since = steps_since_change(table)
    for (pattern, number), at in cells(trial):
        assert all(table[t].tobytes() == pattern for t in at)
        later = EDGES[number + 1] if number + 1 < len(EDGES) else np.inf
        assert all(EDGES[number] <= since[t] < later for t in at)
    for t, steps_ago in enumerate(since):
        assert all(set(cues[t - k]) == set(cues[t]) for k in range(steps_ago + 1))
        assert steps_ago == t or set(cues[t - steps_ago - 1]) != set(cues[t])


def test_free_bins_are_shares_of_presses_with_one_step_added() -> None:
    trial = trial_of(["", "a", "a", "a", ""], [False, True, False, None, True])
    bins = FreeBins.fit([trial])
    assert bins.pooled == 2.5 / 5  # two presses in four recorded steps
    assert bins.press_probability(trial) == pytest.approx([1.5 / 3, 1.5 / 2, 0.5 / 2, 0.5 / 1, 1.5 / 3])
    unseen = trial_of(["b"], [False])
    assert bins.press_probability(unseen) == pytest.approx([0.5])
    assert bins.num_free == 4


def test_a_constant_is_one_number_and_steps_that_were_not_recorded_count_for_nothing() -> None:
    trial = trial_of(["", "a", "b"], [False, True, None])
    constant = FreeBins.fit([trial], constant=True)
    assert constant.num_free == 1
    assert constant.pooled == 1.5 / 3
    assert constant.log_likelihoods([trial]) == pytest.approx([2 * np.log(0.5)])


def test_every_account_is_scored_on_all_trials(found: Baselines) -> None:
    assert list(found.arms) == [CONSTANT, "intuitive", FITTED, DECAY, BINS]
    for arm in found.arms.values():
        assert arm.log_likelihood.shape == arm.held_out.shape == (len(cue_trials()),)
        assert np.isfinite(arm.held_out).all()
        assert arm.converged
    given = found.arms["intuitive"]
    assert given.parameters == 0
    assert given.log_likelihood == pytest.approx(log_likelihoods(cue_trials(), WORLD, GIVEN["intuitive"]))


def test_more_freedom_never_costs_likelihood_where_it_was_fitted(found: Baselines) -> None:
    total = {name: float(arm.log_likelihood.sum()) for name, arm in found.arms.items()}
    assert total[FITTED] >= total["intuitive"]
    assert total[BINS] > total[CONSTANT]
    parameters = {name: arm.parameters for name, arm in found.arms.items()}
    assert parameters[CONSTANT] == 1
    assert parameters[FITTED] == 7
    assert parameters[DECAY] == 9
    assert parameters[BINS] > 25


def test_where_the_teacher_is_a_table_top_the_table_top_foresees_best(found: Baselines) -> None:
    for other in (CONSTANT, BINS):
        assert found.per_trial(FITTED).estimate > found.per_trial(other).estimate
    assert min(found.arms, key=found.bic) == FITTED


def test_a_trial_is_scored_by_fits_that_did_not_see_its_person(found: Baselines) -> None:
    person = {name: set() for name in found.people}  # type: dict[str, set[int]]
    for name, fold in zip(found.people, found.fold.tolist(), strict=True):
        person[name].add(fold)
    assert all(len(folds) == 1 for folds in person.values())
    left_out = [t for t, fold in zip(cue_trials(), found.fold, strict=True) if fold == 0]
    kept = [t for t, fold in zip(cue_trials(), found.fold, strict=True) if fold != 0]
    expected = FreeBins.fit(kept).log_likelihoods(left_out)
    assert found.arms[BINS].held_out[found.fold == 0] == pytest.approx(expected)
    refitted = fit(kept, WORLD, GIVEN["intuitive"], settings=FAST).model
    expected = np.asarray(log_likelihoods(left_out, WORLD, refitted))
    assert found.arms[FITTED].held_out[found.fold == 0] == pytest.approx(expected)


def test_bic_counts_parameters_by_people(found: Baselines) -> None:
    assert len(set(found.people)) == 6
    for name, arm in found.arms.items():
        expected = arm.parameters * np.log(6) - 2 * arm.log_likelihood.sum()
        assert found.bic(name) == pytest.approx(expected)


def test_one_person_alone_is_held_out_trial_by_trial_and_one_trial_is_an_error() -> None:
    alone = [replace(trial, participant_id="p0") for trial in cue_trials(4, 40)]
    fitted = fit(alone, WORLD, GIVEN["intuitive"], starts=1, search=False, decays=True)
    found = compare_baselines(alone, fitted, {}, folds=2)
    assert found.held_out_by == "trial"
    assert list(found.arms) == [CONSTANT, FITTED, BINS]  # it has a decay already
    with pytest.raises(FitError, match="at least two"):
        compare_baselines(alone[:1], fitted, {})


def test_a_table_of_accounts_is_plain_json(found: Baselines) -> None:
    document = json.loads(json.dumps(found.to_json()))
    assert [row["account"] for row in document["accounts"]] == list(found.arms)
    assert document["held_out_by"] == "person"
    assert document["folds"] == 2


def test_a_parameter_that_nothing_informed_is_not_counted() -> None:
    steps = [Step(WORLD.show(["light"] if t > 9 else []), t % 7 == 6) for t in range(40)]  # never off again
    result = fit([Trial("t", WORLD, WORLD.tasks[0], tuple(steps))], WORLD, GIVEN["intuitive"], settings=FAST)
    assert result.marks["that_light.fall"] == "no data"
    assert informed_parameters(result) == result.num_free - 1 == 3


@pytest.mark.parametrize("factor", [0.1, 10.0])
def test_the_length_of_a_step_is_a_matter_of_units(factor: float) -> None:
    """With all times, dt too, ten times as long or short, the same fit comes out, in those units."""
    trials = cue_trials()
    scaled = [replace(trial, dt=trial.dt * factor) for trial in trials]
    one = fit(trials, WORLD, TRUE, settings=FAST, mistake_prior=None)
    settings = replace(settings_at(0.5 * factor, FAST), mistake_prior=None)
    other = fit(scaled, WORLD, slower(TRUE, factor), settings=settings)
    assert one.converged
    assert other.converged
    assert other.log_likelihood == pytest.approx(one.log_likelihood, abs=0.01)
    assert slower(one.model, factor).mistake == pytest.approx(other.model.mistake, rel=1e-2)
    for state, top in slower(one.model, factor).approvals.items():
        assert other.model.approvals[state].peak == pytest.approx(top.peak, rel=2e-2)
        assert other.model.approvals[state].rise == pytest.approx(top.rise, rel=2e-2)


@given(st.floats(0.01, 20.0))
def test_the_prior_on_mistake_keeps_its_rate_and_its_weight_in_seconds(dt: float) -> None:
    scaled, plain = settings_at(dt).mistake_prior, Settings().mistake_prior
    assert scaled is not None
    assert plain is not None
    assert np.log1p(-scaled.mean) / dt == pytest.approx(np.log1p(-plain.mean) / 0.5)
    assert scaled.steps * dt == pytest.approx(plain.steps * 0.5)
    assert settings_at(0.5) == Settings()
