"""Coordinates that cannot leave the model, and climbs over functions with kinks."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from taught import teacher

from learn.ascent import ascend, climb_from
from learn.coordinates import Bounds, Coordinates, model_at, names_of, parameters_at, vector_of
from taskcomm.teacher import TeacherModel
from taskcomm.world import BallWorld

Floats = NDArray[np.float64]
LATE = teacher(delays=(0.3, 0.0, 1.25))
TOPS = {state: replace(top, decay=3.0, hold=0.4) for state, top in LATE.approvals.items()}
MODEL = replace(LATE, approvals=TOPS)


def _space(free: list[bool] | None = None) -> Coordinates:
    return Coordinates(MODEL, Bounds(), np.array([True] * 19 if free is None else free))


@given(st.lists(st.floats(-30, 30), min_size=19, max_size=19))
def test_every_point_within_the_bounds_is_a_model(values: list[float]) -> None:
    space = _space()
    point = np.clip(np.array(values), space.least, space.most)
    model = model_at(space.vector(point), MODEL)
    assert model.mistake > 0
    assert all(0.5 <= top.rise <= 10.0001 and 0 <= top.delay <= 2 for top in model.approvals.values())


@given(st.lists(st.floats(-6, 6), min_size=19, max_size=19))
def test_vector_and_point_are_inverses(values: list[float]) -> None:
    space = _space()
    point = np.clip(np.array(values), space.least, space.most)
    np.testing.assert_allclose(space.point(space.vector(point)), point, rtol=0, atol=1e-9)


@given(st.lists(st.booleans(), min_size=19, max_size=19), st.integers(0, 100))
def test_rates_in_coordinates_are_those_of_any_function_of_the_parameters(
    free: list[bool], seed: int
) -> None:
    space, rng = _space(free), np.random.default_rng(seed)
    tilt = rng.normal(size=19)
    vector = vector_of(MODEL)
    point = space.point(vector)
    rates = space.rates(vector, tilt)
    for i in range(len(point)):
        step = 1e-6 * np.eye(len(point))[i]
        slope = tilt @ (space.vector(point + step) - space.vector(point - step)) / 2e-6
        assert rates[i] == pytest.approx(slope, rel=1e-5, abs=1e-8)


def test_what_is_not_free_does_not_move() -> None:
    space = _space([True, False, True, True] + [False] * 15)
    vector = space.vector(space.point(vector_of(MODEL)) + 0.7)
    np.testing.assert_array_equal(vector[~space.free], vector_of(MODEL)[~space.free])
    assert (vector[[0, 2, 3]] > vector_of(MODEL)[[0, 2, 3]]).all()
    assert vector[:4].sum() < 1


def test_vectors_and_models_are_the_same_thing() -> None:
    assert model_at(vector_of(MODEL), MODEL) == MODEL
    names = names_of(list(MODEL.approvals))
    assert vector_of(MODEL)[names.index("that_dist.delay")] == 1.25
    from_model = MODEL.parameters(BallWorld.cue_names)
    from_vector = parameters_at(vector_of(MODEL), TeacherModel.intuitive().parameters(BallWorld.cue_names))
    for name in ("peak", "rise", "fall", "steps_late", "part_late"):
        np.testing.assert_array_equal(getattr(from_vector, name), getattr(from_model, name))


def _ravine(point: Floats) -> tuple[float, Floats]:
    """Greatest, 0, where a curved kink meets a smooth hill: at (1, 1)."""
    x, y = point
    side = math.copysign(1.0, y - x * x)
    return -5 * abs(y - x * x) - (x - 1) ** 2, np.array([10 * side * x - 2 * (x - 1), -5 * side])


def test_a_climb_follows_a_curved_kink_to_its_top() -> None:
    climb = climb_from(_ravine, np.array([-1.2, 2.0]))
    climb = ascend(_ravine, climb, np.full(2, -3.0), np.full(2, 3.0), steps=500)
    assert climb.value > -1e-6
    np.testing.assert_allclose(climb.point, 1.0, atol=2e-3)


def _tilted(point: Floats) -> tuple[float, Floats]:
    """A hill whose top (2, 3) lies outside the bounds, its axes coupled."""
    curve = np.array([[2.0, 0.9], [0.9, 1.0]])
    gap = point - np.array([2.0, 3.0])
    return float(-gap @ curve @ gap / 2), -curve @ gap


def test_at_a_bound_the_free_coordinates_still_reach_their_best() -> None:
    climb = ascend(
        _tilted, climb_from(_tilted, np.zeros(2)), np.full(2, -9.0), np.array([9.0, 1.0]), steps=50
    )
    np.testing.assert_allclose(climb.point, [2 + 0.9 * 2 / 2, 1.0], atol=1e-6)
    assert climb.stuck


def test_a_climb_never_falls_and_keeps_away_from_where_there_is_no_value() -> None:
    def cliff(point: Floats) -> tuple[float, Floats]:
        if point[0] >= 1:
            return -math.inf, np.zeros(1)
        return float(np.log(1 - point[0]) + 20 * point[0]), 20 - 1 / (1 - point)

    values = []
    climb = climb_from(cliff, np.zeros(1))
    for _ in range(20):
        values.append(climb.value)
        climb = ascend(cliff, climb, np.full(1, -9.0), np.full(1, 9.0), steps=1)
    assert min(np.diff(values)) >= 0
    assert climb.point[0] == pytest.approx(0.95, abs=1e-5)
