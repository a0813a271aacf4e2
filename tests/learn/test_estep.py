"""The E-step: likelihoods, responsibilities and rates against what computes them otherwise."""

import math
import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import oracles
import pytest
from hypothesis import given
from hypothesis import strategies as st
from resetfilter import log_likelihoods as plainly
from strategies import models, walks
from taught import CUES, WORLD, by_hand, operator_trials, teacher

from learn import FitError, fit, log_likelihood, log_likelihoods, responsibilities, trial_hash
from learn.coordinates import Bounds, Coordinates, parameters_at, vector_of
from learn.estep import Evidence
from learn.exposure import expose
from taskcomm.lattice import Extent
from taskcomm.teacher import TableTop, TeacherModel
from taskcomm.trials import Step, Trial
from taskcomm.world import NOA, Action, BallWorld

SMALL = BallWorld(num_balls=2, num_distances=2)
OFF_LATTICE = teacher((0.2, 0.15, 0.1), (1.13, 1.71, 0.93), (1.37, 1.19, 1.83), (0.21, 0.43, 0.87), 0.02)


@st.composite
def short_trials(draw: st.DrawFn) -> Trial:
    walk = draw(walks(SMALL, 9))
    presses = draw(st.sets(st.integers(0, len(walk) - 1), max_size=3))
    steps = tuple(Step(action, t in presses) for t, (action, _) in enumerate(walk))
    return Trial("short", SMALL, draw(st.sampled_from(SMALL.tasks)), steps)


@given(st.lists(short_trials(), min_size=1, max_size=3), models())
def test_likelihood_and_responsibilities_equal_enumeration(trials: list[Trial], model: TeacherModel) -> None:
    total = 0.0
    for trial in trials:
        task = next(k for k, task in enumerate(SMALL.tasks) if task == trial.task)
        cues = oracles.cue_columns(SMALL, model, trial.states, task)
        paths = oracles.paths(model, cues, list(trial.presses))
        evidence = math.fsum(paths.values())
        total += math.log(evidence)
        expected = np.zeros((int(trial.presses.sum()), len(model.mental_states)))
        for path, weight in paths.items():
            for row, step in enumerate(np.flatnonzero(trial.presses)):
                expected[row, model.mental_states.index(path[step])] += weight / evidence
        np.testing.assert_allclose(responsibilities(trial, SMALL, model), expected, rtol=0, atol=1e-12)
    assert log_likelihood(trials, SMALL, model) == pytest.approx(total, rel=1e-12, abs=1e-12)


def test_likelihoods_of_operator_trials_equal_those_of_the_unmerged_filter() -> None:
    trials = operator_trials(6, teacher())
    for model in (TeacherModel.intuitive(), teacher(), OFF_LATTICE):
        expected = [plainly(trial, list(CUES.values()), vector_of(model)[None])[0] for trial in trials]
        np.testing.assert_allclose(log_likelihoods(trials, WORLD, model), expected, rtol=1e-12)


def test_order_and_batches_of_trials_change_nothing() -> None:
    trials = operator_trials(6, teacher())
    whole = log_likelihoods(trials, WORLD, OFF_LATTICE)
    backwards = log_likelihoods(trials[::-1], WORLD, OFF_LATTICE)[::-1]
    halves = [
        *log_likelihoods(trials[:2], WORLD, OFF_LATTICE),
        *log_likelihoods(trials[2:], WORLD, OFF_LATTICE),
    ]
    np.testing.assert_allclose(backwards, whole, rtol=1e-13)
    np.testing.assert_allclose(halves, whole, rtol=1e-13)


def test_an_unknown_task_is_summed_over_with_its_prior() -> None:
    trial = operator_trials(1, teacher())[0]
    prior = np.random.default_rng(0).dirichlet(np.ones(len(WORLD.tasks)))
    prior[3] = 0.0
    prior /= prior.sum()
    known = [log_likelihood([replace(trial, task=task)], WORLD, OFF_LATTICE) for task in WORLD.tasks]
    expected = math.log(sum(p * math.exp(value - max(known)) for p, value in zip(prior, known, strict=True)))
    unknown = log_likelihood([replace(trial, task=None)], WORLD, OFF_LATTICE, prior)
    assert unknown == pytest.approx(expected + max(known), rel=1e-12)


def _evidence(trials: tuple[Trial, ...], model: TeacherModel) -> tuple[Evidence, Coordinates]:
    space = Coordinates(model, Bounds(), np.arange(19) < 13)
    extent = space.extent(model.parameters(WORLD.cue_names))
    return Evidence(expose(trials, WORLD, model, extent)), space


def _mixed() -> tuple[Trial, ...]:
    trials = operator_trials(6, teacher())
    return (replace(trials[0], task=None), *trials[1:])


@pytest.mark.parametrize("rest", [0.0, 1.0])
@pytest.mark.parametrize("decay", [None, 2.3])
def test_rates_are_those_of_the_likelihood_off_kinks(decay: float | None, rest: float) -> None:
    tops = {state: replace(top, decay=decay, hold=0.7) for state, top in OFF_LATTICE.approvals.items()}
    model = replace(OFF_LATTICE, approvals=tops, rest=rest)
    evidence, _ = _evidence(_mixed(), model)
    base, vector = model.parameters(WORLD.cue_names), vector_of(model)
    rates = evidence.expect(parameters_at(vector, base)).rates
    assert (rates[13:] != 0).all() == (decay is not None)
    for step, rate in zip(np.eye(19), rates, strict=True):
        ends = [evidence.value(parameters_at(vector + sign * 1e-6 * step, base)) for sign in (1, -1)]
        assert rate == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=2e-5, abs=2e-4)


def test_weights_multiply_the_log_likelihoods_of_trials_and_all_that_is_expected() -> None:
    evidence, _ = _evidence(_mixed(), OFF_LATTICE)
    base = OFF_LATTICE.parameters(WORLD.cue_names)
    weights = np.array([2.0, 0.0, 1.0, 0.5, 3.0, 1.0])
    each = [_evidence((trial,), OFF_LATTICE)[0].expect(base) for trial in _mixed()]
    weighted = evidence.with_weights(weights).expect(base)
    assert weighted.value == pytest.approx(sum(w * one.value for w, one in zip(weights, each, strict=True)))
    np.testing.assert_allclose(
        weighted.rates, sum(w * one.rates for w, one in zip(weights, each, strict=True)), rtol=1e-9
    )
    counts = [w * one.press.sum() for w, one in zip(weights, each, strict=True)]
    assert weighted.press.sum() == pytest.approx(sum(counts))


def test_at_its_own_parameters_the_expected_log_likelihood_has_the_rates_of_the_likelihood() -> None:
    """Fisher's identity."""
    evidence, _ = _evidence(_mixed(), OFF_LATTICE)
    base = OFF_LATTICE.parameters(WORLD.cue_names)
    expectation = evidence.expect(base)
    _, rates = evidence.expected_log_likelihood(base, expectation)
    np.testing.assert_allclose(rates, expectation.rates, rtol=1e-8, atol=1e-8)


def test_raising_the_expected_log_likelihood_raises_the_likelihood_at_least_as_much() -> None:
    evidence, space = _evidence(_mixed(), OFF_LATTICE)
    base = OFF_LATTICE.parameters(WORLD.cue_names)
    before = evidence.expect(base)
    q_before, _ = evidence.expected_log_likelihood(base, before)
    rng = np.random.default_rng(0)
    here = space.point(vector_of(OFF_LATTICE))
    gains = []
    for scale in np.geomspace(1e-3, 0.3, 30):
        there = parameters_at(space.vector(here + rng.normal(0, scale, len(here))), base)
        gain = evidence.expected_log_likelihood(there, before)[0] - q_before
        gains.append(evidence.expect(there).value - before.value - gain)
    assert min(gains) >= -1e-9
    assert max(gains) > 0.01


def test_a_task_under_which_nothing_differs_is_summed_once() -> None:
    """All cues off: 24 tasks, one table of cues."""
    quiet = replace(by_hand(["noa", "noa"], presses=[1]), task=None)
    exposure = expose([quiet], WORLD, TeacherModel.intuitive())
    assert len(exposure.unit_trial) == 1
    assert exposure.unit_prior[0] == pytest.approx(1)


def test_merging_keeps_the_memories_of_operator_trials_few() -> None:
    trials = operator_trials(6, teacher())
    model = TeacherModel.intuitive()
    wide = replace(Extent.of(model.parameters(WORLD.cue_names)), rise=np.full(3, 10.0), fall=np.full(3, 10.0))
    for trial in trials:
        layers = np.diff(expose([trial], WORLD, model, wide).lattice.layer_memories)
        unmerged = (np.arange(len(layers)) + 1) ** 3
        assert layers.sum() < unmerged.sum() / 4


def test_the_hash_of_a_trial_follows_what_a_fit_depends_on() -> None:
    trial = by_hand(["noa", "light_on(1)"], presses=[1])
    same = replace(trial, trial_id="other", participant_id="p1", reason="final")
    others = [
        replace(trial, dt=0.25),
        replace(trial, task=None),
        replace(trial, task=WORLD.tasks[1]),
        by_hand(["noa", "light_on(2)"], presses=[1]),
        by_hand(["noa", "light_on(1)"], presses=[0]),
    ]
    assert trial_hash(same) == trial_hash(trial)
    assert len({trial_hash(each) for each in [trial, *others]}) == 6


ONE = Trial("one", WORLD, WORLD.tasks[0], (Step(NOA, False),))
STRANGE = TeacherModel(0.01, {"that_mov": TableTop("whistled", 0.1, 1.0, 1.0)})


@pytest.mark.parametrize(
    ("trials", "model", "message"),
    [
        ([], TeacherModel.intuitive(), "no trials"),
        ([replace(ONE, steps=())], TeacherModel.intuitive(), "trial one: has no steps"),
        (
            [ONE, replace(ONE, trial_id="two", dt=0.25)],
            TeacherModel.intuitive(),
            "two dt in one fit: 0.5 s in",
        ),
        ([ONE], TeacherModel.intuitive().with_dt(0.25), "dt = 0.5 s in the trials, but 0.25 s in the model"),
        ([ONE], STRANGE, "unknown cue 'whistled'"),
        ([replace(ONE, world=SMALL)], TeacherModel.intuitive(), "trial one: took place in BallWorld"),
        (
            [replace(ONE, steps=(Step(Action.parse("release(1)"), False),))],
            TeacherModel.intuitive(),
            r"trial one: release\(1\) is not valid in",
        ),
        ([replace(ONE, task=(1, 1, 1))], TeacherModel.intuitive(), r"trial one: \(1, 1, 1\) is not a task"),
    ],
)
def test_trials_that_cannot_be_scored_are_one_error(
    trials: list[Trial], model: TeacherModel, message: str
) -> None:
    with pytest.raises(FitError, match=message):
        log_likelihood(trials, WORLD, model)


def test_an_error_names_what_there_are_no_trials_for_and_the_trials_that_it_speaks_of() -> None:
    with pytest.raises(FitError, match=r"^no trials: a log-likelihood needs at least one$"):
        log_likelihood([], WORLD, TeacherModel.intuitive())
    with pytest.raises(FitError, match="two dt") as found:
        log_likelihood([ONE, replace(ONE, trial_id="two", dt=0.25)], WORLD, TeacherModel.intuitive())
    assert found.value.trial_ids == ("one", "two")
    assert pickle.loads(pickle.dumps(found.value)).trial_ids == ("one", "two")


@pytest.mark.parametrize(
    ("trials", "message"),
    [
        (ONE, r"^trials: must be a list of trials, not one; \[trial\] is one of trial one$"),
        ("logs.jsonl", r"^trials: must be trials, not 'logs\.jsonl'; taskcomm\.read_trials reads them"),
        ([ONE, "two"], r"^trials\[1\]: must be a Trial, not 'two'$"),
        (None, "^trials: must be a list of trials, not None$"),
    ],
)
def test_what_are_no_trials_is_a_type_error(trials: Any, message: str) -> None:
    model = TeacherModel.intuitive()
    for use in (lambda: log_likelihood(trials, WORLD, model), lambda: fit(trials, WORLD)):
        with pytest.raises(TypeError, match=message):
            use()
    if trials is not ONE:
        with pytest.raises(TypeError, match=r"^trial: must be one Trial, not a (str|list|NoneType)$"):
            responsibilities(trials, WORLD, model)


def test_a_prior_that_is_none_is_an_error() -> None:
    with pytest.raises(FitError, match="prior: must be 24 probabilities"):
        log_likelihood([ONE], WORLD, TeacherModel.intuitive(), prior=[0.5, 0.5])
