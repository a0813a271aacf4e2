"""`taskcomm population`: what it writes, what it prints, its exit codes."""

import json
from pathlib import Path

import pytest

from learn import Population
from taskcomm.cli import BAD_DATA, DONE, FAILED, NOT_CONVERGED, main
from taskcomm.logs import read_trials, write_trials
from taskcomm.teacher import TeacherModel

QUICK = ("--starts", 1, "--draws", 20, "--rounds", 2)


def run(*arguments: object) -> int:
    return main([str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Simulated: six operator trials of three people."""
    path = tmp_path_factory.mktemp("logs") / "trials.jsonl"
    code = run("simulate", "--robot", "operator", "--trials", 6, "--people", 3, "--jobs", 1, "--out", path)
    assert code == DONE
    return path


def test_it_writes_the_population_a_model_of_each_teacher_and_a_record(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, models = tmp_path / "population.json", tmp_path / "teachers"
    assert run("population", log, *QUICK, "--out", out, "--models", models, "--json") == NOT_CONVERGED
    shown = capsys.readouterr()
    document, found = json.loads(shown.out), Population.load(out)
    assert "not converged: still moving after 2 rounds" in shown.err
    assert document["status"] == found.status
    assert document["common"][0]["name"] == "mistake"
    names = sorted({str(trial.participant_id) for trial in read_trials(log)})
    assert [teacher["name"] for teacher in document["teachers"]] == names
    assert {path.name for path in models.iterdir()} == {f"{name}.json" for name in (*names, "mean-teacher")}
    assert TeacherModel.load(models / f"{names[1]}.json") == found.teachers[1].model
    assert TeacherModel.load(models / "mean-teacher.json") == found.model
    record = json.loads((tmp_path / "population.json.run.json").read_text())
    assert record["settings"]["draws"] == 20
    assert {path.name for path in tmp_path.iterdir()} == {out.name, f"{out.name}.run.json", models.name}


def test_the_tables_say_what_teachers_have_in_common_and_name_each(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("population", log, *QUICK, "--out", tmp_path / "p.json") == NOT_CONVERGED
    shown = capsys.readouterr().out
    assert "3 teachers: log-likelihood" in shown
    assert "that_dist.fall" in shown
    assert all(str(trial.participant_id) in shown for trial in read_trials(log))


def test_one_teacher_alone_is_bad_data_and_leaves_nothing(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    alone = tmp_path / "alone.jsonl"
    write_trials(read_trials(log)[:1], alone)
    assert run("population", alone, "--out", tmp_path / "p.json", "--models", tmp_path / "m") == BAD_DATA
    assert "at least two teachers" in capsys.readouterr().err
    assert {path.name for path in tmp_path.iterdir()} == {"alone.jsonl"}
    assert run("population", log, "--out", tmp_path / "none" / "p.json") == FAILED


def test_help_shows_an_example(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("population", "--help") == DONE
    assert "Example: taskcomm population" in capsys.readouterr().out


def test_files_are_named_for_teachers_whatever_they_are_called() -> None:
    from taskcomm.commands.population import file_names

    names = ("a/b", "a:b", "..", "mean-teacher", "é 1")
    assert file_names(names) == ["a_b", "a_b~2", "teacher", "mean-teacher", "é_1", "mean-teacher~2"]
