"""Figures of a study: they show the numbers they say, name their data, and fit a column of print."""

import csv
import io
from dataclasses import replace
from functools import cache
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from logsamples import trials as any_trial
from matplotlib.figure import Figure
from matplotlib.text import Text
from ratedstudy import labelled, of_condition, rated, unrated

from learn.study_belief_figures import accuracy_figure, entropy_figure
from learn.study_beliefs import (
    Believed,
    accuracy,
    accuracy_rows,
    believed,
    mistake_over_time,
    typical_recovery,
    typical_trial,
)
from learn.study_condition_figures import bin_edges, rating_figures, time_figure
from learn.study_report import StudyReport, study_report, write_study_report
from learn.study_style import WIDTH
from learn.study_trial_figures import marginals_figure, recovery_figure
from learn.study_trials import Missing
from taskcomm.replay import press_reasons
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial

MODEL = TeacherModel.intuitive()
ALL = {"mistake-recovery", "task-marginals", "inference-of-mental-state", "time-to-final", "entropy"}


def intuitive(_trial: Trial) -> TeacherModel:
    return MODEL


@cache
def beliefs() -> tuple[Believed, ...]:
    found, left_out = believed(of_condition(unrated(), "pomdp"), intuitive)
    assert not left_out
    return tuple(found)


@cache
def report() -> StudyReport:
    mixed = tuple([10, 9, 9, 8] * 5 + [8, 7])
    return study_report(rated(mixed, (*mixed[3:], 4, 6, 9)), intuitive)


def reach(figure: Figure) -> tuple[float, float, float, float]:
    """How far what is drawn reaches out of the figure at left, bottom, right and top, in inches."""
    figure.draw_without_rendering()
    figure.savefig(io.BytesIO(), dpi=100)
    drawn = figure.get_tightbbox()
    width, height = figure.get_size_inches()
    return -drawn.x0, -drawn.y0, drawn.x1 - width, drawn.y1 - height


def test_every_figure_fits_a_column_of_print_and_can_be_read() -> None:
    assert {figure.name for figure in report().figures} == ALL | {"ratings-intelligence"}
    assert report().not_made == {}
    for one in report().figures:
        assert one.figure.get_figwidth() == WIDTH == 3.2
        sizes = [float(text.get_fontsize()) for text in one.figure.findobj(Text) if isinstance(text, Text)]
        assert min(sizes) >= 6.5, one.name
        assert max(reach(one.figure)) < 0.01, one.name


def test_every_caption_and_figure_says_which_data_it_shows() -> None:
    human = [replace(trial, source="human") for trial in rated()]
    for found, said, other in (
        (report(), "simulated", "human"),
        (study_report(human, intuitive), "human", "simulated"),
    ):
        for one in found.figures:
            shown = " ".join(text.get_text() for text in one.figure.findobj(Text) if isinstance(text, Text))
            for words in (one.caption, shown):
                assert said in words
                assert other not in words.replace("human-", "")
            if one.name not in ("time-to-final", "ratings-intelligence"):
                assert "teacher model 'intuitive'" in one.caption
    mixed = {one.name: one.caption for one in study_report([*human[:2], *rated()[2:4]], intuitive).figures}
    for name in ("time-to-final", "ratings-intelligence"):
        assert "4 trials (some of them SIMULATED)" in mixed[name]


def test_the_mistake_shown_has_the_greatest_spike_that_was_undone() -> None:
    spikes = []
    for one in beliefs():
        columns = one.path.marginal_of("mov")
        for step, state in one.truth.items():
            if state == "mistake":
                spikes += [
                    column[step + 1] - max(column[step], column[-1])
                    for ball, column in columns.items()
                    if one.trial.task is not None and ball != one.trial.task.mov
                ]
    found = typical_recovery(beliefs())
    assert found.spike == max(spikes) > 0.3
    assert found.of.truth[found.step] == "mistake"
    rows = recovery_figure(found).rows
    column = [row[f"mov={found.wrong}"] for row in rows]
    assert column[found.step + 1] - max(column[found.step], column[-1]) == pytest.approx(found.spike)
    assert rows[found.step + 1]["press"] == 1


def test_a_mistake_that_the_trial_did_not_undo_is_no_recovery() -> None:
    found = typical_recovery(beliefs())
    trial = found.of.trial
    cut = replace(trial, steps=trial.steps[: found.step + 1], reason=None, displayed=None)
    (one,), _ = believed([cut], intuitive)
    assert one.truth[found.step] == "mistake"
    with pytest.raises(
        Missing, match=r"none of \d mistaken press(es)? raised a wrong mov that the trial then undid"
    ):
        typical_recovery([replace(one, truth={found.step: "mistake"})])


def test_the_probability_of_a_mistake_runs_from_what_was_believed_at_once_to_the_end() -> None:
    one = beliefs()[0]
    for reason in one.reasons:
        found = mistake_over_time(one, reason.step)
        assert len(found) == one.trial.num_steps - reason.step
        assert found[0] == pytest.approx(reason.at_once["mistake"], abs=1e-9)
        assert found[-1] == pytest.approx(reason.at_end["mistake"], abs=1e-9)


def test_the_bars_are_means_over_all_presses_of_what_replay_says_of_their_true_state() -> None:
    rows = accuracy_rows(beliefs())
    trials = of_condition(unrated(), "pomdp")
    assert len(rows) == sum(int(trial.presses.sum()) for trial in trials)
    by_state: dict[str, list[tuple[float, float]]] = {}
    for trial in trials:
        for reason in press_reasons(trial, MODEL):
            assert reason.noted is not None
            pair = reason.at_once[reason.noted], reason.at_end[reason.noted]
            by_state.setdefault(reason.noted, []).append(pair)
    found = accuracy(rows)
    assert list(found) == ["mistake", "that_mov", "that_wrt", "that_dist"]
    for state, means in found.items():
        at_press, at_end = np.mean(by_state[state], axis=0)
        assert means["at_press"].estimate == pytest.approx(at_press)
        assert means["at_end"].estimate == pytest.approx(at_end)
        assert at_end > at_press
    heights = [patch.get_height() for patch in accuracy_figure(beliefs()).figure.axes[0].patches]  # type: ignore[attr-defined]
    assert heights[:2] == pytest.approx(np.mean(by_state["mistake"], axis=0))


def test_labels_are_the_truth_of_presses_and_those_in_dispute_are_left_out_and_counted() -> None:
    trial = of_condition(unrated(), "pomdp")[0]
    first, second, third = (int(step) for step in np.flatnonzero(trial.presses)[:3])
    judged = labelled(
        trial, (first, "that_mov", "ann"), (second, "mistake", "ann"), (second, "that_wrt", "bob"),
        (third, "mistake", "ann"), (third, "that_dist", "ann"),
    )  # fmt: skip
    found, _ = believed([judged], intuitive)
    assert found[0].truth == {first: "that_mov", third: "that_dist"}
    rows = accuracy_rows(found)
    assert [(row["step"], row["mental_state"]) for row in rows] == [(first, "that_mov"), (third, "that_dist")]
    caption = accuracy_figure(found).caption
    assert "1 press is left out: annotators disagree" in caption
    assert "true reasons as labelled by ann, bob" in caption
    left = int(trial.presses.sum()) - 3
    assert f"{left} press{'es are' if left > 1 else ' is'} left out: their reason is not known" in caption


def test_the_typical_trial_is_the_median_of_those_that_were_right() -> None:
    lengths = sorted(one.trial.num_steps for one in beliefs() if one.trial.correct)
    typical = typical_trial(beliefs())
    assert typical.trial.num_steps == lengths[(len(lengths) - 1) // 2]
    rows = marginals_figure(typical, "").rows
    for field in ("mov", "wrt", "dist"):
        total = sum(np.array([row[key] for row in rows]) for key in rows[0] if key.startswith(f"{field}="))
        np.testing.assert_allclose(total, 1.0)
    assert sum(row["press"] for row in rows) == int(typical.trial.presses.sum())


def test_every_trial_of_the_planner_begins_at_the_entropy_of_all_tasks() -> None:
    made = entropy_figure(beliefs())
    starts = [row["entropy"] for row in made.rows if row["time"] == 0]
    assert len(starts) == 22
    np.testing.assert_allclose(starts, np.log(24))
    mistaken = sum("mistake" in one.truth.values() for one in beliefs())
    assert f"{mistaken} trials with a press known to be a mistake" in made.caption


def test_every_time_to_final_is_in_one_bin() -> None:
    made = time_figure(unrated())
    for condition in ("operator", "pomdp"):
        assert sum(row[condition] for row in made.rows) == 22
    for times in ([0.5], [3.0, 55.0], [60.0, 120.0], [4000.0]):
        edges = bin_edges(times)
        assert np.histogram(times, edges)[0].sum() == len(times)
        assert len(edges) <= 16
    assert "40 of 44" in made.caption


def test_the_ratings_are_drawn_as_they_were_given() -> None:
    (made,) = rating_figures(rated())
    assert [row["rating"] for row in made.rows] == [9.0] * 22 + [8.0] * 22
    assert len({row["teacher"] for row in made.rows}) == 22
    marks = [text.get_text() for text in made.figure.axes[0].texts]
    assert marks == ["22", "22"]


def test_what_is_missing_leaves_out_its_figure_alone_and_is_said_in_a_line() -> None:
    bare = [labelled(trial) for trial in of_condition(unrated(), "pomdp")[:3]]
    found = study_report(bare, intuitive)
    assert {figure.name for figure in found.figures} == {"task-marginals", "time-to-final", "entropy"}
    assert found.not_made == {
        "mistake-recovery": "no press is known to be a mistake, from a simulation or a label",
        "inference-of-mental-state": "no reason of a press is known, from a simulation or a label",
        "ratings": "no trial has a rating in numbers",
    }
    only = study_report(of_condition(rated(), "operator")[:2], intuitive)
    assert {figure.name for figure in only.figures} == {"ratings-intelligence", "time-to-final"}
    assert set(only.not_made.values()) == {"no trial was with the planner"}


def test_a_trial_without_an_end_right_or_final_spoils_nothing() -> None:
    planned = of_condition(unrated(), "pomdp")
    cut = [replace(trial, reason="aborted", displayed=None, steps=trial.steps[:9]) for trial in planned[:3]]
    found = study_report(cut, intuitive)
    assert found.not_made["time-to-final"] == "no trial ended with Final"
    assert found.not_made["task-marginals"] == "no trial with the planner ended rightly"
    assert "entropy" in {figure.name for figure in found.figures}
    caption = next(
        f.caption for f in study_report([*cut, *planned[3:5]], intuitive).figures if f.name == "time-to-final"
    )
    assert "3 aborted" in caption


def test_a_trial_that_cannot_be_replayed_is_named_and_the_rest_drawn() -> None:
    def other_step(trial: Trial) -> TeacherModel:
        return MODEL.with_dt(0.25) if trial.trial_id == "study-001-1" else MODEL

    found = study_report(unrated(), other_step)
    assert len(found.left_out) == 1
    assert found.left_out[0].startswith("trial study-001-1 cannot be replayed: dt")
    assert "21 simulated trials" in next(one.caption for one in found.figures if one.name == "entropy")


def test_beliefs_are_missing_where_the_model_is() -> None:
    def nowhere(trial: Trial) -> TeacherModel:
        raise Missing(f"trial {trial.trial_id}: no model")

    found = study_report(rated(), nowhere)
    assert {figure.name for figure in found.figures} == {"ratings-intelligence", "time-to-final"}
    assert len(found.not_made) == 4


def test_equal_studies_leave_equal_bytes_and_numbers_beside_every_figure(tmp_path: Path) -> None:
    before = dict(matplotlib.rcParams)
    trials = rated()[27:31]
    folders = [tmp_path / "a", tmp_path / "b"]
    for folder, ending in zip(folders, ("png", "png"), strict=True):
        folder.mkdir()
        write_study_report(study_report(trials, intuitive), trials, folder, ending=ending)
    names = sorted(path.name for path in folders[0].iterdir())
    assert names == sorted(path.name for path in folders[1].iterdir())
    assert all((folders[0] / name).read_bytes() == (folders[1] / name).read_bytes() for name in names)
    for name in (*ALL, "ratings-intelligence"):
        assert {f"{name}.png", f"{name}.csv", f"{name}.txt"} <= set(names)
        with (folders[0] / f"{name}.csv").open(encoding="utf-8", newline="") as file:
            assert list(csv.DictReader(file))
    assert dict(matplotlib.rcParams) == before
    assert "**These trials are simulated**" in (folders[0] / "figures.md").read_text(encoding="utf-8")


@settings(deadline=None, max_examples=12)
@given(st.lists(any_trial(), max_size=3, unique_by=lambda trial: trial.trial_id))
def test_whatever_trials_come_every_figure_is_made_or_named_with_the_reason(trials: list[Trial]) -> None:
    at_step = [replace(trial, dt=MODEL.dt) for trial in trials]
    found = study_report([*trials, *at_step], intuitive)
    made = {"ratings" if one.name.startswith("ratings-") else one.name for one in found.figures}
    assert made | found.not_made.keys() == ALL | {"ratings"}
    assert not made & found.not_made.keys()
    assert all(one.caption and one.rows for one in found.figures)


def test_signs_in_names_are_shown_as_they_are(tmp_path: Path) -> None:
    lines = tuple({"item": item, "value": 3, "scale": None} for item in ("$\\a$ b", "$\\a$-b"))
    named = [
        replace(trial, condition=f"$\\{trial.condition}$ 100%_", ratings=lines) for trial in rated()[26:30]
    ]
    found = study_report(named, intuitive)
    assert len({one.name for one in found.figures}) == len(found.figures) >= len(ALL) + 1
    drawn = next(one.figure for one in found.figures if one.name == "time-to-final")
    drawn.savefig(tmp_path / "drawn.svg")
    shown = [str(text.get_text()) for text in drawn.findobj(Text) if isinstance(text, Text)]
    assert any("$\\pomdp$ 100%_" in text for text in shown)
