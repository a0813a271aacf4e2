"""`taskcomm replay --verify`: what it says and its exit codes."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from taskcomm.cli import main
from taskcomm.logs import read_trials, write_trials
from taskcomm.teacher import TeacherModel

SAME, DIFFERS, USAGE, BAD_DATA = range(4)


def run(*arguments: object) -> int:
    return main([str(argument) for argument in arguments])


def verified(*arguments: object) -> int:
    return run("replay", *arguments, "--verify")


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Another model than the intuitive one."""
    path = tmp_path_factory.mktemp("model") / "learned.json"
    replace(TeacherModel.intuitive(), mistake=0.01).save(path)
    return path


def simulated(out: Path, *more: object) -> Path:
    quick = ("--trials", 2, "--jobs", 1, "--balls", 2, "--distances", 2, "--horizon", 2)
    assert run("simulate", "--out", out, *quick, *more) == SAME
    return out


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two trials of the planner and two of an operator."""
    folder = tmp_path_factory.mktemp("logs")
    simulated(folder / "planner.jsonl")
    simulated(folder / "operator.jsonl", "--robot", "operator", "--seed", 1)
    return folder


def test_a_folder_of_trials_as_they_were_played_is_the_same(
    logs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert verified(logs) == SAME
    said = capsys.readouterr().out
    assert "4 trials verified: 4 as logged, 0 different" in said
    for trial in read_trials(logs):
        assert f"{trial.trial_id}: as logged ({trial.num_steps} steps" in said


def test_a_tampered_log_is_named_with_its_step_and_the_others_are_verified(
    logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first, second = read_trials(logs / "planner.jsonl")
    cut = replace(first, steps=first.steps[:3], reason=None, displayed=None)
    noa = next(action for action in first.world.actions(first.states[1]) if str(action) == "noa")
    other = next(a for a in first.world.actions(first.states[1]) if a not in (noa, cut.steps[2].action))
    tampered = replace(cut, steps=(*cut.steps[:2], replace(cut.steps[2], action=other)))
    write_trials([tampered, second], tmp_path / "log.jsonl")
    assert verified(tmp_path) == DIFFERS
    said = capsys.readouterr().out
    assert f"{first.trial_id}: differs at step 2: logged {other}, but the" in said
    assert f"{first.steps[2].action}" in said
    assert "2 trials verified: 1 as logged, 1 different" in said
    assert verified(tmp_path, "--trial", second.trial_id) == SAME


def test_as_json_there_is_nothing_else(logs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert verified(logs, "--json") == SAME
    document = json.loads(capsys.readouterr().out)
    assert (document["differ"], document["not_verified"]) == (0, 0)
    assert [trial["same"] for trial in document["trials"]] == [True] * 4
    assert {trial["controller"] for trial in document["trials"]} == {"planner", "operator"}


def test_a_model_that_is_not_at_hand_is_asked_for(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = simulated(tmp_path / "log.jsonl", "--robot", model)
    assert verified(log) == BAD_DATA
    said = capsys.readouterr()
    assert said.err.count(TeacherModel.load(model).sha256) == 2
    assert "0 trials verified" in said.out
    assert verified(log, "--model", model) == SAME


def test_of_a_studys_folder_the_trials_are_verified_with_its_own_models(model: Path, tmp_path: Path) -> None:
    for name in ("trials", "models", "practice"):
        (tmp_path / name).mkdir()
    (tmp_path / "server.jsonl").write_text('{"kind": "start"}\n')
    simulated(tmp_path / "trials" / "log.jsonl", "--robot", model)
    assert verified(tmp_path) == BAD_DATA
    TeacherModel.load(model).save(tmp_path / "models" / "own.json")
    assert verified(tmp_path) == SAME


def test_lines_that_cannot_be_read_are_said_and_the_rest_is_verified(
    logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = (logs / "planner.jsonl").read_text(encoding="utf-8").splitlines()
    begins = [at for at, line in enumerate(lines) if '"trial_start"' in line]
    lines[begins[1] + 1] = lines[begins[1] + 1].replace('"light_on"', '"light_off"')
    (tmp_path / "log.jsonl").write_text("\n".join(lines) + "\n", encoding="utf-8")
    assert verified(tmp_path / "log.jsonl") == BAD_DATA
    said = capsys.readouterr()
    assert f"log.jsonl:{begins[1] + 2}: action: light_off(1) is not valid in" in said.err
    assert "1 trial verified: 1 as logged" in said.out


@pytest.mark.parametrize(
    ("more", "reason"),
    [
        (("--trial", "nobody"), "no trial 'nobody'"),
        (("--out", "figure.png"), "goes with neither --out nor --explain"),
        (("--explain", 3), "goes with neither --out nor --explain"),
        (("--model", "missing.json"), "neither 'intuitive' nor a model file"),
    ],
)
def test_what_cannot_be_asked_for_is_a_usage_error(
    logs: Path, more: tuple[object, ...], reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert verified(logs, *more) == USAGE
    assert reason in " ".join(capsys.readouterr().err.replace("│", " ").split())
