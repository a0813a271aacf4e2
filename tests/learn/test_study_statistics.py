"""Statistics of a study: means and tests by condition and within teachers, against other ways to them."""

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from ratedstudy import of_condition, rated, unrated
from scipy import stats

from learn.study_paired import exact_signed_rank, exception_sentence, paired, t_interval
from learn.study_statistics import (
    by_teacher,
    measures,
    operator_rows,
    paired_rows,
    statistics_text,
    summary_rows,
)
from learn.study_trials import by_condition, by_planner, rated_items, scale_of, time_to_final


def by_enumeration(differences: list[float]) -> tuple[float, float]:
    """The signed-rank test over every way of giving signs."""
    seen = [value for value in differences if value]
    ranks = stats.rankdata(np.abs(seen))
    sums = [
        sum(r for r, up in zip(ranks, signs, strict=True) if up)
        for signs in product((0, 1), repeat=len(seen))
    ]
    found = sum(rank for rank, value in zip(ranks, seen, strict=True) if value > 0)
    low, high = (
        np.mean([one <= found + 1e-9 for one in sums]),
        np.mean([one >= found - 1e-9 for one in sums]),
    )
    return float(found), min(1.0, 2 * float(min(low, high)))


@pytest.mark.parametrize("seed", range(8))
def test_the_signed_rank_test_with_ties_and_zeros_is_that_of_all_signs(seed: int) -> None:
    rng = np.random.default_rng(seed)
    differences = [float(value) for value in rng.integers(-2, 4, size=10)]
    assert exact_signed_rank(differences) == pytest.approx(by_enumeration(differences))


@pytest.mark.parametrize("seed", range(4))
def test_the_signed_rank_test_without_ties_is_scipys_exact_one(seed: int) -> None:
    differences = np.random.default_rng(seed).normal(0.4, 1.0, size=22)
    one = stats.wilcoxon(differences, method="exact")
    assert exact_signed_rank(differences)[1] == pytest.approx(one.pvalue)


def test_a_paired_comparison_is_students_and_the_binomial() -> None:
    rng = np.random.default_rng(5)
    first = {f"p{n}": float(v) for n, v in enumerate(rng.integers(4, 10, 22))}
    second = {f"p{n}": float(v) for n, v in enumerate(rng.integers(3, 10, 22))} | {"alone": 1.0}
    found, theirs = paired(first, second), stats.ttest_rel(list(first.values()), list(second.values())[:22])
    interval = theirs.confidence_interval(0.95)
    assert (found.t_low, found.t_high) == pytest.approx((interval.low, interval.high))
    assert found.people == 22 == found.higher + found.same + found.lower
    assert found.sign_p == pytest.approx(stats.binomtest(found.higher, found.higher + found.lower).pvalue)
    assert found.bootstrap_low < found.mean_difference < found.bootstrap_high
    assert found.bootstrap_high - found.bootstrap_low == pytest.approx(found.t_high - found.t_low, rel=0.25)


def test_to_swap_the_conditions_turns_the_differences_about() -> None:
    first, second = {"a": 9.0, "b": 8.0, "c": 7.0}, {"a": 7.0, "b": 8.5, "c": 4.0}
    one, other = paired(first, second), paired(second, first)
    assert one.mean_difference == -other.mean_difference
    assert (one.t_low, one.t_high) == pytest.approx((-other.t_high, -other.t_low))
    assert (one.higher, one.same, one.lower) == (other.lower, other.same, other.higher)
    assert one.signed_rank_p == other.signed_rank_p
    assert one.sign_p == other.sign_p


def test_one_person_has_a_difference_and_no_interval_and_nobody_is_an_error() -> None:
    row = paired({"a": 5.0}, {"a": 5.0}).row()
    assert row["mean_difference"] == 0
    assert {row[name] for name in ("sd", "t_low", "bootstrap_low", "signed_rank_p", "sign_p")} == {None}
    with pytest.raises(ValueError, match="nobody has both"):
        paired({"a": 1.0}, {"b": 1.0})


def test_the_papers_ratings_are_said_as_in_the_paper() -> None:
    """22 teachers, means of 9.3 and 8.3; all but one rated the operator the same or higher."""
    operator = (10,) * 10 + (9,) * 8 + (8,) * 4
    pomdp = (9,) * 10 + (8,) * 8 + (7,) * 3 + (9,)
    trials = rated(operator, pomdp)
    text = statistics_text(trials)
    mean, other = np.mean(operator), np.mean(pomdp)
    assert (
        "With the exception of 1 of 22 teachers, all have the same or a higher rating of intelligence with"
        f" operator than with pomdp (mean of {mean:.2f} vs. {other:.2f}, n = 22)." in text
    )
    row = next(row for row in paired_rows(trials) if row["measure"] == "rating intelligence")
    assert (row["higher"], row["same"], row["lower"]) == (21, 0, 1)
    assert (row["first"], row["second"]) == ("operator", "pomdp")
    assert "simulated trials" in text


def test_summaries_are_of_every_trial_and_shares_exact() -> None:
    trials = rated()
    rows = {(row["measure"], row["condition"]): row for row in summary_rows(trials)}
    for condition in ("operator", "pomdp"):
        of = of_condition(trials, condition)
        times = np.array([trial.num_steps * trial.dt for trial in of if trial.reason == "final"])
        row = rows["time to Final (s)", condition]
        assert (row["mean"], row["sd"], row["n"]) == pytest.approx(
            (times.mean(), times.std(ddof=1), len(times))
        )
        assert (row["low"], row["high"]) == pytest.approx(t_interval(times))
        right = rows["right", condition]
        exact = stats.binomtest(sum(bool(trial.correct) for trial in of), 22).proportion_ci()
        assert (right["low"], right["high"]) == pytest.approx((exact.low, exact.high))
        assert rows["said right", condition]["mean"] == right["mean"]


def test_trials_of_one_teacher_in_one_condition_count_as_their_mean() -> None:
    one, other = (replace(trial, participant_id="p") for trial in of_condition(rated(), "pomdp")[:2])
    time = next(measure for measure in measures([one]) if measure.of is time_to_final)
    mean = (one.duration + other.duration) / 2
    assert by_teacher([one, other], time) == {"p": pytest.approx(mean)}


def test_a_timeout_is_not_right_has_no_time_and_a_broken_trial_counts_for_its_rating_alone() -> None:
    trial = of_condition(rated(), "pomdp")[0]
    late = replace(trial, reason="timeout", displayed=None)
    broken = replace(trial, reason="aborted", displayed=None)
    values = {measure.name: (measure.of(late), measure.of(broken)) for measure in measures([trial])}
    assert values["right"] == (0.0, None)
    assert values["time to Final (s)"] == (None, None)
    assert values["presses"] == (float(trial.presses.sum()), None)
    assert values["rating intelligence"] == (8.0, 8.0)
    assert "1 trial did not run to an end" in statistics_text([trial, broken])


def test_conditions_come_with_the_planner_last_and_without_pairs_there_are_no_differences() -> None:
    assert list(by_condition(unrated())) == ["operator", "pomdp"]
    assert {by_planner(trial) for trial in of_condition(unrated(), "operator")} == {False}
    alone = of_condition(rated(), "pomdp")
    assert paired_rows(alone) == []
    assert "there are no paired differences" in statistics_text(alone)


def test_operators_are_told_apart_in_the_trials_that_they_controlled() -> None:
    trials = [replace(trial, operator_id="AB"[n % 2]) for n, trial in enumerate(rated())]
    rows = {(row["measure"], row["operator"]): row for row in operator_rows(trials)}
    for name in "AB":
        times = [trial.duration for trial in of_condition(trials, "operator") if trial.operator_id == name]
        row = rows["time to Final (s)", name]
        assert (row["n"], row["mean"]) == (len(times), pytest.approx(np.mean(times)))
        assert row["sd"] == pytest.approx(np.std(times, ddof=1))
    assert operator_rows([replace(trial, operator_id="A") for trial in trials]) == []


def test_items_are_ratings_or_yes_and_no_by_their_answers_and_scales() -> None:
    trial = rated()[0]
    assert rated_items([trial]) == {"intelligence": False, "right": True}
    assert scale_of([trial], "intelligence") == (1.0, 10.0)
    bare = replace(
        trial, ratings=({"item": "liked", "value": 3, "scale": None}, {"item": "note", "value": "ok"})
    )
    assert rated_items([bare]) == {"liked": False}
    assert scale_of([bare], "liked") == (3.0, 3.0)


def test_where_both_means_are_equal_nobody_is_an_exception() -> None:
    found = paired({"a": 5.0, "b": 6.0}, {"a": 5.0, "b": 6.0})
    assert exception_sentence(found, "rating", "x", "y").startswith(
        "All teachers have the same or a higher rating"
    )
    assert math.isnan(found.signed_rank_p)
