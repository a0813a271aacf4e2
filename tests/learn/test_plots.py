"""Figures: they show what they say, leave matplotlib as it was, and have their numbers beside them."""

import csv
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from menustudy import START, TRUE, comparison, study

from learn.closed_loop import ClosedLoop
from learn.outcome_files import write_comparison
from learn.plots import (
    approval_after,
    entropy_over_time,
    entropy_quantiles,
    save,
    table_top,
    table_top_rows,
    table_tops,
    time_to_final,
)
from learn.replay_figure import replay_figure
from taskcomm.levels import Floats
from taskcomm.replay import belief_path, press_reasons
from taskcomm.teacher import TableTop, TeacherModel


def loop_of_the_comparison() -> ClosedLoop:
    loop = comparison().loop
    assert loop is not None
    return loop


def levels_by_small_steps(top: TableTop, seconds: Floats, cue: str) -> Floats:
    """The table-top by many small steps of the recursion, from level 0 (on) or 1 (off)."""
    tiny, level, now, answer = 1e-4, 0.0 if cue == "on" else 1.0, 0.0, []
    for until in seconds:
        while now < until - tiny / 2:
            now += tiny
            if now > top.delay:
                level += tiny / top.rise if cue == "on" else -tiny / top.fall
                level = min(1.0, max(0.0, level))
        answer.append(top.peak * level)
    return np.array(answer)


@pytest.mark.parametrize("cue", ["on", "off"])
def test_a_drawn_table_top_is_the_recursion_in_continuous_time(cue: str) -> None:
    top = TableTop("mov_lit", peak=0.3, rise=0.8, fall=1.7, delay=0.35)
    seconds = np.linspace(0, 3, 31)
    np.testing.assert_allclose(
        approval_after(top, seconds, cue), levels_by_small_steps(top, seconds, cue), atol=2e-4
    )


def test_every_model_has_its_line_and_axes_are_used_as_given() -> None:
    models = {"intuitive": START, "true": TRUE}
    (state,) = TRUE.approvals
    given = Figure().add_subplot()
    axes = table_top(models, state, ax=given, truths=[TRUE, TRUE])
    assert axes is given
    assert isinstance(table_top(models, state), Axes)
    labels = [line.get_label() for line in axes.get_lines()]
    assert {"intuitive", "true", "true teachers"} <= set(labels)
    drawn = next(line for line in axes.get_lines() if line.get_label() == "true")
    x, y = np.asarray(drawn.get_xdata(), dtype=float), np.asarray(drawn.get_ydata(), dtype=float)
    np.testing.assert_allclose(y[x >= 0], approval_after(TRUE.approvals[state], x[x >= 0]))
    assert (y[x < 0] == 0).all()


def test_times_to_final_end_at_the_share_that_is_right() -> None:
    loop = loop_of_the_comparison()
    axes = time_to_final(loop)
    ends = [
        float(np.asarray(line.get_ydata())[-1])
        for line in axes.get_lines()
        if len(np.asarray(line.get_xdata()))
    ]
    for place, arm in enumerate(loop.arms):
        assert ends[2 * place] == pytest.approx(1 - loop.timeout(arm).mean())
        assert ends[2 * place + 1] == pytest.approx(loop.correct(arm).mean())


def test_entropy_starts_at_the_prior_and_a_finished_trial_keeps_its_last() -> None:
    loop = loop_of_the_comparison()
    for arm in loop.arms:
        time, quartiles = entropy_quantiles(loop, arm)
        np.testing.assert_allclose(quartiles[:, 0], np.log(4))
        last = [outcome.entropy[-1] for outcome in loop.outcomes[arm]]
        np.testing.assert_allclose(quartiles[:, -1], np.quantile(last, [0.25, 0.5, 0.75]))
        assert time[1] == 0.5
    assert [line.get_label() for line in entropy_over_time(loop).get_lines()] == list(loop.arms)


def test_drawing_changes_no_setting_and_opens_no_window(tmp_path: Path) -> None:
    import matplotlib.pyplot as plt

    before = dict(matplotlib.rcParams)
    save(table_tops({"a": TeacherModel.intuitive()}), tmp_path / "a.png", [{"x": 1}])
    assert dict(matplotlib.rcParams) == before
    assert plt.get_fignums() == []


def test_a_saved_figure_has_its_numbers_beside_it_and_equal_figures_equal_bytes(tmp_path: Path) -> None:
    rows = table_top_rows({"true": TRUE}, seconds=2.0)
    written = [save(table_tops({"true": TRUE}), tmp_path / name, rows) for name in ("a.png", "b.png")]
    assert [path.name for path in written[0]] == ["a.png", "a.csv"]
    assert written[0][0].read_bytes() == written[1][0].read_bytes()
    with written[0][1].open(encoding="utf-8", newline="") as file:
        read = list(csv.DictReader(file))
    assert len(read) == len(rows) == 42
    assert [float(row["probability"]) for row in read] == [row["probability"] for row in rows]


def test_a_comparison_is_written_with_every_figure_its_report_shows(tmp_path: Path) -> None:
    written = write_comparison(comparison(), study(), tmp_path, title="T", known_truths=[TRUE])
    assert sorted(path.name for path in written) == sorted(path.name for path in tmp_path.iterdir())
    text = (tmp_path / "report.md").read_text(encoding="utf-8")
    shown = {part.split(")")[0] for part in text.split("](")[1:]}
    assert shown == {"table-tops.png", "time-to-final.png", "entropy.png", "calibration.png"}
    assert all((tmp_path / name).is_file() for name in shown)
    assert TeacherModel.load(tmp_path / "learned.json") == comparison().fitted.model
    with (tmp_path / "held-out.csv").open(encoding="utf-8", newline="") as file:
        assert [row["trial_id"] for row in csv.DictReader(file)] == [trial.trial_id for trial in study()]


def test_a_replay_figure_has_a_panel_for_tasks_entropy_and_reasons() -> None:
    trial = study()[0]
    reasons = press_reasons(trial, TRUE)
    figure = replay_figure(belief_path(trial, TRUE), reasons, trial.task, title="One")
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert titles[:2] == ["task", "entropy of the task"]
    assert titles[2].startswith("why it was pressed")
    heights = sum(patch.get_height() for patch in figure.axes[2].patches)  # type: ignore[attr-defined]
    assert heights == pytest.approx(2 * len(reasons))
