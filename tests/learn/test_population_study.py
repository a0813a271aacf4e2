"""Studies of populations: who teaches in them, how they are summed up, and their figures."""

import numpy as np
import pytest
from matplotlib.colors import to_rgba

from learn.closed_loop import ClosedLoop, Outcome
from learn.held_out_teachers import AVERAGED, POOLED, SEPARATE, UPDATED, HeldOutTeachers
from learn.normal import Normal
from learn.plots import COLOURS
from learn.population import Common, Population, Teacher
from learn.population_figure import teachers_about_their_mean, worth_in_studies, worth_of_knowing
from learn.population_loop import summary as loop_summary
from learn.population_loop import together
from learn.population_study import drawn_teachers, median_teacher, simulated_space, summary


def found(met: tuple[int, ...] = (0, 1, 0, 1, 0, 1)) -> HeldOutTeachers:
    scores = np.arange(6.0)
    arms = {POOLED: scores, UPDATED: scores + 1.0, AVERAGED: scores + 2.0, SEPARATE: scores - np.array(met)}
    return HeldOutTeachers(arms, tuple("aabbcc"), tuple("123456"), np.array(met), np.zeros(6, dtype=np.int64))


def population() -> Population:
    """By hand: two teachers who differ by a factor of e in every coordinate."""
    space, model = simulated_space(), median_teacher()
    middle = space.point(model)
    normal = Normal(middle, 0.25 * np.eye(len(middle)))
    teachers = []
    for name, aside in (("one", -0.5), ("two", 0.5)):
        point = middle + aside
        numbers = tuple(point.tolist())
        teachers.append(Teacher(name, space.model_at(point, {}), numbers, numbers, numbers, 1, 1, 0.0, 1.0))
    common = [Common(name, 0.0, 0.1, 0.5, 0.1, 3.0, "") for name in space.names]
    return Population(
        space, model, model, normal, tuple(common), tuple(teachers), 0.0, 0.0, (0.0,), True, "converged", {}
    )


def test_drawn_teachers_are_about_the_median_one_with_the_spread_asked_for() -> None:
    space = simulated_space()
    rng = np.random.default_rng(0)
    alike = np.array([space.point(teacher) for teacher in drawn_teachers(3, 0.0, rng)])
    np.testing.assert_allclose(alike, np.tile(space.point(median_teacher()), (3, 1)))
    points = np.array([space.point(teacher) for teacher in drawn_teachers(400, 0.1, rng)])
    np.testing.assert_allclose(points.std(axis=0), 0.1, rtol=0.15)


def test_a_summary_has_a_row_for_each_arm_and_number_of_trials_known() -> None:
    rows = summary(found(), {"study": "s"})
    assert [(row["arm"], row["known"], row["trials"]) for row in rows[:3]] == [
        (UPDATED, 0, 3),
        (UPDATED, 1, 3),
        (UPDATED, "", 6),
    ]
    assert {row["estimate"] for row in rows if row["arm"] == AVERAGED} == {"2.0000"}
    assert [row["estimate"] for row in rows if row["arm"] == SEPARATE] == ["0.0000", "-1.0000", "-0.5000"]
    assert all(row["teachers"] == 3 for row in rows)


def test_the_worth_of_knowing_is_drawn_by_arm_at_the_trials_known() -> None:
    ax = worth_of_knowing(summary(found(), {}), "by hand")
    _, labels = ax.get_legend_handles_labels()
    assert labels == [UPDATED, AVERAGED, SEPARATE]
    drawn = [line for line in ax.lines if line.get_marker() == "o"]
    np.testing.assert_allclose(np.asarray(drawn[1].get_xdata(), dtype=float), [0, 1])
    np.testing.assert_allclose(np.asarray(drawn[1].get_ydata(), dtype=float), [2, 2])


def test_studies_stand_side_by_side_on_one_scale_with_one_legend() -> None:
    rows = summary(found(), {})
    figure = worth_in_studies({"one": rows, "two": rows})
    first, second = figure.axes
    assert [ax.get_title(loc="left") for ax in (first, second)] == ["one", "two"]
    assert first.get_legend() is None
    assert second.get_legend() is not None
    assert first.get_ylim() == second.get_ylim()


def test_teachers_are_drawn_about_the_mean_with_the_numbers_given_back() -> None:
    ax, rows = teachers_about_their_mean(population())
    names = simulated_space().names
    assert [label.get_text() for label in ax.get_yticklabels()] == list(names)
    assert len(rows) == 2 * len(names)
    times = {
        row["teacher"]: row["value"] / row["mean_teacher"]
        for row in rows
        if row["parameter"].endswith("rise")
    }
    assert times["two"] == pytest.approx(np.exp(0.5))
    dots = [line for line in ax.lines if line.get_marker() == "o"]
    assert len(dots) == len(names)
    assert {to_rgba(dot.get_color()) for dot in dots} == {to_rgba(COLOURS[0])}


def test_the_middle_of_a_population_is_in_natural_units_and_within_the_bounds() -> None:
    middle = population().middle()
    at, low, high = middle["that_wrt.rise"]
    assert (low, at, high) == pytest.approx((1.4 * np.exp(-0.98), 1.4, 1.4 * np.exp(0.98)))
    assert middle["that_mov.fall"][1] == 0.5  # a step, below which nothing changes


def outcome(steps: int) -> Outcome:
    empty = np.zeros(0)
    return Outcome(steps, True, False, 3, empty, empty, np.zeros(0, dtype=np.bool_))


def test_closed_loops_with_single_teachers_are_one_with_a_group_for_each() -> None:
    loops = [
        ClosedLoop({"pooled": (outcome(100 + n),) * 2, "true": (outcome(50 + n),) * 2}, (0, 0), 0.5)
        for n in range(3)
    ]
    loop = together(loops)
    assert loop.groups == (0, 0, 1, 1, 2, 2)
    rows = loop_summary(loop, {"seed": 0})
    assert [row["robot"] for row in rows] == ["pooled", "true"]
    assert rows[0]["time_ratio"] == "1.0000"
    assert float(rows[1]["time_s"]) == pytest.approx(25.5)
    assert rows[1]["teachers"] == 3
