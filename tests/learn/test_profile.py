"""Profile likelihood against brute force, where there are kinks, bounds and ridges."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from taught import WORLD, operator_trials, teacher

from learn import FitResult, fit
from learn.certainty import _Intervals
from learn.coordinates import vector_of
from learn.em import prepare
from learn.information import information
from learn.mstep import Objective
from learn.profile import CLOSE, Profile
from learn.resampling import groups_of
from learn.slices import Slice
from taskcomm.lattice import Floats
from taskcomm.teacher import TeacherModel

DROP = 1.92


@cache
def fitted(count: int = 16) -> FitResult:
    return fit(operator_trials(count, teacher()), WORLD, starts=2)


@cache
def objective(count: int = 16) -> Objective:
    result = fitted(count)
    return prepare(operator_trials(count, teacher()), WORLD, result.model, result.settings)


def centre(count: int = 16) -> Floats:
    return objective(count).space.point(vector_of(fitted(count).model))


def profile_of(held: int, over: int | None = None) -> Profile:
    here, climbed = centre(), objective()
    return Profile(Slice(climbed, held, over), here, climbed.value(here), information(climbed, here).bend)


KINDS = [(0, None), (2, None), (4, None), (8, None), (1, 4), (3, 6)]


@pytest.mark.parametrize(("held", "over"), KINDS)
def test_what_is_held_stays_whatever_the_rest_does(held: int, over: int | None) -> None:
    along, space = Slice(objective(), held, over), objective().space
    rng, here = np.random.default_rng(0), centre()
    expected = along.natural(here)
    for _ in range(20):
        rest = np.clip(here[along.keep] + rng.normal(0, 0.3, len(here) - 1), along.least, along.most)
        point = along.point(along.value(here), rest)
        assert along.natural(point) == pytest.approx(expected, rel=1e-12)
        assert along.value(point) == pytest.approx(along.value(here), rel=1e-10, abs=1e-12)
        np.testing.assert_array_equal(point[along.keep], rest)
        assert space.vector(point)[:4].sum() < 1


@pytest.mark.parametrize(("held", "over"), KINDS)
def test_rates_along_a_slice_are_the_differences_of_its_values(held: int, over: int | None) -> None:
    along, rng = Slice(objective(), held, over), np.random.default_rng(1)
    rest = centre()[along.keep] + rng.uniform(0.013, 0.037, len(centre()) - 1)  # off the kinks
    value = along.value(centre()) + 0.0171
    function = along.at(value)
    _, rates = function(rest)
    for i in range(len(rest)):
        aside = 1e-6 * np.eye(len(rest))[i]
        expected = (function(rest + aside)[0] - function(rest - aside)[0]) / 2e-6
        assert rates[i] == pytest.approx(expected, rel=1e-5, abs=1e-4)


def test_a_ratio_beyond_what_peaks_allow_is_no_place_to_go() -> None:
    along = Slice(objective(), 1, 4)
    value, rates = along.at(math.log(5.0))(centre()[along.keep])
    assert value == -math.inf
    assert not rates.any()


@pytest.mark.parametrize("held", range(10))
def test_at_a_closed_end_no_rest_of_many_is_better_than_the_drop_allows(held: int) -> None:
    profile = profile_of(held)
    along, space, rng = profile.slice, objective().space, np.random.default_rng(held)
    for direction in (-1, 1):
        end = profile.end(direction, DROP)
        assert (end.value - along.value(centre())) * direction >= 0
        if end.open:
            kind, bound = space.kinds[held], (space.least, space.most)[direction > 0][held]
            assert kind == "odds" or end.value == bound
            continue
        function, rest = along.at(end.value), end.point[along.keep]
        assert profile.top - function(rest)[0] == pytest.approx(DROP, abs=2 * CLOSE)
        spread = rng.choice([0.03, 0.3, 1.0], size=(400, 1)) * rng.normal(size=(400, len(rest)))
        others = np.clip(rest + spread, along.least, along.most)
        best = max(function(other)[0] for other in others)
        assert profile.top - best > DROP - 0.1


def test_a_rise_as_short_as_it_can_be_is_open_below() -> None:
    space = objective().space
    shortest = [c for c in range(4, 10) if centre()[c] == space.least[c]]
    assert shortest, "some rise or fall of this study lies at one step"
    for held in shortest:
        assert profile_of(held).end(-1, DROP).open


def test_a_peak_of_nothing_is_closed_there() -> None:
    trials = operator_trials(4, teacher((0.3, 0.3, 1e-9)), seed=3)
    result = fit(trials, WORLD, starts=1)
    climbed = prepare(trials, WORLD, result.model, result.settings)
    here = climbed.space.point(vector_of(result.model))
    profile = Profile(Slice(climbed, 3), here, climbed.value(here), information(climbed, here).bend)
    low, high = profile.end(-1, DROP), profile.end(1, DROP)
    assert not low.open
    assert profile.slice.natural(low.point) < 1e-6
    assert 0.001 < profile.slice.natural(high.point) < 0.2


def test_where_nothing_curbs_it_the_interval_runs_to_the_bound() -> None:
    """A ridge: the level never reaches 1, so peak, rise and fall can all grow."""
    model = teacher((0.3, 0.3, 0.3), (9.0, 9.0, 9.0), (9.5, 9.5, 9.5))
    trials = operator_trials(6, model, seed=5)
    result = fit(trials, WORLD, starts=1)
    ridge = [name for name, mark in result.marks.items() if mark == "ridge" and name.endswith(".peak")]
    assert ridge
    climbed = prepare(trials, WORLD, result.model, result.settings)
    here = climbed.space.point(vector_of(result.model))
    names = result.parameters
    held = climbed.space.index.tolist().index(names.index(ridge[0]))
    rise = climbed.space.index.tolist().index(names.index(ridge[0].replace("peak", "rise")))
    bend, top = information(climbed, here).bend, climbed.value(here)
    assert Profile(Slice(climbed, held), here, top, bend).end(1, DROP).open
    ratio = Profile(Slice(climbed, held, rise), here, top, bend)
    ends = [math.exp(ratio.end(direction, DROP).value) for direction in (-1, 1)]
    assert ends[0] < 0.3 / 9 < ends[1] < 4 * ends[0]


def test_a_model_of_one_state_agrees_with_a_grid_over_all_its_parameters() -> None:
    trials = operator_trials(8, teacher(), seed=2)
    start = TeacherModel.intuitive()
    start = TeacherModel(0.005, {"that_mov": start.approvals["that_mov"]})
    result = fit(trials, WORLD, start, starts=2)
    climbed = prepare(trials, WORLD, result.model, result.settings)
    here, space = climbed.space.point(vector_of(result.model)), climbed.space
    bend, top = information(climbed, here).bend, climbed.value(here)
    profile = Profile(Slice(climbed, 1), here, top, bend)
    ends = [profile.end(direction, DROP) for direction in (-1, 1)]
    assert not any(end.open for end in ends)

    def best(value: float) -> float:
        times = np.linspace(space.least[2], space.most[2], 19)
        odds = np.linspace(here[0] - 1, here[0] + 1, 7)
        function = profile.slice.at(value)
        return max(function(np.array([o, a, b]))[0] for o in odds for a in times for b in times)

    for end in ends:
        assert top - best(end.value) > DROP - 0.02
        inside = profile.slice.value(here) + 0.8 * (end.value - profile.slice.value(here))
        assert top - best(inside) < DROP


def test_an_end_is_where_values_are_possible_whatever_lies_beyond() -> None:
    profile = profile_of(1, 4)
    profile._step = 8.0
    assert math.log(1) < profile._start + profile._step + profile.centre[4]  # a peak above 1
    end = profile.end(1, DROP)
    assert profile._start < end.value
    assert objective().value(end.point) > profile.top - DROP - CLOSE


def test_where_nothing_was_visited_nothing_is_within() -> None:
    assert profile_of(0).within(DROP).shape == (0, 19)


def test_where_the_log_likelihood_bends_the_wrong_way_there_are_no_standard_errors() -> None:
    found, groups = information(objective(), centre()), groups_of(operator_trials(16, teacher()))
    hollow = _Intervals(fitted(), objective(), centre(), replace(found, bend=-found.bend), groups)
    assert hollow.wald(0.95) == {}
    assert all(each.standard_error is None for each in hollow.assembled({}, "wald", 0.95).intervals)
