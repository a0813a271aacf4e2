"""`taskcomm study new` and `study status` on the command line."""

import json
from pathlib import Path

import pytest

from taskcomm.cli import main
from taskcomm.teacher import TeacherModel
from taskcomm.web.study.folder import StudyFolder

DONE, USAGE, BAD_DATA = 0, 2, 3


def run(*arguments: object) -> int:
    return main(["study", *map(str, arguments)])


@pytest.mark.parametrize("command", ["new", "status"])
def test_help_shows_an_example(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(command, "--help") == DONE
    shown = capsys.readouterr().out
    assert f"Example: taskcomm study {command}" in shown
    assert "--json" in shown


def test_new_makes_the_papers_study_and_says_where_the_links_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "study"
    assert run("new", folder) == DONE
    shown = capsys.readouterr().out
    assert "22 teachers, 4 operators, 66 trials drawn" in shown
    assert str(folder / "private" / "links.json") in shown
    assert "these operate: O1 5, O2 6, O3 18, O4 19; the others teach" in shown
    study = StudyFolder(folder)
    tokens = [token for some in study.tokens.values() for token in some.values()]
    assert len(tokens) == 22 + 4 + 2
    assert not any(token in shown for token in tokens)


def test_new_with_json_prints_json_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("new", tmp_path / "study", "--teachers", 3, "--language", "de", "--seed", 4, "--json") == DONE
    document = json.loads(capsys.readouterr().out)
    assert document["participants"] == ["P01", "P02", "P03"]
    assert document["operators"] == ["O1", "O2", "O3"]
    study = StudyFolder(tmp_path / "study")
    assert (study.design.language, study.design.seed) == ("de", 4)
    assert study.design.title == "Einem Roboter etwas beibringen"
    assert study.texts.consent.button.startswith("Ich stimme zu")


def test_a_design_and_models_of_ones_own(tmp_path: Path) -> None:
    design, model = tmp_path / "mine.toml", tmp_path / "prompt.json"
    design.write_text(
        'name = "mine"\nteachers = 2\n[[conditions]]\nname = "p"\ncontroller = "planner"\n'
        'model = "prompt.json"\n'
    )
    TeacherModel.intuitive().save(model)
    assert run("new", tmp_path / "study", "--design", design, "--model", model) == DONE
    study = StudyFolder(tmp_path / "study")
    assert study.design.name == "mine"
    assert (study.path / "study.toml").read_text() == design.read_text()


@pytest.mark.parametrize(
    ("design", "said"),
    [
        ('name = "mine"\nteacher = 2', "mine.toml: teacher: is unknown; did you mean teachers?"),
        ('name = "mine"\nlanguage = "fr"', "texts/fr.toml: there is no such file"),
    ],
)
def test_bad_data_is_one_line_and_leaves_nothing(
    tmp_path: Path, design: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(design)
    assert run("new", tmp_path / "study", "--design", path) == BAD_DATA
    out, err = capsys.readouterr()
    assert out == ""
    assert said in err
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert not (tmp_path / "study").exists()


def test_status_shows_where_everyone_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "study"
    assert run("new", folder, "--teachers", 2) == DONE
    line = {
        "seq": 0,
        "type": "page",
        "page": 0,
        "kind": "consent",
        "name": "consent",
        "values": {"agreed": True},
    }
    (folder / "sessions" / "P02.jsonl").write_text(json.dumps(line) + "\n")
    (folder / "trials" / "P02-1.jsonl").write_text('{"torn')
    capsys.readouterr()
    assert run("status", folder) == DONE
    shown = capsys.readouterr().out
    assert "questionnaire" in shown
    assert "0 of 2 participants done; trials: 3 not begun, 1 unfinished" in shown
    assert "problem: P02-1.jsonl: torn last line" in shown
    assert run("status", folder, "--json") == DONE
    document = json.loads(capsys.readouterr().out)
    assert [person["at"] for person in document["participants"]] == ["not begun", "questionnaire"]
    assert document["participants"][1]["trials"][1]["state"] == "unfinished"


def test_only_the_planners_defaults_are_a_loss(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An operator who does nothing is not late."""
    folder = tmp_path / "study"
    assert run("new", folder, "--teachers", 1) == DONE
    step = json.dumps({"type": "step", "action_source": "default", "press": False}) + "\n"
    for plan in StudyFolder(folder).participants[0].trials:
        StudyFolder(folder).log_of(plan).write_text(step * (3 if plan.controller == "planner" else 50))
    capsys.readouterr()
    assert run("status", folder) == DONE
    (row,) = [line for line in capsys.readouterr().out.splitlines() if "P01" in line]
    assert [cell.strip() for cell in row.split("│")][8] == "6"


def test_the_table_fits_a_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "study"
    assert run("new", folder, "--teachers", 2) == DONE
    capsys.readouterr()
    assert run("status", folder) == DONE
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 110
    assert not any("…" in line for line in lines)


def test_status_of_another_folder_is_bad_data(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("status", tmp_path) == BAD_DATA
    assert "is no folder of a study" in capsys.readouterr().err
    assert run("status", tmp_path / "nowhere") == USAGE
