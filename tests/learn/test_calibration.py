"""Calibration: what was said against what turned out, when first past a threshold and at every moment."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tinyworld import menu

from learn.calibration import THRESHOLDS, calibration
from learn.calibration_figure import calibration_figure, calibration_rows, threshold_rows
from learn.calibration_study import median_teacher, teachers
from learn.closed_loop import Outcome, run_closed_loop
from taskcomm.studies import MEDIANS

WORLD, EAGER = menu()


def outcome(highest: list[float], right: list[bool], steps: int | None = None) -> Outcome:
    length = len(highest) - 1 if steps is None else steps
    return Outcome(length, right[-1], False, 1, np.zeros(len(highest)), np.array(highest), np.array(right))


def sure_at(said: float, times_right: int, times_wrong: int) -> list[Outcome]:
    """Trials that become that sure after a step."""
    kinds = [True] * times_right + [False] * times_wrong
    return [outcome([0.25, said], [False, right]) for right in kinds]


paths = st.lists(
    st.lists(st.tuples(st.floats(0.01, 1.0), st.booleans()), min_size=1, max_size=12), min_size=1, max_size=8
)


def from_paths(drawn: list[list[tuple[float, bool]]]) -> list[Outcome]:
    return [outcome([h for h, _ in path], [r for _, r in path]) for path in drawn]


@given(drawn=paths)
def test_every_threshold_asks_for_the_first_moment_above_it(drawn: list[list[tuple[float, bool]]]) -> None:
    found = calibration(from_paths(drawn), dt=0.5)
    for row in found.curve:
        first = [next(((n, *m) for n, m in enumerate(p) if m[0] > row["threshold"]), None) for p in drawn]
        passed = [moment for moment in first if moment is not None]
        assert row["passed"] == len(passed)
        if passed:
            assert row["said"] == pytest.approx(np.mean([said for _, said, _ in passed]))
            assert row["right"] == pytest.approx(np.mean([right for _, _, right in passed]))
        steps = [len(p) - 1 if moment is None else moment[0] for p, moment in zip(drawn, first, strict=True)]
        assert row["seconds"] == pytest.approx(0.5 * np.mean(steps))
    assert [row["threshold"] for row in found.curve] == sorted(THRESHOLDS)


@given(drawn=paths)
def test_the_brier_score_is_the_sum_of_its_parts_and_zero_only_for_the_certain(
    drawn: list[list[tuple[float, bool]]],
) -> None:
    outcomes = from_paths(drawn)
    found = calibration(outcomes).scores
    assert found is not None
    said, right = (np.concatenate([getattr(o, name) for o in outcomes]) for name in ("highest", "right"))
    assert found.brier.estimate == pytest.approx(np.mean((said - right) ** 2))
    true = np.maximum(np.where(right, said, 1 - said), 2.0**-53)
    assert found.log.estimate == pytest.approx(-np.mean(np.log(true)))
    parts = found.reliability - found.resolution + found.uncertainty + found.within
    assert found.brier.estimate == pytest.approx(parts, abs=1e-12)
    assert min(found.reliability, found.resolution, found.uncertainty) >= 0


def test_where_every_range_holds_one_probability_nothing_is_lost_within_it() -> None:
    outcomes = sure_at(0.75, 3, 2) + sure_at(0.93, 5, 0)
    found = calibration(outcomes).scores
    assert found is not None
    assert found.within == pytest.approx(0.0, abs=1e-12)
    overall = 8 / 20
    assert found.uncertainty == pytest.approx(overall * (1 - overall))
    shares = [(10, 0.25, 0.0), (5, 0.75, 0.6), (5, 0.93, 1.0)]
    assert found.reliability == pytest.approx(sum(n * (said - right) ** 2 for n, said, right in shares) / 20)
    assert found.resolution == pytest.approx(sum(n * (right - overall) ** 2 for n, _, right in shares) / 20)


def test_the_threshold_needed_is_the_least_from_which_on_the_goal_is_met() -> None:
    # above 0.9 and up to 0.95 right in 1 of 2, above that always: 98% from 0.95 on
    outcomes = sure_at(0.951, 20, 20) + sure_at(0.9991, 60, 0)
    found = calibration(outcomes, goal=0.98, ended_at=0.999).needed
    assert (found.threshold, found.most) == (0.96, 0.999)
    assert found.low <= found.threshold <= found.high
    assert found.reached > 0.97
    assert calibration(outcomes, goal=0.7).needed.threshold == 0.5


def test_a_dip_at_a_higher_threshold_puts_the_one_needed_above_it() -> None:
    always, late = (
        [outcome([0.2, 0.97], [False, True])] * 98,
        outcome([0.2, 0.97, 0.992], [False, True, False]),
    )
    wrong_late = calibration([*always[:40], *[late] * 3, *[outcome([0.2, 0.9999], [False, True])] * 57])
    assert wrong_late.needed.threshold > 0.99
    assert calibration([*always, late, late]).needed.threshold == 0.5


def test_none_reaches_the_goal_where_the_sure_are_wrong_and_json_says_so() -> None:
    found = calibration(sure_at(0.9999, 8, 2), ended_at=0.99).needed
    assert math.isinf(found.threshold)
    assert found.most == 0.99
    assert str(found).startswith("none up to 0.99")
    document = json.loads(json.dumps(calibration(sure_at(0.9999, 8, 2)).to_json(), allow_nan=False))
    assert document["needed"]["threshold"] is None
    few = calibration([*sure_at(0.9, 4, 0), *sure_at(0.3, 5, 0)]).needed
    assert math.isnan(few.most)
    assert str(few) == "too few trials passed any threshold"


def test_thresholds_above_the_one_at_which_trials_ended_are_not_asked_about() -> None:
    outcomes = sure_at(0.99995, 5, 0)
    assert [row["threshold"] for row in calibration(outcomes, ended_at=0.98).curve][-1] == 0.98
    with pytest.raises(ValueError, match=r"threshold: 0\.98 says nothing, as the trials were ended at 0\.9"):
        calibration(outcomes, ended_at=0.9)
    with pytest.raises(ValueError, match=r"goal: must be above 0 and at most 1, not 1\.5"):
        calibration(outcomes, goal=1.5)
    with pytest.raises(ValueError, match="groups: 1 names for 5 trials"):
        calibration(outcomes, ["a"])


def test_trials_of_one_person_are_resampled_together() -> None:
    outcomes = [*sure_at(0.99, 10, 0), *sure_at(0.99, 0, 10)]
    people = ["right"] * 10 + ["wrong"] * 10
    together, alone = calibration(outcomes, people), calibration(outcomes)
    assert (together.right.groups, alone.right.groups) == (2, 20)
    assert (together.right.low, together.right.high) == (0.0, 1.0)
    assert 0.2 < alone.right.low < alone.right.high < 0.8
    last = together.rows[-1]
    assert (last["low"], last["high"], last["trials"]) == (0.0, 1.0, 20)


def test_up_to_its_threshold_a_robot_does_as_one_with_a_higher_threshold() -> None:
    loops = [
        run_closed_loop(WORLD, {"a": EAGER}, EAGER, 12, horizon=2, jobs=1, threshold=threshold)
        for threshold in (0.9, 0.999)
    ]
    low, high = (
        calibration(loop.outcomes["a"], threshold=0.9, ended_at=t)
        for loop, t in zip(loops, (0.9, 0.999), strict=True)
    )
    assert high.curve[: len(low.curve)] == low.curve
    assert len(high.curve) > len(low.curve)
    assert high.right == low.right


def test_under_the_true_model_a_robot_is_right_as_often_as_it_says_at_every_threshold() -> None:
    loop = run_closed_loop(WORLD, {"true": EAGER}, EAGER, 120, horizon=1, jobs=1, threshold=0.999)
    found = calibration(loop.outcomes["true"], ended_at=0.999)
    for row in found.curve:
        error = math.sqrt(row["said"] * (1 - row["said"]) / row["passed"])
        assert abs(row["right"] - row["said"]) < 4 * error + 1e-12
    assert found.curve[0]["said"] < 0.8


def test_a_robot_that_takes_mistakes_for_approvals_is_right_less_often_than_it_says() -> None:
    rash = replace(EAGER, mistake=1e-5)
    clumsy = replace(EAGER, mistake=0.1)
    loop = run_closed_loop(WORLD, {"rash": rash}, clumsy, 100, horizon=1, jobs=1, threshold=0.98)
    found = calibration(loop.outcomes["rash"], ended_at=0.98)
    assert found.right.high < found.said
    assert math.isinf(found.needed.threshold)


def test_the_figure_has_a_row_for_each_place_and_tables_hold_its_numbers() -> None:
    judged = {"right": calibration(sure_at(0.99, 50, 0)), "often": calibration(sure_at(0.99, 45, 5))}
    places = {"logs": judged, "closed loop": judged}
    figure = calibration_figure(places)
    assert len(figure.axes) == 6
    assert [text.get_text() for text in figure.axes[0].get_legend().get_texts()] == list(judged)  # type: ignore[union-attr]
    assert {row["where"] for row in calibration_rows(places)} == set(places)
    count = sum(len(one.curve) for one in judged.values())
    assert len(threshold_rows(places)) == 2 * count


def test_no_trials_and_trials_without_paths_are_judged_as_nothing() -> None:
    assert calibration([]).scores is None
    empty = Outcome(4, True, False, 1, np.zeros(0), np.zeros(0), np.zeros(0, dtype=np.bool_))
    found = calibration([empty, empty])
    assert (found.sure, found.rows, found.scores) == (0, (), None)
    json.dumps(found.to_json(), allow_nan=False)
    json.dumps(calibration([]).to_json(), allow_nan=False)


def test_the_study_meets_the_teachers_of_the_data_and_the_median_of_their_population() -> None:
    assert len(teachers()) == 22
    tops = median_teacher().approvals
    assert {s: (top.peak, top.rise, top.fall) for s, top in tops.items()} == MEDIANS
    logs = np.log([[t.peak, t.rise, t.fall] for one in teachers() for t in one.approvals.values()])
    middle = np.log([MEDIANS[state] for state in tops])
    spread = np.median(logs.reshape(22, 3, 3), axis=0) - middle
    assert np.abs(spread).max() < 0.25
