"""Numbers far out of every distribution: improbable, never impossible, and the likelihood stays exact."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import norm
from taught import WORLD, by_hand, operator_trials, teacher

from learn import fit, log_likelihood, responsibilities
from learn.coordinates import Bounds
from learn.em import prepare
from learn.estep import Evidence
from learn.exposure import expose
from learn.information import curvature
from learn.settings import Settings
from taskcomm.belief import Belief
from taskcomm.channels import NormalChannel, ObservationModel
from taskcomm.replay import press_reasons
from taskcomm.smoother import smooth
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial

TRUTH = teacher()
STATES = TRUTH.mental_states
ALIKE = NormalChannel(dict.fromkeys(STATES, 0.0), dict.fromkeys(STATES, 1.0))
NARROW = NormalChannel(dict.fromkeys(STATES, 0.0), dict.fromkeys(STATES, 1.0) | {"mistake": 0.1})
ONE_PRESS = by_hand(["light_on(1)", "noa", "noa", "pick_up(1)"], [3])
OFF_CUE = by_hand(["light_on(2)", "noa", "noa", "noa"], [3])
BUSY = by_hand(["light_on(1)", "pick_up(1)", "noa", "light_on(2)", "slide(1, 4, 2)", "noa"], [2, 4])


def showing(channel: NormalChannel, miss: float = 0.0) -> TeacherModel:
    return replace(TRUTH, observation=ObservationModel(miss, channels={"pupil": channel}))


def with_pupil(trial: Trial, values: dict[int, float]) -> Trial:
    steps = [
        replace(step, signals={"pupil": values[t]}) if t in values else step
        for t, step in enumerate(trial.steps)
    ]
    return replace(trial, steps=tuple(steps))


@pytest.mark.parametrize("miss", [0.0, 0.1])
@pytest.mark.parametrize("task_known", [True, False])
def test_a_number_that_says_nothing_of_the_state_adds_its_log_density(miss: float, task_known: bool) -> None:
    trial = BUSY if task_known else replace(BUSY, task=None)
    shown = with_pupil(trial, {0: 60.0, 2: -45.0, 3: 0.5, 5: 1000.0})
    plain = log_likelihood([trial], WORLD, replace(TRUTH, observation=ObservationModel(miss)))
    added = sum(float(norm.logpdf(value)) for value in (60.0, -45.0, 0.5, 1000.0))
    assert log_likelihood([shown], WORLD, showing(ALIKE, miss)) == pytest.approx(plain + added, rel=1e-12)
    assert smooth(shown, showing(ALIKE, miss)).log_likelihood == pytest.approx(plain + added, rel=1e-12)


@pytest.mark.parametrize("value", [0.3, 3.0, 12.0, 40.0, 300.0])
@pytest.mark.parametrize("trial", [ONE_PRESS, OFF_CUE])
def test_the_last_press_is_weighed_state_by_state_however_far_out_its_number(
    trial: Trial, value: float
) -> None:
    reasons = responsibilities(trial, WORLD, TRUTH)[0]
    with np.errstate(divide="ignore"):
        joint = log_likelihood([trial], WORLD, TRUTH) + np.log(reasons)
    sds = np.array([NARROW.sd[state] for state in STATES])
    joint = joint + norm.logpdf(value, 0.0, sds)
    shown, model = with_pupil(trial, {3: value}), showing(NARROW)
    assert log_likelihood([shown], WORLD, model) == pytest.approx(float(logsumexp(joint)), rel=1e-12)
    found = responsibilities(shown, WORLD, model)[0]
    np.testing.assert_allclose(found, np.exp(joint - logsumexp(joint)), atol=1e-12)


def test_what_one_set_of_parameters_makes_of_a_number_is_not_kept_for_the_next() -> None:
    """A long fall makes the press one of approval; a short one leaves the mistake, far less probable."""
    trial = by_hand(["light_on(1)", "noa", "light_off(1)", *["noa"] * 5], [7])
    shown, model = with_pupil(trial, {7: 9.0}), showing(NARROW)
    long, short = (
        replace(model, approvals={name: replace(top, fall=fall) for name, top in TRUTH.approvals.items()})
        for fall in (8.0, 0.5)
    )
    alone = [log_likelihood([shown], WORLD, one) for one in (long, short)]
    assert np.isfinite(alone).all()
    assert alone[0] > alone[1] + 1000
    wide = prepare([shown], WORLD, long, Settings(bounds=Bounds(rise=8.0, fall=8.0))).evidence
    for one, value in [(long, alone[0]), (short, alone[1])] * 2:
        assert wide.value(one.parameters(WORLD.cue_names)) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize("value", [9.0, 60.0])
def test_rates_and_curvature_are_those_of_the_likelihood_there_too(value: float) -> None:
    evidence = Evidence(expose([with_pupil(OFF_CUE, {0: 60.0, 3: value})], WORLD, showing(NARROW)))
    parameters = TRUTH.parameters(WORLD.cue_names)
    found, rates = curvature(evidence, parameters), evidence.value_and_rates(parameters)[1]
    # the mistake alone explains the press, and waiting the three other steps
    mu = TRUTH.mistake
    assert rates[0] == pytest.approx(1 / mu - 3 / (1 - mu), rel=1e-10)
    assert found.score[0, 0] == pytest.approx(rates[0], rel=1e-10)
    assert found.hessian[0, 0] == pytest.approx(-1 / mu**2 - 3 / (1 - mu) ** 2, rel=1e-10)


def test_a_fit_takes_a_number_in_from_where_no_state_expects_it() -> None:
    rng = np.random.default_rng(0)
    trials = [
        with_pupil(trial, {t: float(rng.normal()) for t in range(trial.num_steps)})
        for trial in operator_trials(3, TRUTH)
    ]
    first = dict(enumerate(trials[0].signals("pupil")))
    odd = with_pupil(trials[0], {t: float(x or 0.0) for t, x in first.items()} | {5: 400.0})
    result = fit(
        [odd, *trials[1:]], WORLD, showing(ALIKE), observe=["pupil"], starts=1, search=False,
        bounds=Bounds(rise=3.0, fall=3.0),
    )  # fmt: skip
    assert result.monotone
    assert np.isfinite(result.log_likelihood)
    seen = result.model.observation.channels["pupil"]
    assert isinstance(seen, NormalChannel)
    assert seen.sd["waiting"] > 5


def test_the_belief_goes_on_too() -> None:
    shown, model = with_pupil(OFF_CUE, {3: 12.0}), showing(NARROW)
    belief = Belief.initial(WORLD, model, np.eye(len(WORLD.tasks))[0])
    for state, step in zip(shown.states, shown.steps, strict=True):
        belief = belief.update(state, step.pressed, step.signals)
    assert belief.marginal()[0] == 1


def test_a_replay_gives_the_reasons_of_a_press_however_far_out_its_number() -> None:
    unlit = by_hand(["noa"] * 4, [3])
    for value in (12.0, 60.0):
        (press,) = press_reasons(with_pupil(unlit, {3: value}), showing(NARROW))
        assert press.at_once["mistake"] == press.at_end["mistake"] == 1
    (press,) = press_reasons(with_pupil(ONE_PRESS, {3: 0.1}), showing(NARROW))
    assert press.at_once == pytest.approx(press.at_end, abs=1e-12)  # nothing comes after it
