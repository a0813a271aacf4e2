"""taskcomm study export: the data set holds the study, keeps the standards' rules, and nothing private."""

import csv
import io
import json
import shutil
import subprocess
import sys
import warnings
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import psychdsrules
import pytest
from finishedstudy import DECLINED, finished
from hypothesis import given
from hypothesis import strategies as st
from logsamples import trials as any_trial
from ratedstudy import unrated

from taskcomm.cli import main
from taskcomm.datapackage import datapackage
from taskcomm.logs import read_trials, validate
from taskcomm.psychds import FILE_NAME, description, file_of
from taskcomm.tables import Column, Table
from taskcomm.trials import Trial
from taskcomm.trialtables import trial_tables
from taskcomm.web.study.folder import StudyFolder

DONE, FAILED, BAD_DATA = 0, 1, 3
NAMES = ("participants", "answers", "trials", "steps", "presses", "labels", "ratings", "events")


def export(folder: Path, out: Path) -> int:
    return main(["study", "export", str(folder), "--out", str(out)])


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> StudyFolder:
    return finished(tmp_path_factory.mktemp("studies") / "study")


@pytest.fixture(scope="module")
def dataset(study: StudyFolder) -> Path:
    out = study.path.parent / "out" / "data-set"
    assert export(study.path, out) == DONE
    return out


@pytest.fixture
def copy(dataset: Path, tmp_path: Path) -> Path:
    return shutil.copytree(dataset, tmp_path / "copy")


def rows_of(dataset: Path, table: str) -> list[dict[str, str]]:
    path = dataset / "data" / f"study-twoWays_description-{table}_data.csv"
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def json_of(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


def bytes_of(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()
    }


def edited(path: Path, change: Callable[[Any], Any]) -> None:
    document = json_of(path)
    change(document)
    path.write_text(json.dumps(document), encoding="utf-8")


def test_an_export_keeps_the_rules_of_psych_ds(dataset: Path) -> None:
    assert psychdsrules.problems(dataset) == set()


BREAKS: dict[str, Callable[[Path], Any]] = {
    "MISSING_DATASET_DESCRIPTION": lambda root: (root / "dataset_description.json").unlink(),
    "JSON_INVALID": lambda root: (root / "dataset_description.json").write_text("{"),
    "JSON_KEY_REQUIRED": lambda root: edited(
        root / "dataset_description.json", lambda d: d.pop("description")
    ),
    "INCORRECT_DATASET_TYPE": lambda root: edited(
        root / "dataset_description.json", lambda d: d.update({"@type": "Thing"})
    ),
    "CSV_COLUMN_MISSING_FROM_METADATA": lambda root: edited(
        root / "dataset_description.json", lambda d: d["variableMeasured"].pop(3)
    ),
    "FILENAME_KEYWORD_FORMATTING_ERROR": lambda root: (root / "data" / "study-two-ways_data.csv").write_text(
        "row_id\n"
    ),
    "FILENAME_UNOFFICIAL_KEYWORD_WARNING": lambda root: (root / "data" / "desc-a_data.csv").write_text(
        "row_id\n"
    ),
    "CSV_HEADER_LENGTH_MISMATCH": lambda root: (root / "data" / "study-a_data.csv").write_text(
        "row_id\n1,2\n"
    ),
    "ROWID_VALUES_NOT_UNIQUE": lambda root: (root / "data" / "study-a_data.csv").write_text("row_id\n1\n1\n"),
    "MISSING_DATA_DIRECTORY": lambda root: shutil.rmtree(root / "data"),
}


@pytest.mark.parametrize("code", BREAKS)
def test_a_broken_rule_of_psych_ds_is_seen(copy: Path, code: str) -> None:
    BREAKS[code](copy)
    assert code in psychdsrules.problems(copy)


def test_every_column_is_described_once_and_every_description_has_its_column(dataset: Path) -> None:
    variables = json_of(dataset / "dataset_description.json")["variableMeasured"]
    names = [variable["name"] for variable in variables]
    columns = {name for table in NAMES for row in rows_of(dataset, table) for name in row}
    assert sorted(names) == sorted(columns)
    assert all(variable["@type"] == "PropertyValue" and variable["description"] for variable in variables)
    familiarity = next(variable for variable in variables if variable["name"] == "answer_familiarity")
    assert familiarity["description"].startswith("Answer to: ")


READ: dict[str, Callable[[str], Any]] = {
    "string": str,
    "integer": int,
    "number": float,
    "boolean": {"true": True, "false": False}.__getitem__,
    "datetime": datetime.fromisoformat,
}


def test_every_value_is_of_its_type_keys_tell_rows_apart_and_references_lead_somewhere(dataset: Path) -> None:
    package = json_of(dataset / "datapackage.json")
    assert tuple(resource["name"] for resource in package["resources"]) == NAMES
    for resource in package["resources"]:
        text = (dataset / resource["path"]).read_text(encoding="utf-8")
        assert breaches(text, resource["schema"]) == []
        for reference in resource["schema"].get("foreignKeys", ()):
            (column,), (there,) = reference["fields"], reference["reference"]["fields"]
            known = {row[there] for row in rows_of(dataset, reference["reference"]["resource"])}
            assert {row[column] for row in rows_of(dataset, resource["name"])} <= known


def breaches(text: str, schema: dict[str, Any]) -> list[str]:
    """Where a table breaks its schema, each a line; READ raises for a value that is not of its type."""
    header, *rest = csv.reader(io.StringIO(text, newline=""))
    rows = [dict(zip(header, row, strict=True)) for row in rest]
    found = [] if [field["name"] for field in schema["fields"]] == header else ["header"]
    for field in schema["fields"]:
        name, limits = field["name"], field.get("constraints", {})
        values = {row[name] for row in rows}
        for value in values - {""}:
            READ[field["type"]](value)
        found += [f"{name}: empty"] if limits.get("required") and "" in values else []
        found += [f"{name}: {value}" for value in values - {"", *limits.get("enum", values)}]
    keys = [tuple(row[name] for name in schema["primaryKey"]) for row in rows]
    return found + ([] if len(set(keys)) == len(keys) else ["key"])


@given(st.lists(any_trial(), max_size=3, unique_by=lambda trial: trial.trial_id))
def test_whatever_trials_come_their_tables_keep_their_schemas(trials: list[Trial]) -> None:
    tables = trial_tables(trials)
    schemas = {
        one["name"]: one["schema"]
        for one in datapackage("n", "t", "d", tables, dict.fromkeys(NAMES, ""))["resources"]
    }
    for table in tables:
        assert breaches(table.csv().decode(), schemas[table.name]) == []
    assert {row["name"] for row in description("n", "d", tables)["variableMeasured"]} >= {
        "row_id",
        "trial_id",
    }


def valid_package(dataset: Path) -> Any:
    """What the validator of Frictionless reports."""
    command = [sys.executable, "-W", "ignore", "-m", "frictionless", "validate", "datapackage.json", "--json"]
    done = subprocess.run(command, cwd=dataset, capture_output=True, text=True, check=False)
    return json.loads(done.stdout)


def test_frictionless_finds_the_package_valid(dataset: Path) -> None:
    report = valid_package(dataset)
    assert report["valid"], report
    assert [task["name"] for task in report["tasks"]] == list(NAMES)
    assert sum(task["stats"]["rows"] for task in report["tasks"]) == sum(
        len(rows_of(dataset, n)) for n in NAMES
    )


def test_the_tables_say_what_the_logs_say(study: StudyFolder, dataset: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        logs = [
            path
            for path in (study.trials_dir, study.practice_dir)
            for path in path.iterdir()
            if path.stat().st_size
        ]
        trials = {trial.trial_id: trial for trial in read_trials(logs)}
    steps, table = rows_of(dataset, "steps"), {row["trial_id"]: row for row in rows_of(dataset, "trials")}
    assert table.keys() == trials.keys()
    for name, trial in trials.items():
        of = [row for row in steps if row["trial_id"] == name]
        assert [row["action"] for row in of] == [str(action) for action in trial.actions]
        assert [row["press"] == "true" for row in of] == trial.presses.tolist()
        assert [int(row["held"] or 0) for row in of] == [state.held or 0 for state in trial.states]  # type: ignore[attr-defined]
        row = table[name]
        assert int(row["num_steps"]) == trial.num_steps == len(of)
        assert row["correct"] == str(trial.correct).lower()
        assert row["practice"] == str("practice" in name).lower()
        presses = [one for one in rows_of(dataset, "presses") if one["trial_id"] == name]
        assert len(presses) == int(trial.presses.sum()) == int(row["num_presses"])
        reasons = {int(one["t"]): one["label"] for one in presses if one["label"]}
        assert reasons == {t: state for t, state in trial.reasons.items() if t in trial.labelled}
        assert row["num_resumed"] == "1"
    ratings = [row for row in rows_of(dataset, "ratings") if row["item"] == "intelligence"]
    assert {(row["number"], row["low"], row["high"]) for row in ratings} <= {
        ("8", "1", "10"),
        ("9", "1", "10"),
    }
    pressed = next(row for row in rows_of(dataset, "presses") if row["key_events"])
    assert (pressed["client_time"], pressed["num_annotators"]) == ("1700000000000.0", "2")


def test_a_key_event_that_names_no_step_is_of_the_step_in_which_it_stands_in_the_log() -> None:
    trial = unrated()[0]
    first, second = (int(t) for t in trial.presses.nonzero()[0][:2])
    at = {"kind": "press", "n": 1, "at": 7.0}
    events = [{**at, "seq": 1 + first}, {**at, "seq": 2 + first, "at": 8.0}, {**at, "seq": 3 + second}]
    (rows,) = (
        table.rows
        for table in trial_tables([replace(trial, events=tuple(events))])
        if table.name == "presses"
    )
    assert [(row["t"], row.get("key_events"), row.get("client_time")) for row in rows][:2] == [
        (first, 2, 7.0), (second, 1, 7.0)
    ]  # fmt: skip
    assert all("key_events" not in row for row in rows[2:])


def test_the_raw_logs_are_kept_byte_for_byte_and_are_valid_logs(study: StudyFolder, dataset: Path) -> None:
    raw = dataset / "data" / "primary_data"
    kept = bytes_of(raw)
    assert kept == {name: (study.path / name).read_bytes() for name in kept}
    assert {path.name for path in (raw / "trials").iterdir()} == {
        path.name for path in study.trials_dir.iterdir() if not path.name.startswith(DECLINED)
    }
    assert validate(raw / "trials").ok


def test_nothing_private_is_exported_nor_needed(study: StudyFolder, dataset: Path, tmp_path: Path) -> None:
    tokens = [token for of_role in study.tokens.values() for token in of_role.values()]
    assert len(tokens) >= 6
    content = bytes_of(dataset)
    for name, data in content.items():
        assert not any(token.encode() in data for token in tokens), name
        assert b"private" not in data, name
        assert str(study.path).encode() not in data, name
    moved = shutil.copytree(study.path, tmp_path / "moved")
    shutil.rmtree(moved / "private")
    (moved / "server.jsonl").unlink()
    assert export(moved, tmp_path / "again") == DONE
    assert bytes_of(tmp_path / "again") == content


def test_of_who_declined_nothing_but_the_place_in_the_study_is_there(dataset: Path) -> None:
    rows = {row["participant_id"]: row for row in rows_of(dataset, "participants")}
    assert {name for name, value in rows[DECLINED].items() if value} == {
        "row_id", "participant_id", "operator_id", "consent", "consent_version", "trials_planned", "source"
    }  # fmt: skip
    assert rows[DECLINED]["consent"] == "false"
    assert rows["P01"]["answer_age"] == "22"
    for name, data in bytes_of(dataset).items():
        assert DECLINED not in name
        if name.startswith("data/") and "participants" not in name:
            assert DECLINED.encode() not in data, name


def test_who_made_a_data_set_is_said_in_both_descriptions(study: StudyFolder, tmp_path: Path) -> None:
    out = tmp_path / "out"
    said = ["--author", "Ada", "--author", "Bo", "--license", "CC-BY-4.0", "--citation", "Ada and Bo (2026)"]
    assert main(["study", "export", str(study.path), "--out", str(out), *said]) == DONE
    metadata, package = json_of(out / "dataset_description.json"), json_of(out / "datapackage.json")
    assert [(one["@type"], one["name"]) for one in metadata["author"]] == [
        ("Person", "Ada"),
        ("Person", "Bo"),
    ]
    assert (metadata["license"], metadata["citation"]) == ("CC-BY-4.0", "Ada and Bo (2026)")
    assert [one["title"] for one in package["contributors"]] == ["Ada", "Bo"]
    assert package["licenses"] == [{"name": "CC-BY-4.0"}]
    assert psychdsrules.problems(out) == set()
    assert valid_package(out)["valid"]


def test_a_simulated_study_is_called_simulated_wherever_it_is_described(tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert export(finished(tmp_path / "study", simulated=True).path, out) == DONE
    metadata, package = json_of(out / "dataset_description.json"), json_of(out / "datapackage.json")
    for text in (
        metadata["description"],
        package["description"],
        (out / "README.md").read_text(encoding="utf-8"),
    ):
        assert "SIMULATED: the teachers are programs, no person took part." in text
    assert "simulated" in metadata["name"]
    assert {row["source"] for row in rows_of(out, "trials")} == {"simulated"}
    presses = rows_of(out, "presses")
    assert {row["true_state"] for row in presses} > {"mistake", "that_mov"}
    labels = {(row["num_annotators"], row["label"]) for row in presses}
    assert labels == {("0", ""), ("2", "that_mov")}
    assert psychdsrules.problems(out) == set()


def test_an_export_replaces_itself_and_keeps_what_somebody_laid_beside_it(
    study: StudyFolder, copy: Path
) -> None:
    (copy / "analysis").mkdir()
    (copy / "analysis" / "mine.R").write_text("1\n", encoding="utf-8")
    before = bytes_of(copy)
    assert export(study.path, copy) == DONE
    assert bytes_of(copy) == before
    assert [path.name for path in copy.parent.iterdir()] == ["copy"]


def test_what_was_changed_or_is_no_export_is_left_as_it_was(
    study: StudyFolder, copy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with (copy / "README.md").open("a", encoding="utf-8") as file:
        file.write("By me.\n")
    before = bytes_of(copy)
    assert export(study.path, copy) == FAILED
    assert "README.md was changed since it was exported" in capsys.readouterr().err
    assert bytes_of(copy) == before
    other = tmp_path / "other"
    other.mkdir()
    (other / "thesis.tex").write_text("x", encoding="utf-8")
    assert export(study.path, other) == FAILED
    assert "no export of a study; name another folder" in capsys.readouterr().err
    assert [path.name for path in other.iterdir()] == ["thesis.tex"]
    before = bytes_of(study.path)
    assert export(study.path, study.path) == FAILED
    assert bytes_of(study.path) == before
    assert {path.name for path in tmp_path.iterdir()} == {"copy", "other"}


def test_what_was_lost_is_said_and_a_folder_that_is_no_study_is_an_error(
    study: StudyFolder, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert export(study.path, tmp_path / "out") == DONE
    said = capsys.readouterr().err
    assert "P03-2.jsonl" in said
    assert "torn last line, dropped" in said
    assert export(tmp_path / "out", tmp_path / "other") == BAD_DATA
    assert "is no folder of a study" in capsys.readouterr().err
    assert not (tmp_path / "other").exists()


cells = st.none() | st.booleans() | st.integers() | st.text(st.characters(exclude_characters="\r\0"))


@given(st.lists(st.tuples(cells, cells), max_size=4))
def test_a_table_reads_as_it_was_written(rows: list[tuple[Any, Any]]) -> None:
    columns = (Column("a", "string", "A"), Column("b", "string", "B"))
    text = (
        Table("t", "T", columns, [dict(zip("ab", row, strict=True)) for row in rows], ("a",)).csv().decode()
    )

    def cell(value: Any) -> str:
        return "" if value is None else str(value).lower() if isinstance(value, bool) else str(value)

    wanted = [[str(number), *map(cell, row)] for number, row in enumerate(rows, 1)]
    assert list(csv.reader(io.StringIO(text, newline=""))) == [["row_id", "a", "b"], *wanted]


def test_a_name_has_one_meaning_a_row_known_columns_and_a_file_a_legal_name() -> None:
    one = Table("one", "", (Column("a", "string", "This"),), [], ("a",))
    other = Table("other", "", (Column("a", "string", "That"),), [], ("a",))
    with pytest.raises(ValueError, match="column 'a' has two meanings"):
        description("n", "d", [one, other])
    with pytest.raises(ValueError, match="no column is called 'b'"):
        Table("one", "", (Column("a", "string", "This"),), [{"b": 1}], ("a",))
    for study in ("a", "my-first_study 2", "ü", "-"):
        assert FILE_NAME.fullmatch(file_of(one, study).removeprefix("data/"))
