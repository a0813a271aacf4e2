"""Does looking further help: runs that can be stopped, and what is made of their rows."""

import json
from pathlib import Path
from typing import Any

import pytest
from tinyworld import menu

from learn.closed_loop import run_closed_loop
from learn.horizon_figure import CUT, horizon_figure
from learn.horizon_summary import Arm, summary, table, trial_rows
from learn.horizons import main, study
from learn.kept_rows import KeptRows
from taskcomm.teacher import TeacherModel

WORLD, MODEL = menu(3)
MODES = ("1", "2", "0.000001s")  # with so little time a decision looks one step ahead, on any machine


def rows_of(folder: Path, trials: int, jobs: int = 1, **settings: Any) -> list[dict[str, Any]]:
    begun, arms = study(folder, WORLD, {"own": MODEL}, [MODEL], MODES, max_steps=40, **settings)
    return begun.run(arms, trials, jobs)


def untimed(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [{key: row[key] for key in row if key not in ("share", "seconds", "anew")} for row in rows]


def test_a_run_that_is_stopped_and_gone_on_with_comes_to_the_same(tmp_path: Path) -> None:
    whole = rows_of(tmp_path / "whole", 4)
    assert rows_of(tmp_path / "parts", 4, until=0.0) == []
    first = rows_of(tmp_path / "parts", 2)
    kept = tmp_path / "parts" / "trials.jsonl"
    kept.write_text(kept.read_text(encoding="utf-8") + '{"trial": 3, "mod', encoding="utf-8")
    parts = rows_of(tmp_path / "parts", 4, jobs=2)
    assert untimed(parts) == untimed(whole)
    assert [row for row in parts if row["trial"] < 2] == first  # kept, not run again
    assert len(KeptRows(kept).rows()) == len(parts) == 4 * len(MODES)
    assert rows_of(tmp_path / "parts", 2) == first


def test_a_folder_with_another_study_is_refused(tmp_path: Path) -> None:
    rows_of(tmp_path, 1)
    with pytest.raises(ValueError, match="kept of another run, seed 0, not 1; name another folder"):
        rows_of(tmp_path, 1, seed=1)


def test_rows_are_the_outcomes_of_the_closed_loop(tmp_path: Path) -> None:
    rows = rows_of(tmp_path, 3, seed=5)
    for mode in ("1", "2"):
        loop = run_closed_loop(
            WORLD, {"own": MODEL}, MODEL, 3, horizon=int(mode), seed=5, jobs=1, max_steps=40
        )
        told = [(r["steps"], r["correct"], r["timeout"], r["presses"]) for r in rows if r["mode"] == mode]
        assert told == [(o.steps, o.correct, o.timeout, o.presses) for o in loop.outcomes["own"]]
        assert all(row["reached"] == [int(mode)] * len(row["share"]) for row in rows if row["mode"] == mode)
    near, hurried = ([r for r in rows if r["mode"] == mode] for mode in ("1", "0.000001s"))
    assert untimed(hurried) == [{**row, "mode": "0.000001s"} for row in untimed(near)]


def row(trial: int, mode: str, steps: int, model: str = "own", **more: Any) -> dict[str, Any]:
    made = {"share": [0.5, 1.5], "reached": [3, 5], "seconds": 1.0, "presses": 1, "teacher": trial}
    ended = {"correct": steps < 600, "timeout": steps == 600, "task": "soup"}
    return {"trial": trial, "model": model, "mode": mode, "steps": steps} | made | ended | more


ROWS = [
    *(row(n, "1", 600) for n in range(3)),
    *(row(n, "5", steps) for n, steps in enumerate((100, 200, 120))),
    *(row(n, "7", steps) for n, steps in enumerate((50, 100))),
    row(0, "0.4s", 80, share=[], reached=[]),
    row(0, "2", 90, model="other"),
]


def test_a_summary_means_over_all_trials_and_compares_on_those_of_both() -> None:
    found = {(one["model"], one["mode"]): one for one in summary(ROWS, 0.5)}
    assert list(found) == [("own", "1"), ("own", "5"), ("own", "7"), ("own", "0.4s"), ("other", "2")]
    far = found["own", "7"]
    assert (far["trials"], far["time"], far["against"], far["trials_of_both"]) == (2, 37.5, "5", 2)
    assert (far["time_ratio"], far["time_ratio_low"], far["time_ratio_high"]) == (0.5, 0.5, 0.5)
    assert far["time_difference"] == pytest.approx(-37.5)
    assert (far["planning"], far["late"], far["reached_median"]) == (1.0, 0.5, 4.0)
    near = found["own", "1"]
    assert (near["time"], near["correct"], near["timeout"], near["correct_difference"]) == (300, 0, 1, -1)
    assert near["time_ratio"] == pytest.approx(900 / 210)
    assert found["own", "5"]["time_low"] < 70 < found["own", "5"]["time_high"]
    assert found["own", "0.4s"]["planning"] is None
    assert found["other", "2"]["against"] == "2"


def test_the_table_says_how_many_trials_and_that_they_are_simulated() -> None:
    text = table(summary(ROWS, 0.5), 0.5, 10)
    assert "Simulated" in text
    lines = text.splitlines()[-5:]
    assert [line.split()[:3] for line in lines][1:4] == [
        ["own", "5", "3"],
        ["own", "7", "2"],
        ["own", "0.4s", "1"],
    ]
    assert "5: 0.50 (0.50 to 0.50)" in lines[2]
    assert trial_rows(ROWS, 0.5)[3]["time_s"] == 50.0


def test_the_figure_shows_every_arm_and_writes_what_it_cuts_off() -> None:
    figure = horizon_figure(summary(ROWS, 0.5))
    assert "Simulated" in str(figure.get_suptitle())
    time, right, ratio, planning = figure.axes
    assert [text.get_text() for text in planning.get_xticklabels()] == ["1", "2", "5", "7", "in 0.4 s\n(-)"]
    assert [text.get_text() for text in ratio.texts] == [f"{900 / 210:.1f} \N{UPWARDS ARROW}"]
    assert ratio.get_ylim()[0] < 0.5 < CUT == ratio.get_ylim()[1]
    assert time.get_ylim()[0] == 0
    assert right.get_ylim()[1] > 1
    figure.canvas.draw()


@pytest.mark.parametrize("mode", ["0", "-1", "2.5", "fast", "s", "0s", ""])
def test_a_mode_that_is_none_is_refused(mode: str) -> None:
    with pytest.raises(ValueError, match="neither steps, such as 5, nor a deadline"):
        Arm("own", mode)


def test_the_command_runs_reports_and_goes_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data, out = tmp_path / "data", tmp_path / "out"
    data.mkdir()
    out.mkdir()
    truth = TeacherModel.intuitive()
    (data / "teachers.json").write_text(json.dumps({"a": truth.to_dict(), "b": truth.to_dict()}))
    truth.save(out / "learned.json")
    asked = ["--data", str(data), "--out", str(out), "--models", "learned", "--horizons", "2", "--trials"]
    assert main([*asked, "1", "--minutes", "0"]) == 1
    assert "no trial is done yet" in capsys.readouterr().err
    assert main([*asked, "2"]) == 0
    assert "learned  2      2 " in capsys.readouterr().out
    (found,) = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert (found["model"], found["mode"], found["trials"]) == ("learned", "2", 2)
    assert (out / "horizons.png").stat().st_size > 10_000
    (data / "teacher.json").write_text(truth.to_json())
    assert main([*asked, "2"]) == 1
    assert "kept of another run, truths" in capsys.readouterr().err
    assert main([*asked, "2", "--horizons", "soon"]) == 1
    assert "'soon' is neither steps" in capsys.readouterr().err
    assert main([*asked, "2", "--models", "learned,leaned"]) == 1
    assert "'leaned' is neither intuitive nor learned" in capsys.readouterr().err
    assert main([*asked, "0"]) == 1
    assert "trials: at least 1, not 0" in capsys.readouterr().err
