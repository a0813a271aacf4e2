"""taskcomm figures: which logs it reads, whose model it believes with, what it says and leaves."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from ratedstudy import of_condition, rated

from taskcomm.cli import main
from taskcomm.logs import LogError, write_trials
from taskcomm.studylogs import study_logs
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial

DONE, USAGE, BAD_DATA = 0, 2, 3


def figures(*arguments: object) -> int:
    return main(["figures", *map(str, arguments)])


def study_folder(folder: Path, trials: list[Trial], practice: list[Trial]) -> Path:
    """A study's folder as the server leaves it: logs of trials and practice, pages, the server's own."""
    for name in ("trials", "practice", "sessions", "models"):
        (folder / name).mkdir(parents=True)
    (folder / "study.toml").write_text('name = "a"\n', encoding="utf-8")
    for trial in trials:
        write_trials([trial], folder / "trials" / f"{trial.trial_id}.jsonl")
    for trial in practice:
        write_trials([trial], folder / "practice" / f"{trial.trial_id}.jsonl")
    for name in ("sessions/P01.jsonl", "server.jsonl"):
        (folder / name).write_text('{"seq": 0, "type": "page"}\n', encoding="utf-8")
    return folder


@pytest.fixture
def planned() -> list[Trial]:
    return of_condition(rated(), "pomdp")


def test_of_a_study_the_trials_alone_are_drawn(
    tmp_path: Path, planned: list[Trial], capsys: pytest.CaptureFixture[str]
) -> None:
    folder = study_folder(tmp_path / "study", planned[:2], planned[2:3])
    assert [path.parent.name for path in study_logs(folder)] == ["trials", "trials"]
    assert figures(folder, "--out", tmp_path / "out", "--json") == DONE
    shown = json.loads(capsys.readouterr().out)
    assert shown["trials"] == 2
    assert "2 simulated trials" in shown["figures"]["entropy"]
    assert next(row["mean"] for row in shown["statistics"] if row["measure"] == "rating intelligence") == 8.0
    record = json.loads((tmp_path / "out" / "run.json").read_text(encoding="utf-8"))
    assert record["command"] == "figures"
    assert all((tmp_path / "out" / name).is_file() for name in record["outputs"])


def test_practice_is_left_out_of_any_folder_and_a_study_before_its_first_trial_is_an_error(
    tmp_path: Path, planned: list[Trial], capsys: pytest.CaptureFixture[str]
) -> None:
    folder = study_folder(tmp_path / "study", planned[:1], planned[1:2])
    (folder / "study.toml").unlink()
    shutil.rmtree(folder / "sessions")
    (folder / "server.jsonl").unlink()
    assert [path.name for path in study_logs(folder)] == [f"{planned[0].trial_id}.jsonl"]
    shutil.rmtree(folder / "trials")
    with pytest.raises(LogError, match="practice alone"):
        study_logs(folder)
    (folder / "participants.json").write_text("[]", encoding="utf-8")
    assert figures(folder, "--out", tmp_path / "out") == BAD_DATA
    assert "no trial has begun" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_beliefs_are_of_the_model_that_the_log_names_by_its_hash(
    tmp_path: Path, planned: list[Trial], capsys: pytest.CaptureFixture[str]
) -> None:
    model = replace(TeacherModel.intuitive(), mistake=0.02)
    named = [replace(trial, robot_model={"name": "quick", "sha256": model.sha256}) for trial in planned[:2]]
    folder = study_folder(tmp_path / "study", named, [])
    assert figures(folder, "--out", tmp_path / "out") == DONE
    said = capsys.readouterr().err
    assert "not made: entropy: trial" in said
    assert "model 'quick', which is not at hand; name a file with --model" in said
    assert not (tmp_path / "out" / "entropy.png").exists()
    assert (tmp_path / "out" / "time-to-final.png").is_file()
    model.save(folder / "models" / "any-name.json")
    (folder / "models" / "broken.json").write_text("{", encoding="utf-8")
    assert figures(folder, "--out", tmp_path / "out") == DONE
    assert "'quick'" in (tmp_path / "out" / "entropy.txt").read_text(encoding="utf-8")
    assert figures(folder, "--out", tmp_path / "other", "--model", "intuitive") == DONE
    assert TeacherModel.intuitive().sha256[:12] in (tmp_path / "other" / "entropy.txt").read_text(
        encoding="utf-8"
    )


def test_a_trial_can_be_named_and_a_format_chosen(
    tmp_path: Path, planned: list[Trial], capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "trials.jsonl"
    write_trials(planned[:3], log)
    wanted = planned[1].trial_id
    assert figures(log, "--out", tmp_path / "out", "--trial", wanted, "--format", "pdf") == DONE
    caption = (tmp_path / "out" / "task-marginals.txt").read_text(encoding="utf-8")
    assert wanted in caption
    assert "named by hand" in caption
    assert (tmp_path / "out" / "task-marginals.pdf").read_bytes().startswith(b"%PDF")
    capsys.readouterr()
    assert figures(log, "--out", tmp_path / "none", "--trial", "who") == USAGE
    assert "no trial 'who'" in capsys.readouterr().err
    assert not (tmp_path / "none").exists()
