"""The command line with teachers who show more than a key: simulate, validate, replay."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from signalled import gazing

from learn.replay_figure import replay_figure
from taskcomm.cli import main
from taskcomm.logs import read_trials, write_trials
from taskcomm.replay import belief_path
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Step

DONE, USAGE, BAD_DATA = 0, 2, 3


def run(*arguments: object) -> int:
    return main([str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of two simulated trials with a robot that sees the gaze, and the models in question."""
    folder = tmp_path_factory.mktemp("signals")
    gazing().save(folder / "gazing.json")
    gazing(miss=0.1).save(folder / "missing.json")
    model, log = folder / "gazing.json", folder / "log.jsonl"
    options: list[object] = ["--teacher", model, "--robot", model, "--balls", 2, "--distances", 1]
    options += ["--max-steps", 25, "--trials", 2, "--jobs", 1]
    assert run("simulate", *options, "--out", log) == DONE
    return folder


def test_simulated_logs_hold_the_signals_and_how_far_the_robot_looked(folder: Path) -> None:
    assert run("validate", folder / "log.jsonl") == DONE
    for trial in read_trials(folder / "log.jsonl"):
        assert trial.channels == ("gaze",)
        assert trial.planner is not None
        assert trial.planner["horizon"] == 3


def _replayed(folder: Path, capsys: pytest.CaptureFixture[str], model: object) -> Any:
    (trial, _) = read_trials(folder / "log.jsonl")
    options: list[object] = ["--trial", trial.trial_id, "--explain", 1, "--horizon", 2]
    capsys.readouterr()
    assert run("replay", folder / "log.jsonl", "--model", model, *options, "--json") == DONE
    return json.loads(capsys.readouterr().out)


def test_a_replay_believes_the_signals_and_explains_the_plan_over_the_key(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    seeing = _replayed(folder, capsys, folder / "gazing.json")
    deaf = _replayed(folder, capsys, "intuitive")
    assert seeing["pressed"] == deaf["pressed"]
    assert seeing["signals"].keys() == {"gaze"}
    assert "signals" not in deaf
    assert seeing["highest"] != deaf["highest"]
    assert seeing["explanation"]["horizon"] == 2
    assert seeing["explanation"]["marginal"] != deaf["explanation"]["marginal"]


def test_a_key_that_was_not_recorded_is_null_in_a_replay(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (trial, _) = read_trials(folder / "log.jsonl")
    steps = tuple(replace(step, pressed=None) if t == 1 else step for t, step in enumerate(trial.steps))
    write_trials([replace(trial, steps=steps)], tmp_path / "log.jsonl")
    capsys.readouterr()
    assert run("replay", tmp_path / "log.jsonl", "--json") == DONE
    pressed = json.loads(capsys.readouterr().out)["pressed"]
    assert pressed == [step.pressed for step in steps]


def test_the_figure_has_a_panel_for_each_channel_and_bands_where_no_key_was_recorded(folder: Path) -> None:
    (trial, _) = read_trials(folder / "log.jsonl")
    steps = tuple(replace(step, pressed=None) if t in (1, 2) else step for t, step in enumerate(trial.steps))
    unsure = replace(trial, steps=steps)
    bare = replay_figure(belief_path(trial, TeacherModel.intuitive()), ())
    full = replay_figure(belief_path(unsure, gazing()), ())
    assert full.axes[-1].get_title(loc="left") == "signal: gaze"
    assert len(full.axes) == len(bare.axes) + 1
    dots = full.axes[-1].lines[0]
    assert len(dots.get_xdata()) == trial.num_steps  # type: ignore[arg-type]
    assert all(len(ax.patches) == 2 for ax in full.axes)
    assert not any(ax.patches for ax in bare.axes)
    assert full.axes[-1].get_xlabel() == "seconds (grey lines: presses; bands: key not recorded)"


def test_a_signal_that_the_model_does_not_know_is_named_with_trial_and_step(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (trial, _) = read_trials(folder / "log.jsonl")
    odd: tuple[Step, ...] = (replace(trial.steps[0], signals={"gaze": "9"}), *trial.steps[1:])
    write_trials([replace(trial, steps=odd, reason=None, displayed=None)], tmp_path / "log.jsonl")
    assert run("replay", tmp_path / "log.jsonl", "--model", folder / "gazing.json") == BAD_DATA
    message = f"error: trial {trial.trial_id}, step 0: signals.gaze: '9' is none of 1, 2, none\n"
    assert capsys.readouterr().err == message


def test_a_plan_under_a_key_that_misses_is_not_explained(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (trial, _) = read_trials(folder / "log.jsonl")
    options: list[object] = ["--model", folder / "missing.json", "--trial", trial.trial_id, "--explain", 0]
    assert run("replay", folder / "log.jsonl", *options) == USAGE
    assert "plans are explained for keys that never err" in " ".join(capsys.readouterr().err.split())


def test_a_channel_that_does_not_fit_the_world_is_named_with_its_model(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    document = gazing().to_dict()
    table = document["observation"]["channels"]["gaze"]["table"]
    for row in table.values():
        row["arm"] = row.pop("wrt")
    path = tmp_path / "arm.json"
    TeacherModel.from_dict(document).save(path)
    assert run("replay", folder / "log.jsonl", "--model", path, "--trial", "x") == USAGE
    (trial, _) = read_trials(folder / "log.jsonl")
    code = run("replay", folder / "log.jsonl", "--model", path, "--trial", trial.trial_id)
    assert code == BAD_DATA
    assert (
        f"error: {path}: observation.channels.gaze: the world knows a role 'wrt'" in capsys.readouterr().err
    )
