"""Steps that leave the mental state open: keys unrecorded, labelled or in error, and further signals."""

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from taught import WORLD, by_hand, operator_trials, teacher

from learn import FitError, fit, log_likelihood, responsibilities
from learn.coordinates import Bounds, Coordinates, parameters_at, vector_of
from learn.estep import Evidence
from learn.exposure import expose
from taskcomm.belief import Belief
from taskcomm.channels import ObservationModel, TargetChannel
from taskcomm.smoother import smooth
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial

OFF_LATTICE = teacher((0.2, 0.15, 0.1), (1.13, 1.71, 0.93), (1.37, 1.19, 1.83), (0.21, 0.43, 0.87), 0.02)
STATES = OFF_LATTICE.mental_states
BUSY = by_hand(
    ["light_on(1)", "pick_up(1)", "noa", "light_on(2)", "slide(1, 4, 2)", "noa", "slide(1, 3, 2)", "noa"],
    [2, 4, 6],
)
GAZE = TargetChannel(
    {
        state: {"mov": 0.25 + 0.1 * k, "wrt": 0.4 - 0.05 * k, "other": 0.25 - 0.05 * k, "none": 0.1}
        for k, state in enumerate(STATES)
    }
)
SHORT = Bounds(rise=2.0, fall=2.0, delay=0.5)


def seeing(miss: float = 0.0, false_press: float = 0.0, gaze: bool = False) -> TeacherModel:
    channels = {"gaze": GAZE} if gaze else {}
    return replace(OFF_LATTICE, observation=ObservationModel(miss, false_press, channels))


def unrecorded(trial: Trial, at: set[int]) -> Trial:
    steps = [replace(step, pressed=None) if t in at else step for t, step in enumerate(trial.steps)]
    return replace(trial, steps=tuple(steps))


def pressed(trial: Trial, at: int, value: bool) -> Trial:
    steps = list(trial.steps)
    steps[at] = replace(steps[at], pressed=value)
    return replace(trial, steps=tuple(steps))


def labelled(trial: Trial, reasons: dict[int, str], annotator: str = "a") -> Trial:
    seqs = trial.step_seqs
    labels = [
        {"press_seq": seqs[t], "mental_state": state, "annotator": annotator} for t, state in reasons.items()
    ]
    return replace(trial, labels=tuple(labels))


def looking(trial: Trial, seed: int = 0) -> Trial:
    rng = np.random.default_rng(seed)
    steps = [
        replace(step, signals={"gaze": str(rng.choice(["1", "2", "3", "none"]))}) for step in trial.steps
    ]
    return replace(trial, steps=tuple(steps))


def filtered(trial: Trial, model: TeacherModel) -> float:
    """The log-likelihood by the belief, which shares no code with the lattice."""
    prior = None if trial.task is None else np.eye(len(WORLD.tasks))[list(WORLD.tasks).index(trial.task)]
    belief, total = Belief.initial(WORLD, model, prior), 0.0
    for state, step in zip(trial.states, trial.steps, strict=True):
        total += math.log(belief.mental_joint(state, step.pressed, step.signals).sum())
        belief = belief.update(state, step.pressed, step.signals)
    return total


@pytest.mark.parametrize("task_known", [True, False])
@pytest.mark.parametrize("model", [seeing(), seeing(0.2, 0.05), seeing(gaze=True), seeing(0.1, 0.0, True)])
def test_the_likelihood_of_any_observations_is_that_of_the_belief(
    model: TeacherModel, task_known: bool
) -> None:
    trial = looking(unrecorded(BUSY, {3, 5}))
    trial = trial if task_known else replace(trial, task=None)
    assert log_likelihood([trial], WORLD, model) == pytest.approx(filtered(trial, model), rel=1e-10)


@settings(max_examples=20)
@given(st.integers(0, 7), st.sampled_from([seeing(), seeing(0.3, 0.1)]))
def test_an_unrecorded_key_is_the_sum_over_what_it_may_have_been(at: int, model: TeacherModel) -> None:
    both = [log_likelihood([pressed(BUSY, at, value)], WORLD, model) for value in (False, True)]
    assert log_likelihood([unrecorded(BUSY, {at})], WORLD, model) == pytest.approx(
        np.logaddexp(both[0], both[1]), rel=1e-12
    )


def _with_labels(trial: Trial) -> float:
    try:
        evidence = Evidence(expose([trial], WORLD, OFF_LATTICE, labels=True))
    except FitError:  # what is labelled is impossible
        return -math.inf
    return evidence.value(OFF_LATTICE.parameters(WORLD.cue_names))


def test_over_all_labels_of_a_press_the_likelihood_is_that_without_and_their_shares_its_reasons() -> None:
    reasons = responsibilities(BUSY, WORLD, OFF_LATTICE)
    whole = log_likelihood([BUSY], WORLD, OFF_LATTICE)
    for row, at in enumerate((2, 4, 6)):
        shares = [math.exp(_with_labels(labelled(BUSY, {at: state})) - whole) for state in STATES]
        np.testing.assert_allclose(shares, reasons[row], atol=1e-12)


def test_labels_that_disagree_leave_either_reason() -> None:
    one, other = (_with_labels(labelled(BUSY, {4: state})) for state in ("mistake", "that_wrt"))
    both = labelled(BUSY, {4: "mistake"})
    both = replace(both, labels=(*both.labels, *labelled(BUSY, {4: "that_wrt"}, "b").labels))
    assert _with_labels(both) == pytest.approx(np.logaddexp(one, other), rel=1e-12)


def test_of_an_annotator_who_labels_a_press_again_the_last_label_counts() -> None:
    first, last = labelled(BUSY, {4: "mistake"}), labelled(BUSY, {4: "that_wrt"})
    both = replace(last, labels=(*first.labels, *last.labels))
    assert _with_labels(both) == _with_labels(last) != _with_labels(first)


def test_a_label_that_the_model_lacks_is_one_error() -> None:
    with pytest.raises(FitError, match=r"trial hand: step 4 is labelled 'bored', no state of the model"):
        fit([labelled(BUSY, {4: "bored"})], labels=True)


def _evidence(trials: list[Trial], model: TeacherModel) -> Evidence:
    space = Coordinates(model, SHORT, np.arange(19) < 13)
    return Evidence(expose(trials, WORLD, model, space.extent(model.parameters(WORLD.cue_names))))


MIXED = [unrecorded(BUSY, {1, 3, 5}), replace(looking(BUSY), task=None), pressed(BUSY, 2, False)]


@pytest.mark.parametrize("model", [seeing(), seeing(0.2, 0.05, True)])
def test_rates_and_fisher_s_identity_hold_with_unknown_keys(model: TeacherModel) -> None:
    evidence = _evidence(MIXED, model)
    base, vector = model.parameters(WORLD.cue_names), vector_of(model)
    expectation = evidence.expect(base)
    for step, rate in zip(np.eye(19)[:13], expectation.rates[:13], strict=True):
        ends = [evidence.value(parameters_at(vector + sign * 1e-6 * step, base)) for sign in (1, -1)]
        assert rate == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=2e-5, abs=2e-4)
    _, rates = evidence.expected_log_likelihood(base, expectation)
    np.testing.assert_allclose(rates, expectation.rates, rtol=1e-8, atol=1e-8)


def test_reasons_of_presses_are_those_of_all_ways_the_trial_may_have_gone() -> None:
    model, hidden = seeing(), {3, 5}
    expected, total = np.zeros((3, 5)), 0.0
    for values in product([False, True], repeat=2):
        trial = pressed(pressed(BUSY, 3, values[0]), 5, values[1])
        weight = math.exp(log_likelihood([trial], WORLD, model))
        rows = np.searchsorted(np.flatnonzero(trial.presses), [2, 4, 6])
        expected += weight * smooth(trial, model).reasons[rows]
        total += weight
    np.testing.assert_allclose(smooth(unrecorded(BUSY, hidden), model).reasons, expected / total, atol=1e-12)


@pytest.mark.parametrize("mass", [1e-2, 1e-4])
def test_what_a_beam_leaves_out_is_no_more_than_it_says(mass: float) -> None:
    model = seeing(0.3, 0.01)
    trials = [replace(trial, steps=trial.steps[:40]) for trial in operator_trials(6, teacher())]
    extent = Coordinates(model, SHORT, np.arange(19) < 13).extent(model.parameters(WORLD.cue_names))
    exact, pruned = (expose(trials, WORLD, model, extent, dropped_mass=drop) for drop in (0.0, mass))
    parameters = model.parameters(WORLD.cue_names)
    gap = Evidence(exact).log_likelihoods(parameters) - Evidence(pruned).log_likelihoods(parameters)
    assert len(pruned.lattice.memory_next) < len(exact.lattice.memory_next)
    assert (gap > -1e-10).all()
    assert gap.max() > mass / 100
    bound = np.bincount(pruned.unit_trial, pruned.lattice.unit_dropped)
    assert (gap <= bound + 1e-10).all()
    assert bound.max() < 100 * mass


def test_a_fit_to_trials_with_gaps_finds_the_teacher_and_never_falls() -> None:
    truth, rng = teacher(), np.random.default_rng(3)
    whole = operator_trials(60, truth)
    gaps = [unrecorded(trial, set(np.flatnonzero(rng.random(trial.num_steps) < 0.1))) for trial in whole]
    found, complete = (
        fit(gaps, starts=2, bounds=Bounds(4.0, 4.0)),
        fit(whole, starts=2, bounds=Bounds(4.0, 4.0)),
    )
    assert found.monotone
    assert found.converged
    peaks = [[top.peak for top in result.model.approvals.values()] for result in (found, complete)]
    np.testing.assert_allclose(peaks[0], peaks[1], rtol=0.35)
    assert 0 < -found.log_likelihood < -complete.log_likelihood
    assert [len(rows) for rows in found.responsibilities] == [int(trial.presses.sum()) for trial in gaps]


def test_a_trial_that_no_reason_allows_is_one_error() -> None:
    nobody_looks = {
        state: dict(zip(("mov", "wrt", "other", "none"), (0.5, 0.5, 0, 0), strict=True)) for state in STATES
    }
    model = replace(
        OFF_LATTICE, observation=ObservationModel(0.0, 0.0, {"gaze": TargetChannel(nobody_looks)})
    )
    for key in (False, True, None):
        step = replace(BUSY.steps[0], pressed=key, signals={"gaze": "none"})
        with pytest.raises(ValueError, match=r"trial hand: what was observed is impossible under the model"):
            smooth(replace(BUSY, steps=(step,)), model)
