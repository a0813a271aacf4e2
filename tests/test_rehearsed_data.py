"""A study rehearsed over its sockets, then exported and drawn: the data set holds what was logged."""

import asyncio
import csv
import json
import subprocess
import sys
from pathlib import Path

import psychdsrules
import pytest
from web.rehearsing import run_through, study

from taskcomm.cli import main
from taskcomm.logs import read_trials, validate
from taskcomm.web.rehearsal import Rehearsal
from taskcomm.web.study.folder import StudyFolder

pytestmark = pytest.mark.verify


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> StudyFolder:
    path = tmp_path_factory.mktemp("rehearsed") / "study"
    return run_through(study(path, 3, operators=2, practice="pomdp"), after=labelled).folder


def labelled(rehearsal: Rehearsal) -> None:
    asyncio.run(rehearsal.label())


def table(dataset: Path, name: str) -> list[dict[str, str]]:
    (path,) = (dataset / "data").glob(f"*description-{name}_data.csv")
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_a_rehearsed_study_is_a_data_set_by_both_standards(folder: StudyFolder, tmp_path: Path) -> None:
    out = tmp_path / "data-set"
    assert main(["study", "export", str(folder.path), "--out", str(out)]) == 0
    assert psychdsrules.problems(out) == set()
    command = [sys.executable, "-W", "ignore", "-m", "frictionless", "validate", "datapackage.json", "--json"]
    done = subprocess.run(command, cwd=out, capture_output=True, text=True, check=False)
    assert json.loads(done.stdout)["valid"]
    raw = out / "data" / "primary_data"
    assert validate([raw / "trials", raw / "practice"]).ok
    trials = {trial.trial_id: trial for trial in read_trials([raw / "trials", raw / "practice"])}
    assert {row["trial_id"]: int(row["num_steps"]) for row in table(out, "trials")} == {
        name: trial.num_steps for name, trial in trials.items()
    }
    presses = table(out, "presses")
    assert {(row["trial_id"], int(row["t"])): row["label"] for row in presses if row["label"]} == {
        (name, t): state for name, trial in trials.items() for t, state in trial.reasons.items()
    }
    assert all(int(row["key_events"]) >= 1 for row in presses)
    assert len(table(out, "answers")) == 2 * 3
    assert "" not in {row["answer_age"] for row in table(out, "participants")}
    assert len(table(out, "ratings")) == 2 * 6


def test_every_figure_of_a_rehearsed_study_is_made(folder: StudyFolder, tmp_path: Path) -> None:
    assert main(["figures", str(folder.path), "--out", str(tmp_path / "out")]) == 0
    captions = json.loads((tmp_path / "out" / "captions.json").read_text(encoding="utf-8"))
    assert set(captions) >= {
        "task-marginals", "inference-of-mental-state", "ratings-intelligence", "time-to-final", "entropy"
    }  # fmt: skip
    assert all("simulated" in caption for caption in captions.values())
    assert "true reasons as labelled by simulated" in captions["inference-of-mental-state"]
    assert "3 simulated trials with the planner" in captions["entropy"]
