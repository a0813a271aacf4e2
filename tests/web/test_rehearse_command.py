"""`taskcomm study rehearse`, from a study's folder to its report."""

import json
from pathlib import Path

import pytest
from web.rehearsing import OPERATOR, robot

from taskcomm.cli import main
from taskcomm.logs import read_trials
from taskcomm.web.study.folder import StudyFolder
from taskcomm.web.study.structure import Design, Operators, Timing


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    design = Design(
        name="pilot",
        teachers=2,
        conditions=(robot(), OPERATOR),
        operators=Operators(draw=1),
        practice="pomdp",
        timing=Timing(limit=15.0),
    )
    return StudyFolder.new(tmp_path / "pilot", design).path


def test_one_command_rehearses_a_copy_and_ends_in_export_and_figures(
    folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (folder / "texts" / "en.toml").write_text(
        (folder / "texts" / "en.toml").read_text().replace("Thank you", "Many thanks")
    )
    words = ["study", "rehearse", str(folder), "--teachers", "1", "--no-analysis", "--json"]
    assert main(words) == 0
    document = json.loads(capfd.readouterr().out)
    out = tmp_path / "pilot-rehearsal"
    assert document["out"] == str(out)
    assert {name: c["trials"] for name, c in document["conditions"].items()} == {"pomdp": 1, "operator": 1}
    trials = read_trials([out / "study" / "trials"])
    assert {trial.source for trial in trials} == {"simulated"}
    assert document["labels"] == sum(len(trial.reasons) for trial in trials)
    assert len(list((out / "study" / "practice").glob("*.jsonl"))) == 1
    assert (out / "export" / "dataset_description.json").is_file()
    assert (out / "figures" / "statistics.md").is_file()
    assert "Simulated: nobody took part" in (out / "report.md").read_text()
    assert set(json.loads((out / "teachers.json").read_text())) == {"P01"}
    assert "Many thanks" in (out / "study" / "texts" / "en.toml").read_text()
    assert not any((folder / "trials").glob("*"))


def test_a_folder_with_something_in_it_is_never_written_to(
    folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    kept = tmp_path / "kept"
    kept.mkdir()
    (kept / "P01-1.jsonl").write_text("what people did")
    assert main(["study", "rehearse", str(folder), "--out", str(kept)]) == 3
    assert capfd.readouterr().err.strip().endswith("is there and not empty; name another folder with --out")
    assert [file.name for file in kept.iterdir()] == ["P01-1.jsonl"]


def test_a_teacher_model_of_another_step_is_refused_by_name(
    folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    from taskcomm.teacher import TeacherModel

    TeacherModel.intuitive().with_dt(0.25).save(tmp_path / "quick.json")
    words = ["study", "rehearse", str(folder), "--teacher", str(tmp_path / "quick.json")]
    assert main(words) == 3
    assert "quick.json: dt: the model is for steps of 0.25 s" in capfd.readouterr().err
    assert not (tmp_path / "pilot-rehearsal").exists()
