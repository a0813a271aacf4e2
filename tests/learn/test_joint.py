"""Table-tops and observation model end at one optimum, and the certificate looks at both."""

from dataclasses import replace

import numpy as np
import pytest
from signalled import gazing
from taught import WORLD
from watched import SHORT, watched

from learn import fit
from learn.em import prepare
from learn.joint import Joint, labels_of_emissions, slopes_of
from learn.mstep import Objective
from learn.optimum import TOLERANCE
from learn.settings import Settings
from taskcomm.channels import NormalChannel, ObservationModel
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial

ALL = ("miss", "false_press", "gaze", "face", "pupil", "angle")


def _angled(trial: Trial) -> Trial:
    """With an angle where there is something that is looked at."""
    steps = []
    for t, step in enumerate(trial.steps[:25]):
        signals = dict(step.signals or {})
        angle = {} if signals.get("gaze") in (None, "none") else {"angle": 0.3 * (t % 5) - 0.5}
        steps.append(replace(step, signals=signals | angle))
    return replace(trial, steps=tuple(steps))


def _objective() -> Objective:
    start = gazing().observation.channels["gaze"]
    base = TeacherModel.intuitive()
    by = {state: dict.fromkeys(("mov", "wrt", "other"), 0.1) for state in base.mental_states}
    angle = NormalChannel(by, {state: dict.fromkeys(row, 0.8) for state, row in by.items()}, target="gaze")
    model = replace(base, observation=ObservationModel(channels={"gaze": start, "angle": angle}))
    settings = Settings(observe=ALL, bounds=SHORT)
    return prepare([_angled(trial) for trial in watched(2)], WORLD, model, settings)


def test_rates_in_the_observation_model_are_those_of_the_objective() -> None:
    objective = _objective()
    joint = Joint(objective)
    point = objective.space.point(objective.space.base)
    rng = np.random.default_rng(0)
    shown = joint.emissions.point() + rng.normal(0, 0.2, len(joint.emissions.labels))
    both = np.append(point, shown)
    rates = joint.value_and_rates(both)[1][len(point) :]
    assert len(rates) == len(joint.emissions.labels) == 2 + 5 * (4 + 2 + 2 + 6)
    for row, rate in zip(np.eye(len(both))[len(point) :], rates, strict=True):
        ahead, behind = (joint.value_and_rates(both + way * 1e-5 * row)[0] for way in (1, -1))
        assert rate == pytest.approx((ahead - behind) / 2e-5, rel=1e-5, abs=1e-5)


def test_a_point_of_the_observation_model_is_that_model() -> None:
    objective = _objective()
    joint = Joint(objective)
    assert objective.observing is not None
    objective.observing.learn(objective.expect(objective.space.point(objective.space.base)))
    here = joint.emissions.point()
    again = joint.emissions.model(here)
    objective.observing.set(again)
    np.testing.assert_allclose(joint.emissions.point(), here, atol=1e-12)


def test_a_fit_of_a_key_that_misses_leaves_no_slope_in_either_part() -> None:
    """EM and climbs in turns leave 0.05 nats of slope on these trials."""
    trials = [replace(trial, steps=trial.steps[:40]) for trial in watched(12, miss=0.2)]
    result = fit(trials, WORLD, observe=["miss"], starts=2, bounds=SHORT, dropped_mass=1e-6)
    assert result.certificate.trusted, result.status
    settings = replace(result.settings, dropped_mass=1e-6)
    objective = prepare(trials, WORLD, result.model, settings)
    joint = Joint(objective)
    point = objective.space.point(objective.space.base)
    odds = joint.emissions.point()
    for way in (1e-3, -1e-3):  # the objective itself, beside the end, in the odds of a miss
        assert joint.value_and_rates(np.append(point, odds + way))[0] < joint.objective.value(point) + 1e-5


def test_the_certificate_names_a_slope_that_is_left_in_the_observation_model() -> None:
    objective = _objective()
    point = objective.space.point(objective.space.base)
    slopes, labels = slopes_of(objective, point), labels_of_emissions(objective)
    assert slopes.steepest > TOLERANCE
    assert slopes.directions.shape[1] == len(point) + len(labels)
    assert {"log odds of miss", "log odds of face.waiting.smile", "log sd of angle.mistake.mov"} <= {*labels}
