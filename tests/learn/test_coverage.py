"""The study of coverage: how it counts, that it goes on where it stopped, and what it has shown."""

import csv
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from learn.coordinates import names_of, vector_of
from learn.coverage import TRUTH, Plan, coverage_rows, main, proportion_interval, run

RESULTS = Path(__file__).parents[2] / "notebooks" / "results"
SMALL = Plan(trials=4, seed=3, starts=1, methods=("wald",))


def test_hits_and_misses_on_either_side_and_open_ends_are_counted() -> None:
    ends: list[tuple[float | None, float | None]] = [
        (1.0, 1.5), (1.3, 1.5), (None, 1.1), (None, 2.0), (1.0, None), (1.25, None), (0.6, 2.4),
    ]  # fmt: skip
    rows = [{"m": {"that_mov.rise": [1.2, low, high]}} for low, high in ends]
    rows.append({"m": {}})
    (row,) = coverage_rows(rows, ["m"])
    assert (row["parameter"], row["truth"], row["studies"], row["intervals"]) == ("that_mov.rise", 1.2, 8, 7)
    assert row["coverage"] == pytest.approx(4 / 7, abs=1e-4)
    assert (row["all_above_truth"], row["all_below_truth"]) == (2, 1)
    assert (row["open_low"], row["open_high"]) == (2, 2)
    assert row["width"] == pytest.approx(1.5)


def test_the_interval_of_a_proportion_holds_it_about_as_often_as_it_says() -> None:
    hits = np.random.default_rng(0).binomial(200, 0.95, size=2000)
    ends = np.array([proportion_interval(int(n), 200) for n in hits])
    covered = ((ends[:, 0] <= 0.95) & (ends[:, 1] >= 0.95)).mean()
    assert 0.93 < covered < 0.97


def test_studies_are_those_of_their_seed_and_number() -> None:
    first, again, other = SMALL.study(0), SMALL.study(0), SMALL.study(1)
    assert first == again
    assert [trial.presses.tolist() for trial in first] != [trial.presses.tolist() for trial in other]
    assert [trial.condition for trial in first] == ["pomdp", "operator"] * 2
    assert [trial.participant_id for trial in first] == ["p0", "p0", "p1", "p1"]
    assert {trial.source for trial in first} == {"simulated"}


def test_teachers_differ_by_the_spread_about_the_truth_and_mistake_does_not() -> None:
    plan, rng = Plan(spread=0.2), np.random.default_rng(0)
    vectors = np.array([vector_of(plan.teacher(rng)) for _ in range(400)])
    truth = vector_of(TRUTH)
    logs = np.log(vectors[:, 1:10] / truth[1:10])
    np.testing.assert_allclose(logs.mean(axis=0), 0, atol=0.04)
    np.testing.assert_allclose(logs.std(axis=0), 0.2, atol=0.02)
    assert (vectors[:, 0] == truth[0]).all()
    assert vector_of(Plan().teacher(rng)).tolist() == truth.tolist()


def test_a_run_that_was_stopped_goes_on_and_comes_to_the_same(tmp_path: Path) -> None:
    arguments = ["--trials", "4", "--seed", "3", "--methods", "wald", "--out"]
    whole, parts = tmp_path / "whole.csv", tmp_path / "new" / "parts.csv"
    assert main(["--studies", "2", *arguments, str(whole)]) == 0
    assert main(["--studies", "1", *arguments, str(parts)]) == 0
    before = parts.with_suffix(".jsonl").read_text(encoding="utf-8")
    assert main(["--studies", "2", *arguments, str(parts)]) == 0
    assert parts.with_suffix(".jsonl").read_text(encoding="utf-8").startswith(before)
    assert parts.read_text(encoding="utf-8") == whole.read_text(encoding="utf-8")
    with pytest.raises(ValueError, match="kept of another run"):
        run(Plan(trials=6), 1, parts)


def kept(name: str) -> list[Mapping[str, str]]:
    with (RESULTS / name).open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_the_kept_table_is_that_of_the_kept_studies() -> None:
    lines = (RESULTS / "coverage.jsonl").read_text(encoding="utf-8").splitlines()
    about, rows = json.loads(lines[0]), [json.loads(line) for line in lines[1:]]
    assert about["simulated"] is True
    assert sorted(row["study"] for row in rows) == list(range(len(rows)))
    expected: list[dict[str, Any]] = coverage_rows(rows, about["plan"]["methods"])
    assert kept("coverage.csv") == [{key: str(value) for key, value in row.items()} for row in expected]
    truth = dict(zip(names_of(list(TRUTH.approvals)), vector_of(TRUTH), strict=True))
    assert {row["parameter"] for row in expected} <= set(truth)
