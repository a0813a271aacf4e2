"""The observation model is learned in the same EM: channels by role, numbers, a key that errs."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from taught import WORLD, operator_trials
from watched import FACE, GAZE, LOOK, PUPIL, ROLES, SHORT, STATES, TRUTH, seeing, watched

from learn import FitError, fit, log_likelihood
from learn.em import prepare
from learn.emissions import categorical, normal, opened
from learn.mstep import Objective
from learn.settings import Settings
from taskcomm.channels import NormalChannel, PlainChannel, TargetChannel
from taskcomm.operators import ScriptedOperator
from taskcomm.simulate import SimulatedTeacher, run_trial
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial
from taskcomm.world import BallWorld


def test_channels_that_the_model_lacks_are_learned_beside_the_table_tops() -> None:
    result = fit(watched(40), WORLD, starts=1, search=False, observe=["gaze", "face", "pupil"], bounds=SHORT)
    assert result.monotone
    seen = result.model.observation.channels
    gaze, face, pupil = seen["gaze"], seen["face"], seen["pupil"]
    assert isinstance(gaze, TargetChannel)
    assert isinstance(face, PlainChannel)
    assert isinstance(pupil, NormalChannel)
    for state in ("waiting", "that_mov", "that_wrt", "that_dist"):
        np.testing.assert_allclose([gaze.table[state][role] for role in ROLES], LOOK[state], atol=0.15)
        assert face.table[state]["smile"] == pytest.approx(FACE.table[state]["smile"], abs=0.15)
        assert pupil.mean[state] == pytest.approx(PUPIL.mean[state], abs=0.15)
        assert pupil.sd[state] == pytest.approx(0.5, abs=0.1)
    assert result.num_free == 10 + 5 * 3 + 5 + 10


def test_signals_say_which_press_had_which_reason() -> None:
    trials = watched(30)
    keys = fit(trials, WORLD, starts=1, search=False, bounds=SHORT)
    looks = fit(trials, WORLD, starts=1, search=False, observe=["gaze", "pupil"], bounds=SHORT)
    known = [[list(STATES).index(state) for state in trial.reasons.values()] for trial in trials]

    def right(result: Any) -> float:
        each = [r[np.arange(len(k)), k] for r, k in zip(result.responsibilities, known, strict=True)]
        return float(np.concatenate(each).mean())

    assert right(looks) > right(keys) + 0.05


def test_a_key_that_misses_is_found_out_where_signals_show_the_mental_state() -> None:
    trials = [replace(trial, steps=trial.steps[:60]) for trial in watched(40, miss=0.3)]
    result = fit(
        trials, WORLD, starts=1, search=False, observe=["miss", "pupil"], bounds=SHORT, dropped_mass=1e-6
    )
    assert result.monotone
    assert result.model.observation.miss == pytest.approx(0.3, abs=0.1)


def _unknown() -> list[Trial]:
    return [replace(trial, steps=trial.steps[:30], task=None) for trial in watched(4)]


def _objective(observe: tuple[str, ...]) -> Objective:
    trials = _unknown()
    settings = Settings(observe=observe, bounds=SHORT)
    return prepare(trials, WORLD, TeacherModel.intuitive(), settings)


def test_where_the_observation_model_stands_is_what_the_likelihood_uses() -> None:
    objective = _objective(("gaze", "pupil", "miss"))
    observing = objective.observing
    assert observing is not None
    point = objective.space.point(objective.space.base)
    observing.learn(objective.expect(point))
    model = replace(TeacherModel.intuitive(), observation=observing.observation)
    trials = _unknown()
    value = objective.value(point) - objective.log_prior(objective.space.base)
    assert value == pytest.approx(log_likelihood(trials, WORLD, model), rel=1e-10)


def test_no_step_of_em_lowers_the_objective() -> None:
    objective = _objective(("gaze", "face", "pupil", "miss", "false_press"))
    observing = objective.observing
    assert observing is not None
    point = objective.space.point(objective.space.base)
    values = []
    for _ in range(8):
        expectation = objective.expect(point)
        values.append(expectation.value + objective.log_prior(objective.space.vector(point)))
        observing.learn(expectation)
    assert (np.diff(values) > -1e-9).all()
    assert values[-1] > values[0] + 1


def test_no_step_lowers_the_objective_where_nothing_in_the_world_has_some_role() -> None:
    world = BallWorld(num_balls=2, num_distances=2)
    model = seeing(channels={"gaze": GAZE})
    trials = []
    for number, rng in enumerate(np.random.default_rng(0).spawn(6)):
        simulated = SimulatedTeacher(world, model, world.tasks[number % 4])
        trials.append(run_trial(ScriptedOperator(world), simulated, rng, trial_id=f"t{number}"))
    objective = prepare(trials, world, model, Settings(observe=("gaze",), bounds=SHORT))
    assert objective.observing is not None
    point, values = objective.space.point(objective.space.base), []
    for _ in range(20):
        expectation = objective.expect(point)
        values.append(expectation.value + objective.log_prior(objective.space.vector(point)))
        objective.observing.learn(expectation)
    assert (np.diff(values) > -1e-10 * abs(values[-1])).all()
    learned = objective.observing.observation.channels["gaze"]
    assert isinstance(learned, TargetChannel)
    assert learned.table["that_mov"]["other"] == pytest.approx(LOOK["that_mov"][2], rel=0.02)  # opened


def test_responsibilities_of_all_steps_sum_to_their_number() -> None:
    objective = _objective(("gaze", "miss"))
    assert objective.observing is not None
    expectation = objective.expect(objective.space.point(objective.space.base))
    assert objective.observing.responsibilities(expectation).sum() == pytest.approx(
        sum(t.num_steps for t in _unknown())
    )


def test_categories_and_moments_are_weighted() -> None:
    table = categorical(["a", "b"], np.array([0, 1, 1]), np.array([3.0, 1.0, 1.0]))
    assert table == pytest.approx({"a": 3.5 / 6, "b": 2.5 / 6})
    found = normal(np.array([1.0, 3.0, 9.0]), np.array([50.0, 50.0, 0.0]), 1.0)
    assert found == pytest.approx((2.0, 1.0))
    assert normal(np.array([1.0]), np.array([0.0]), 1.0) is None


def test_a_signal_that_nobody_recorded_is_one_error() -> None:
    with pytest.raises(FitError, match="observe: no trial has a signal 'smell'"):
        fit(operator_trials(2, TRUTH), WORLD, observe=["smell"])
    with pytest.raises(FitError, match="observe: must be a list of names"):
        fit(operator_trials(2, TRUTH), WORLD, observe="gaze")


def test_numbers_about_what_is_not_measured_say_nothing() -> None:
    measured = {state: dict.fromkeys(ROLES[:3], 1.0) for state in STATES}
    angle = NormalChannel(measured, measured, target="gaze")
    model = seeing(channels={"gaze": GAZE, "angle": angle})

    def with_angles(trial: Trial, always: bool) -> Trial:
        steps = []
        for t, step in enumerate(trial.steps[:30]):
            gaze = (step.signals or {})["gaze"]
            about = {"angle": 0.1 * t} if always or gaze != "none" else {}
            steps.append(replace(step, signals={"gaze": gaze, **about}))
        return replace(trial, steps=tuple(steps))

    settings = Settings(observe=("gaze", "angle"), bounds=SHORT)
    ends = []
    for always in (True, False):
        trials = [with_angles(trial, always) for trial in watched(4)]
        objective = prepare(trials, WORLD, model, settings)
        assert objective.observing is not None
        expectation = objective.expect(objective.space.point(objective.space.base))
        assert expectation.value == pytest.approx(log_likelihood(trials, WORLD, _opened(model)), rel=1e-10)
        objective.observing.learn(expectation)
        ends.append(objective.observing.observation.to_dict())
    assert ends[0] == ends[1]


def _opened(model: TeacherModel) -> TeacherModel:
    seen = model.observation
    return replace(
        model, observation=replace(seen, channels={n: opened(c) for n, c in seen.channels.items()})
    )


def test_the_variance_of_one_number_far_from_zero_is_none() -> None:
    for value in np.random.default_rng(0).normal(0, 1e6, 50):
        found = normal(np.array([value, value]), np.array([0.3, 1e-3]), 2.0)
        assert found == pytest.approx((value, 2.0 / np.sqrt(1.301)), rel=1e-12)


def test_signals_of_two_kinds_are_one_error() -> None:
    trial = watched(4)[0]
    mixed = (replace(trial.steps[0], signals={"gaze": 1.5}), *trial.steps[1:])
    with pytest.raises(
        FitError, match="observe: signals of 'gaze' are words in some steps, numbers in others"
    ):
        fit([replace(trial, steps=mixed)], WORLD, observe=["gaze"])
