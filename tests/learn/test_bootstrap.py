"""Intervals by resampling people."""

from dataclasses import astuple

import numpy as np
import pytest

from learn.bootstrap import Resampling, ratio_interval, ratio_intervals


def test_estimate_is_the_ratio_of_sums_and_lies_within() -> None:
    rng = np.random.default_rng(0)
    top, bottom = rng.gamma(2.0, size=40), rng.gamma(2.0, size=40)
    found = ratio_interval(top, bottom)
    assert found.estimate == pytest.approx(top.sum() / bottom.sum())
    assert found.low < found.estimate < found.high
    assert found.groups == 40


def test_interval_of_a_mean_covers_the_truth_about_as_often_as_it_says() -> None:
    rng = np.random.default_rng(1)
    covered = 0
    for seed in range(300):
        found = ratio_interval(rng.normal(3.0, 1.0, size=40), np.ones(40), seed=seed, resamples=600)
        covered += found.low <= 3.0 <= found.high
    assert 0.90 <= covered / 300 <= 0.98


def test_trials_of_one_person_count_as_one_when_they_are_alike() -> None:
    rng = np.random.default_rng(2)
    of_people = rng.normal(size=30)
    once = ratio_interval(of_people, np.ones(30))
    people = [f"p{n}" for n in range(30)] * 5
    five_times = ratio_interval(np.tile(of_people, 5), np.ones(150), people)
    as_if_independent = ratio_interval(np.tile(of_people, 5), np.ones(150))
    assert five_times.groups == 30
    assert five_times.high - five_times.low == pytest.approx(once.high - once.low, rel=1e-12)
    assert as_if_independent.high - as_if_independent.low < 0.6 * (once.high - once.low)


def test_what_has_no_value_is_not_a_number_and_json_says_none() -> None:
    nothing = ratio_interval([], [])
    assert np.isnan(nothing.estimate)
    assert nothing.to_json() == {"estimate": None, "low": None, "high": None, "groups": 0}
    assert np.isnan(ratio_interval([1.0], [0.0]).estimate)


def test_values_of_different_length_are_refused() -> None:
    with pytest.raises(ValueError, match="must be equally long"):
        ratio_interval([1.0, 2.0], [1.0])
    with pytest.raises(ValueError, match="groups: 1 names for 2 values"):
        ratio_interval([1.0, 2.0], [1.0, 1.0], ["a"])


def test_intervals_of_columns_are_those_of_each_column_alone() -> None:
    rng = np.random.default_rng(3)
    tops, bottoms = rng.gamma(2.0, size=(24, 3)), rng.gamma(2.0, size=(24, 3))
    bottoms[:, 2] = 0.0
    people = [n // 3 for n in range(24)]
    found = ratio_intervals(tops, bottoms, Resampling.of(people))
    for column in (0, 1):
        alone = ratio_interval(tops[:, column], bottoms[:, column], people)
        assert astuple(found[column]) == pytest.approx(astuple(alone), rel=1e-12)
    assert np.isnan(found[2].estimate)
    assert found[2].groups == 8
