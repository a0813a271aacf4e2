"""Cue tables on the command line: fit and validate."""

import json
import re
from pathlib import Path

import pytest

from learn import Population
from taskcomm.cli import main
from taskcomm.cueworld import CueWorld, intuitive_for
from taskcomm.teacher import TableTop, TeacherModel

DONE, USAGE, BAD_DATA, NOT_CONVERGED = 0, 2, 3, 4
LIGHTS = Path(__file__).parents[1] / "datasets" / "cue-table-example" / "lights.csv"


@pytest.fixture
def table(tmp_path: Path) -> Path:
    """The first fifty steps of the first four trials, of two people."""
    wanted = r"trial_id|p0[12]-\d,p0\d,simulated,0.5,[1-4]?\d,"
    first = [line for line in LIGHTS.read_text().splitlines() if re.match(wanted, line)]
    path = tmp_path / "cues.csv"
    path.write_text("\n".join(first) + "\n")
    return path


def run(*arguments: object) -> int:
    return main([str(argument) for argument in arguments])


def test_fit_writes_a_model_and_sets_it_beside_other_accounts(
    table: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, figure = table.with_name("model.json"), table.with_name("cues.png")
    before = table.read_bytes()
    fast = ("--starts", 1, "--intervals", "none", "--folds", 2, "--jobs", 1, "--longest", 3)
    assert run("fit", table, "--out", out, "--figure", figure, *fast) == DONE
    shown = capsys.readouterr().out
    for account in ("constant probability", "intuitive table-top", "fitted table-top", "with decay"):
        assert account in shown
    assert "4 trials (simulated); held out by person" in shown
    model = TeacherModel.load(out)
    assert model.provenance["settings"]["bounds"]["rise"] == 3  # --longest
    assert model.mental_states == ("waiting", "mistake", "that_left", "that_right")
    assert figure.read_bytes().startswith(b"\x89PNG")
    numbers = table.with_name("cues-numbers.csv").read_text()
    assert numbers.startswith("cue,account,seconds,share,low,high\n")
    assert table.read_bytes() == before
    assert sorted(path.name for path in table.parent.iterdir()) == [
        "cues-numbers.csv",
        "cues.csv",
        "cues.png",
        "model.json",
        "model.json.run.json",
    ]


def test_parquet_gives_the_same_fit_as_csv(table: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from pyarrow import csv, parquet

    parquet.write_table(csv.read_csv(table), table.with_suffix(".parquet"))
    found = []
    for path in (table, table.with_suffix(".parquet")):
        fast = ("--starts", 1, "--intervals", "none", "--folds", 0, "--json")
        assert run("fit", path, "--out", table.with_name("model.json"), *fast) == DONE
        found.append(json.loads(capsys.readouterr().out))
    assert found[0] == found[1]
    assert "comparison" not in found[0]


def test_a_model_file_says_which_cue_drives_which_state(
    table: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    start = TeacherModel(0.005, {"approves": TableTop("right", 0.1, 2.0, 2.0)})
    start.save(table.with_name("start.json"))
    out = table.with_name("model.json")
    fast = ("--starts", 1, "--intervals", "none", "--folds", 2, "--jobs", 1, "--json")
    assert run("fit", table, "--initial", table.with_name("start.json"), "--out", out, *fast) == DONE
    assert TeacherModel.load(out).approvals["approves"].cue == "right"
    accounts = json.loads(capsys.readouterr().out)["comparison"]["accounts"]
    assert [row["account"] for row in accounts][1:3] == ["intuitive table-top", "initial table-top"]


def test_validate_names_every_problem_of_logs_and_tables_together(
    table: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("validate", table) == DONE
    assert "1 file, 4 trials, 200 steps: 0 problems" in capsys.readouterr().out
    log = table.with_name("log.jsonl")
    log.write_text("{}\n")
    lines = table.read_text().splitlines()
    lines[1] = lines[1].replace(",0,0,0,0", ",0,maybe,0,0")
    table.write_text("\n".join(lines) + "\n")
    assert run("validate", log, table, "--json") == BAD_DATA
    problems = json.loads(capsys.readouterr().out)["problems"]
    assert len(problems) == 2
    assert "log.jsonl:1: " in problems[0]
    assert re.search(r"cues\.csv:2: column 'press': must be 0 or 1, not 'maybe'", problems[1])


def test_a_step_length_is_taken_from_the_command_where_the_table_has_none(
    table: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table.write_text(table.read_text().replace(",dt,", ",").replace(",0.5,", ","))
    assert run("validate", table) == BAD_DATA
    assert "give it in seconds, as a column 'dt' or with --dt" in capsys.readouterr().out
    assert run("validate", table, "--dt", 0.2) == DONE
    out = table.with_name("model.json")
    assert (
        run("fit", table, "--dt", 0.2, "--starts", 1, "--intervals", "none", "--folds", 0, "--out", out)
        == DONE
    )
    assert TeacherModel.load(out).dt == 0.2


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (("cues.csv", "other.jsonl"), "is a cue table, .*other.jsonl is not: give one kind at a time"),
        (("other.jsonl", "--dt", "0.1"), "is for cue tables"),
        (("other.jsonl", "--figure", "a.png"), "is for cue tables"),
        (("cues.csv", "--figure", "a.gif"), "a.gif: must end in .png, .svg, .pdf"),
        (("cues.csv", "--figure", "a.png", "--folds", "0"), "--folds must be 2 or more"),
        (("a-numbers.csv", "--figure", "a.png"), "its numbers would overwrite a-numbers.csv"),
        (("cues.csv", "--task-unknown"), "a cue table has no tasks"),
    ],
)
def test_what_does_not_go_together_is_a_usage_error_at_once(
    table: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: tuple[str, ...],
    reason: str,
) -> None:
    monkeypatch.chdir(table.parent)
    monkeypatch.setenv("COLUMNS", "300")
    for name in ("other.jsonl", "a-numbers.csv"):
        Path(name).write_bytes(table.read_bytes())
    assert run("fit", *arguments, "--out", "model.json") == USAGE
    assert re.search(reason, capsys.readouterr().err)
    assert not Path("model.json").exists()


def test_a_model_of_another_step_or_other_cues_is_bad_data(
    table: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    start, out = table.with_name("start.json"), table.with_name("model.json")
    intuitive_for(CueWorld(("left", "up")), 0.5).save(start)
    assert run("fit", table, "--initial", start, "--out", out) == BAD_DATA
    assert "unknown cue 'up'; this world has left, right" in capsys.readouterr().err
    intuitive_for(CueWorld(("left",)), 0.1).save(start)
    assert run("fit", table, "--initial", start, "--out", out) == BAD_DATA
    assert "--convert-dt converts it" in capsys.readouterr().err


def test_a_trial_with_too_many_presses_is_named_with_its_place_and_the_way_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cues = [f"cue{n}" for n in range(4)]
    rows = [",".join(["trial_id", "t", "press", *cues])]
    for t in range(48):
        shown = [str((t // (3 + n)) % 2) for n in range(4)]
        rows.append(",".join(["a", str(t), str(int(t % 3 == 2)), *shown]))
    table, out = tmp_path / "dense.csv", tmp_path / "model.json"
    table.write_text("\n".join(rows) + "\n")
    fast = ("--dt", 0.5, "--starts", 1, "--folds", 0, "--intervals", "none", "--out", out)
    assert run("fit", table, *fast) == BAD_DATA
    told = capsys.readouterr().err
    assert re.search(
        r"trial a: more than 20000 memories .* shorter bounds .* \(trial a is at .*dense.csv:2\)", told
    )


def test_one_person_cannot_be_compared_and_the_way_out_is_named(
    table: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = [line for line in table.read_text().splitlines() if line.startswith(("trial_id", "p01"))]
    table.write_text("\n".join(own) + "\n")
    out = table.with_name("model.json")
    fast = ("--starts", 1, "--intervals", "none", "--longest", 3)
    assert run("fit", table, "--out", out, *fast) == BAD_DATA
    assert "--folds 0" in capsys.readouterr().err
    assert not out.exists()
    assert run("fit", table, "--out", out, "--folds", 0, *fast) == DONE


@pytest.mark.parametrize("command", ["compare", "replay"])
def test_what_needs_a_world_refuses_a_cue_table_in_one_sentence(
    command: str, table: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = table.with_name("out.png" if command == "replay" else "out")
    assert run(command, table, "--out", out) == BAD_DATA
    told = capsys.readouterr().err
    assert told.startswith(f"error: {table}: a cue table has no world")
    assert told.count("\n") == 1
    assert not out.exists()


def test_structure_keeps_to_the_longest_rise_and_fall_and_says_where_the_initial_model_is_beyond(
    table: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = table.with_name("model.json")
    fast = ("--starts", 1, "--folds", 2, "--rest", 0, "--thorough", 1)
    assert run("structure", table, "--out", out, *fast, "--longest", 3) in (DONE, NOT_CONVERGED)
    assert "--longest" not in capsys.readouterr().err
    model = TeacherModel.load(out)
    assert model.provenance["settings"]["bounds"]["rise"] == 3
    assert max(time for top in model.approvals.values() for time in (top.rise, top.fall)) <= 3 + 1e-9
    run("fit", table, "--out", out, "--starts", 1, "--intervals", "none", "--folds", 0, "--longest", 1.5)
    told = capsys.readouterr().err
    assert "--longest 1.5: the initial model has that_left.rise = 2 s" in told


def test_a_population_takes_a_cue_table_with_decays(table: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = table.with_name("population.json")
    quick = ("--starts", 1, "--draws", 20, "--rounds", 2, "--longest", 3, "--decays")
    assert run("population", table, "--out", out, *quick) == NOT_CONVERGED
    assert "2 teachers" in capsys.readouterr().out
    found = Population.load(out)
    names = [each.name for each in found.common]
    assert {"that_left.decay", "that_right.decay"} <= set(names)
    assert all(0 <= share <= 1 for teacher in found.teachers for share in teacher.own_share)
    assert max(top.rise for top in found.model.approvals.values()) <= 3 + 1e-9
    assert run("population", table, "--out", out, "--dt", "nonsense") == USAGE
