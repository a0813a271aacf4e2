"""`taskcomm fit`, as a user meets it: table, certificate, audit, intervals; as text, JSON and model file."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from taught import by_hand, operator_trials, teacher

from learn import FitResult
from learn.certainty import uncertainty
from learn.coordinates import vector_of
from learn.intervals import Uncertainty
from taskcomm.cli import BAD_DATA, DONE, NOT_CONVERGED, USAGE, main
from taskcomm.commands import fitted
from taskcomm.logs import write_trials
from taskcomm.teacher import TeacherModel


def run(*arguments: object) -> int:
    return main([str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("logs") / "trials.jsonl"
    write_trials(operator_trials(6, teacher(peaks=(0.3, 0.3, 0.2))), path)
    return path


def test_a_fit_is_told_with_intervals_verdicts_and_certificate_in_a_width_of_110(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "m.json"
    assert run("fit", log, "--starts", 2, "--jobs", 1, "--out", out) == DONE
    said = capsys.readouterr().out
    table = [line for line in said.splitlines() if line.startswith(("┃", "│"))]
    assert max(map(len, table)) <= 110
    for column in ("parameter", "intuitive", "learned", "95% interval", "presses", "steps", "data", "mark"):
        assert column in table[0]
    assert "informed" in said
    certificate = said[said.index("Certificate") :]
    assert "may be trusted" in certificate
    assert "EM alone reached" in certificate
    assert "steepest one-sided slope" in certificate
    note = TeacherModel.load(out).provenance
    assert note["certificate"]["trusted"] is True
    assert note["uncertainty"]["level"] == 0.95
    assert note["audit"]["mistake"]["verdict"] in ("informed", "weak")


def test_json_has_certificate_audit_and_intervals(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ("--starts", 1, "--intervals", "wald", "--jobs", 1, "--out", tmp_path / "m.json", "--json")
    assert run("fit", log, *options) == DONE
    document: dict[str, Any] = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    assert document["certificate"]["kind"] in ("converged", "at a bound")
    assert document["uncertainty"]["method"] == "wald"
    rows = {row["parameter"]: row for row in document["parameters"]}
    assert rows["mistake"]["low"] < rows["mistake"]["learned"] < rows["mistake"]["high"]
    assert rows["mistake"]["interval"] == "wald"
    assert document["audit"]["mistake"]["verdict"] == rows["mistake"]["verdict"]
    kept = TeacherModel.load(tmp_path / "m.json").provenance
    assert kept["certificate"] == document["certificate"]
    assert kept["audit"] == document["audit"]


def test_no_intervals_where_none_are_asked_for(log: Path, tmp_path: Path) -> None:
    out = tmp_path / "m.json"
    assert run("fit", log, "--starts", 1, "--intervals", "none", "--out", out) == DONE
    assert "uncertainty" not in TeacherModel.load(out).provenance


def test_shared_decays_are_one_and_shared_without_anything_to_share_is_a_usage_error(
    log: Path, tmp_path: Path
) -> None:
    out = tmp_path / "m.json"
    options = ("--starts", 1, "--intervals", "none", "--out", out)
    assert run("fit", log, "--decays", "--shared", *options) == DONE
    assert len({top.decay for top in TeacherModel.load(out).approvals.values()}) == 1
    assert TeacherModel.load(out).provenance["settings"]["decays"] == "shared"
    assert run("fit", log, "--shared", *options) == USAGE


def test_a_degenerate_fit_ends_with_4_and_says_why(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    silent, out = tmp_path / "silent.jsonl", tmp_path / "m.json"
    write_trials([by_hand(["light_on(1)", *["noa"] * 12], presses=[])], silent)
    assert run("fit", silent, "--starts", 1, "--out", out) == NOT_CONVERGED
    said = capsys.readouterr()
    assert "NOT TO BE TRUSTED: degenerate (no press in any trial" in said.out
    assert "degenerate: no press in any trial" in said.err
    assert TeacherModel.load(out).provenance["certificate"]["trusted"] is False


def test_a_bootstrap_of_one_teacher_is_one_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    alone, out = tmp_path / "alone.jsonl", tmp_path / "m.json"
    write_trials([by_hand(["light_on(1)", *["noa"] * 20], presses=[5, 9, 16])], alone)
    assert run("fit", alone, "--starts", 1, "--intervals", "bootstrap", "--out", out) == BAD_DATA
    assert "error: --intervals bootstrap: " in capsys.readouterr().err
    assert not out.exists()


def test_a_prior_of_many_trials_holds_the_fit_to_the_initial_model_and_says_so(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "m.json"
    options = ("--starts", 1, "--intervals", "none", "--prior-trials", 1e5, "--out", out)
    assert run("fit", log, *options) == DONE
    assert "prior: the initial model, as 100000 trials would hold it" in capsys.readouterr().out
    assert TeacherModel.load(out).approvals["that_mov"].peak == pytest.approx(0.1, rel=0.05)
    assert TeacherModel.load(out).provenance["settings"]["prior"]["trials"] == 1e5
    assert run("fit", log, "--prior-trials", -1, "--out", out) == USAGE


def test_what_is_known_of_a_fitted_model_is_said_wherever_it_is_used(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lit, out = tmp_path / "lit.jsonl", tmp_path / "m.json"
    write_trials([by_hand(["light_on(1)", *["noa"] * 20], presses=[5, 9, 16])], lit)
    options = ("--starts", 1, "--intervals", "none")
    assert run("fit", lit, *options, "--out", out) == DONE
    assert run("replay", lit, "--model", out) == DONE
    said = capsys.readouterr().err
    assert f"note: {out}: fitted without data on " in said
    assert "that_wrt.peak" in said
    assert run("fit", log, *options, "--max-iter", 1, "--out", out) == NOT_CONVERGED
    assert run("fit", log, *options, "--initial", out, "--out", tmp_path / "n.json") == DONE
    assert f"warning: {out}: its fit is not to be trusted: not converged" in capsys.readouterr().err


def test_the_errors_of_the_key_are_learned_where_asked_for(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "m.json"
    options = ("--starts", 1, "--intervals", "none", "--observe", "false_press", "--out", out)
    assert run("fit", log, *options) in (DONE, NOT_CONVERGED)
    assert "observed: false_press: " in capsys.readouterr().out
    assert 0 < TeacherModel.load(out).observation.false_press < 0.1


def test_what_memories_left_out_may_cost_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    trials = [replace(trial, steps=trial.steps[:40]) for trial in operator_trials(3, teacher())]
    holes = [
        replace(
            trial,
            steps=tuple(replace(s, pressed=None) if t % 3 == 0 else s for t, s in enumerate(trial.steps)),
        )
        for trial in trials
    ]
    log, out = tmp_path / "holes.jsonl", tmp_path / "m.json"
    write_trials(holes, log)
    options = ("--starts", 1, "--intervals", "none", "--longest", 2, "--out", out)
    assert run("fit", log, *options, "--dropped-mass", 1e-4, "--json") in (DONE, NOT_CONVERGED)
    document = json.loads(capsys.readouterr().out)
    assert 0 < document["dropped"] < 5
    assert TeacherModel.load(out).provenance["settings"]["dropped_mass"] == 1e-4
    assert run("fit", log, *options, "--dropped-mass", 1e-4) in (DONE, NOT_CONVERGED)
    assert "left out: memories that would raise the initial model's log-likelihood by at most" in (
        capsys.readouterr().out
    )
    assert run("fit", log, *options, "--dropped-mass", 0.5) == USAGE


def test_a_fit_that_its_intervals_surpass_is_made_again_and_if_they_still_do_ends_with_4(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[FitResult] = []

    def surpassed(result: FitResult, trials: Any, **options: Any) -> Uncertainty:
        asked.append(result)
        found = uncertainty(result, trials, **options)
        return replace(found, above=0.5, highest=vector_of(teacher()))

    monkeypatch.setattr(fitted, "uncertainty", surpassed)
    out = tmp_path / "m.json"
    assert run("fit", log, "--starts", 1, "--intervals", "wald", "--jobs", 1, "--out", out) == NOT_CONVERGED
    told = capsys.readouterr()
    assert "the intervals found a model 0.50 nats more likely than the fit: fitting again" in told.err
    assert [[start.name for start in each.starts] for each in asked] == [["initial"], ["initial", "given 1"]]
    assert "NOT TO BE TRUSTED: surpassed" in told.out
    assert TeacherModel.load(out).provenance["certificate"]["trusted"] is False


def test_that_intervals_of_delays_may_take_long_is_said_with_the_way_out_before_they_are_made(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[str] = []

    def quick(result: FitResult, trials: Any, **options: Any) -> Uncertainty:
        told.append(capsys.readouterr().err)
        return uncertainty(result, trials, method="wald")

    monkeypatch.setattr(fitted, "uncertainty", quick)
    options = ("--starts", 1, "--jobs", 1, "--out", tmp_path / "m.json")
    run("fit", log, *options)
    run("fit", log, *options, "--delays")
    assert "--intervals wald is quick" not in told[0]
    assert "with delays they may take many times as long as the fit; --intervals wald is quick" in told[1]
