"""The observed information against what computes it otherwise."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from strategies import models, walks
from taught import WORLD, operator_trials, teacher

from learn import MistakePrior
from learn.coordinates import Bounds, Coordinates, parameters_at, vector_of
from learn.estep import Evidence
from learn.exposure import expose
from learn.information import curvature, information
from learn.mstep import Objective
from taskcomm.lattice import Floats
from taskcomm.observation import ObservationModel
from taskcomm.teacher import TableTop, TeacherModel
from taskcomm.trials import Step, Trial
from taskcomm.world import BallWorld

SMALL = BallWorld(num_balls=2, num_distances=2)
OFF_LATTICE = teacher((0.2, 0.15, 0.1), (1.13, 1.71, 0.93), (1.37, 1.19, 1.83), (0.21, 0.43, 0.87), 0.02)
LEARNED = slice(0, 13)  # without decays and holds


def fading(model: TeacherModel) -> TeacherModel:
    tops = {state: replace(top, decay=2.3, hold=0.7) for state, top in model.approvals.items()}
    return replace(model, approvals=tops)


def evidence_of(trials: tuple[Trial, ...], model: TeacherModel) -> Evidence:
    vector = vector_of(model)
    space = Coordinates(model, Bounds(), np.isfinite(vector))
    world = trials[0].world
    return Evidence(expose(trials, world, model, space.extent(model.parameters(world.cue_names))))


def mixed(count: int = 6) -> tuple[Trial, ...]:
    """Tasks known and unknown, key states known and unknown."""
    trials = operator_trials(count, teacher())
    steps = list(trials[1].steps)
    for t in (5, 20):
        steps[t] = replace(steps[t], pressed=None)
    return (replace(trials[0], task=None), replace(trials[1], steps=tuple(steps)), *trials[2:])


def differences(evidence: Evidence, vector: Floats, base: Any, i: int, step: float) -> Floats:
    """The rates of the rates in parameter i, by central differences."""
    aside = np.zeros(len(vector))
    aside[i] = step
    ends = [evidence.value_and_rates(parameters_at(vector + sign * aside, base))[1] for sign in (1, -1)]
    return np.asarray((ends[0] - ends[1]) / (2 * step))


@pytest.mark.parametrize(
    "model",
    [
        OFF_LATTICE,
        fading(OFF_LATTICE),
        replace(fading(OFF_LATTICE), rest=1.0),
        replace(OFF_LATTICE, observation=ObservationModel(miss=0.1, false_press=0.01)),
    ],
    ids=["delays", "decay", "decay and rest", "a key that errs"],
)
def test_second_derivatives_are_the_differences_of_the_rates(model: TeacherModel) -> None:
    trials = mixed() if model.observation == OFF_LATTICE.observation else mixed()[2:3]
    evidence, vector = evidence_of(trials, model), vector_of(model)
    base = model.parameters(WORLD.cue_names)
    found = curvature(evidence, base)
    value, rates = evidence.value_and_rates(base)
    assert found.log_likelihood.sum() == pytest.approx(value, rel=1e-13)
    learned = np.isfinite(vector)
    np.testing.assert_allclose(found.score.sum(axis=0)[learned], rates[learned], rtol=1e-9, atol=1e-9)
    for i in np.flatnonzero(learned):
        expected = differences(evidence, vector, base, int(i), 1e-6 * max(1e-2, float(vector[i])))
        np.testing.assert_allclose(
            found.hessian[i, learned], expected[learned], rtol=1e-6, atol=1e-6 * np.abs(expected).max()
        )


@st.composite
def short_trials(draw: st.DrawFn) -> Trial:
    walk = draw(walks(SMALL, 12))
    keys = draw(st.lists(st.sampled_from([False, False, True, None]), min_size=len(walk), max_size=len(walk)))
    steps = tuple(Step(action, key) for (action, _), key in zip(walk, keys, strict=True))
    return Trial("short", SMALL, draw(st.sampled_from([None, *SMALL.tasks])), steps)


@given(short_trials().map(lambda trial: [trial]), models(max_states=2))
def test_second_derivatives_of_any_model_are_the_differences_of_the_rates(
    trials: list[Trial], model: TeacherModel
) -> None:
    """Off the kinks: where the rates on both sides are those between."""
    evidence, vector = evidence_of(tuple(trials), model), vector_of(model)
    base = model.parameters(SMALL.cue_names)
    found, step = curvature(evidence, base), 1e-7
    _, rates = evidence.value_and_rates(base)
    smooth = 0
    for i in np.flatnonzero(np.isfinite(vector) & (vector > 1e-3)):
        at = [vector.copy(), vector.copy()]
        at[0][i], at[1][i] = vector[i] + step, vector[i] - step
        ahead, behind = (evidence.value_and_rates(parameters_at(each, base))[1] for each in at)
        forward, backward = (ahead - rates) / step, (rates - behind) / step
        size = 1 + np.abs(found.hessian[i]).max()
        if np.nanmax(np.abs(forward - backward)) > 1e-3 * size:
            continue  # a kink
        smooth += 1
        finite = np.isfinite(vector)
        middle = (forward + backward) / 2
        np.testing.assert_allclose(found.hessian[i, finite], middle[finite], rtol=0, atol=2e-4 * size)
    assume(smooth > 0)


def test_trials_count_by_their_weights_and_in_any_batches() -> None:
    trials = mixed()
    base = OFF_LATTICE.parameters(WORLD.cue_names)
    evidence = evidence_of(trials, OFF_LATTICE)
    weights = np.array([1.0, 0.0, 2.0, 0.5, 3.0, 1.0])
    weighted = curvature(evidence.with_weights(weights), base)
    each = [curvature(evidence_of((trial,), OFF_LATTICE), base) for trial in trials]
    expected = sum(w * one.hessian for w, one in zip(weights, each, strict=True))
    np.testing.assert_allclose(weighted.hessian, expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(weighted.score, [one.score[0] for one in each], rtol=1e-9, atol=1e-10)


def objective_of(trials: tuple[Trial, ...], model: TeacherModel, shared: tuple[str, ...] = ()) -> Objective:
    base = model.parameters(WORLD.cue_names)
    free = np.zeros(len(vector_of(model)), dtype=np.bool_)
    free[LEARNED] = True
    space = Coordinates(model, Bounds(), free, shared)
    evidence = Evidence(expose(trials, WORLD, model, space.extent(base)))
    return Objective(evidence, base, space, MistakePrior())


@pytest.mark.parametrize("shared", [(), ("delay",)])
def test_information_is_that_of_the_objective_in_its_coordinates_prior_included(
    shared: tuple[str, ...],
) -> None:
    model = OFF_LATTICE
    if shared:
        tops = {state: replace(top, delay=0.43) for state, top in model.approvals.items()}
        model = replace(model, approvals=tops)
    objective = objective_of(mixed(), model, shared)
    point = objective.space.point(vector_of(model))
    found = information(objective, point)
    for i in range(len(point)):
        aside = 1e-6 * np.eye(len(point))[i]
        ahead, behind = (objective.value_and_rates(at)[1] for at in (point + aside, point - aside))
        np.testing.assert_allclose(-found.bend[i], (ahead - behind) / 2e-6, rtol=1e-5, atol=1e-4)
    rates = objective.value_and_rates(point)[1]
    prior = without_prior(objective).value_and_rates(point)[1]
    np.testing.assert_allclose(found.score.sum(axis=0), prior, rtol=1e-9, atol=1e-8)
    assert np.abs(rates - prior).max() > 1e-3


def without_prior(objective: Objective) -> Objective:
    return Objective(objective.evidence, objective.base, objective.space, None)


def test_scores_of_teachers_who_are_all_alike_count_as_one() -> None:
    """Every teacher twice: the model-based error shrinks, the robust one does not."""
    trials = operator_trials(6, teacher())
    smooth = np.array([True] * 4 + [False] * 9)
    objective, twice = objective_of(trials, OFF_LATTICE), objective_of(trials * 2, OFF_LATTICE)
    point = objective.space.point(vector_of(OFF_LATTICE))
    names = [trial.trial_id for trial in trials]
    objective, twice = without_prior(objective), without_prior(twice)
    single, double = information(objective, point), information(twice, point)
    np.testing.assert_allclose(double.covariance(smooth), single.covariance(smooth) / 2, rtol=1e-9)
    np.testing.assert_allclose(
        double.robust_covariance(smooth, names * 2, None),
        single.robust_covariance(smooth, names, None),
        rtol=1e-9,
    )
    assert np.isnan(single.robust_covariance(smooth, ["one"] * 6, None)).all()


def test_where_the_likelihood_does_not_bend_downward_there_is_no_covariance() -> None:
    """A quiet trial says nothing of the peaks."""
    top = TableTop("mov_lit", 0.1, 1.3, 1.7)
    model = TeacherModel(0.01, {"that_mov": top})
    trial = replace(operator_trials(1, teacher())[0], task=None)
    base = model.parameters(WORLD.cue_names)
    free = np.array([True, True, True, True, False, False, False])
    space = Coordinates(model, Bounds(), free)
    quiet = replace(trial, steps=tuple(replace(step, pressed=False) for step in trial.steps[:3]))
    evidence = Evidence(expose((quiet,), WORLD, model, space.extent(base)))
    found = information(Objective(evidence, base, space, None), space.point(vector_of(model)))
    assert np.isnan(found.covariance(np.ones(4, dtype=np.bool_))).all()
