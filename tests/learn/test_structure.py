"""Structures and the search among them: what is tried, what is chosen, what is claimed."""

import json
import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from taught import WORLD, operator_trials, teacher

from learn import FitError, fit
from learn.candidate_fits import Bench, Candidate
from learn.candidates import SHARINGS, Structure, alternatives, beginnings
from learn.coordinates import vector_of
from learn.settings import Settings
from learn.structure import StructureSearch, search_structure
from learn.structure_choice import answer_of, gap, simplest_within_one_error
from learn.structure_study import simulated_study, study_row, truths
from taskcomm.cli import main
from taskcomm.logs import write_trials
from taskcomm.robot import Robot
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial

INTUITIVE = TeacherModel.intuitive()
PLAIN = Structure.of(INTUITIVE)
CUE = "cue of that_wrt"
FEW_CUES = ("mov_lit", "wrt_lit_while_mov_held", "mov_at_dist", "wrt_lit")


@cache
def trials_by_wrt_lit(count: int = 30) -> tuple[Trial, ...]:
    """Operator trials of teachers, two trials each, who look at the reference ball's light alone."""
    model = teacher()
    tops = {**model.approvals, "that_wrt": replace(model.approvals["that_wrt"], cue="wrt_lit")}
    trials = operator_trials(count, replace(model, approvals=tops), seed=3)
    return tuple(replace(trial, participant_id=f"p{n // 2}") for n, trial in enumerate(trials))


@cache
def found() -> StructureSearch:
    return search_structure(
        trials_by_wrt_lit(20),
        settings=Settings(starts=2),
        cue_names=FEW_CUES,
        rests=(0.0,),
        folds=3,
        thorough=1,
    )


def bench(count: int = 30, folds: int = 3, first_trials: int = 1000) -> Bench:
    return Bench(trials_by_wrt_lit(count), WORLD, INTUITIVE, Settings(starts=2), folds, first_trials)


def scored(structure: Structure, num_free: int, held_out: list[float]) -> Candidate:
    return Candidate(structure, num_free, math.nan, INTUITIVE, np.array(held_out))


def test_alternatives_differ_in_one_factor_and_drive_no_two_states_by_one_cue() -> None:
    start = PLAIN.with_value("delay", "shared")
    for factor in start.factors:
        tried = alternatives(start, factor, WORLD.cue_names, (0.0, 1.0))
        assert start in tried
        assert len(set(tried)) == len(tried)
        for structure in tried:
            assert [f for f in start.factors if structure.value(f) != start.value(f)] in ([], [factor])
            assert len({cue for _, cue in structure.cues}) == 3
    assert len(alternatives(start, CUE, WORLD.cue_names, ())) == 5
    assert {s.value("decay") for s in alternatives(start, "decay", (), ())} == set(SHARINGS)
    assert [s.rest for s in alternatives(start, "rest", (), (2.0, 0.5))] == [0.0, 0.5, 2.0]


@pytest.mark.parametrize("delay", SHARINGS)
@pytest.mark.parametrize("decay", SHARINGS)
def test_a_fit_of_a_structure_has_that_structure(delay: str, decay: str) -> None:
    wanted = replace(PLAIN, delay=delay, decay=decay, rest=0.5).with_value(CUE, "wrt_lit")
    tops = {
        state: replace(top, delay=0.3 + m * (delay == "per state"), decay=3.0 + m * (decay == "per state"))
        for m, (state, top) in enumerate(INTUITIVE.approvals.items())
    }
    model = wanted.imposed_on(replace(INTUITIVE, approvals=tops))
    assert Structure.of(model) == wanted
    settings = wanted.settings(Settings())
    assert (settings.delays is False, settings.decays is False) == (delay == "none", decay == "none")
    assert settings.shared == tuple(n for n, v in (("delay", delay), ("decay", decay)) if v == "shared")


def test_beginnings_leave_what_two_structures_share_and_begin_at_the_other_fit() -> None:
    near = replace(teacher(), mistake=0.02)
    other = PLAIN.with_value(CUE, "wrt_lit")
    base = other.imposed_on(INTUITIVE)
    begun = np.array(beginnings(other, base, near, near.dt))
    assert (begun[0] == vector_of(near)).all()
    moved = np.flatnonzero((begun != begun[0]).any(axis=0))
    assert set(moved) == {1 + 3 + 1, 1 + 6 + 1}  # rise and fall of that_wrt


@pytest.mark.verify
def test_a_quick_fit_loses_less_than_half_a_nat() -> None:
    at = bench()
    near = INTUITIVE
    for structure in (PLAIN.with_value(CUE, "wrt_lit"), PLAIN.with_value("delay", "shared")):
        quick = at.fit(structure, near)
        thorough = fit(
            at.trials, WORLD, structure.imposed_on(INTUITIVE), settings=structure.settings(at.settings)
        )
        assert -0.5 < quick.log_likelihood - thorough.log_likelihood < 0.01
        assert quick.num_free == thorough.num_free
        near = quick.model


@pytest.mark.verify
def test_held_out_scores_are_those_of_fits_without_the_fold() -> None:
    at = bench(folds=2)
    structure = PLAIN.with_value(CUE, "wrt_lit")
    quick = at.with_held_out(at.fit(structure, INTUITIVE))
    assert quick.held_out is not None
    assert quick.total < quick.log_likelihood
    for k in range(2):
        without = fit(
            at.trials, WORLD, structure.imposed_on(INTUITIVE), settings=at.settings, weights=at.fold != k
        )
        here = at.fold == k
        assert quick.held_out[here].sum() == pytest.approx(without.log_likelihoods[here].sum(), abs=1.5)
        assert quick.held_out[here].sum() < quick.log_likelihood - without.log_likelihood + 0.5


def test_held_out_scores_know_none_of_the_presses_left_out_with_them() -> None:
    at = bench(12, folds=2)
    candidate = at.with_held_out(at.refit(scored(PLAIN, 10, []), INTUITIVE))
    changed = int(np.flatnonzero(at.fold == 0)[0])
    presses = [replace(step, pressed=not step.pressed) for step in at.trials[changed].steps[:20]]
    trials = list(at.trials)
    trials[changed] = replace(trials[changed], steps=tuple(presses))
    other = Bench(trials, WORLD, INTUITIVE, at.settings, 2, 1000)
    again = other.with_held_out(other.refit(candidate, INTUITIVE))
    assert candidate.held_out is not None
    assert again.held_out is not None
    beside = (at.fold == 0) & (np.arange(12) != changed)
    assert again.held_out[beside] == pytest.approx(candidate.held_out[beside], abs=1e-9)
    assert (np.abs(again.held_out - candidate.held_out)[at.fold == 1] > 1e-3).all()


def test_the_simplest_within_one_standard_error_of_the_best_is_chosen() -> None:
    at = bench(8)
    complex_one = PLAIN.with_value("delay", "per state")
    noisy = scored(complex_one, 13, [-1.0, -1.0, -9.0, -9.0] * 2)
    plain = scored(PLAIN, 10, [-6.0] * 8)
    short, error = gap(at, plain, noisy)
    assert -error < short < 0
    assert simplest_within_one_error([noisy, plain], at) is plain
    clear = scored(complex_one, 13, [-4.0] * 8)
    assert simplest_within_one_error([clear, plain], at) is clear
    equal = scored(PLAIN.with_value(CUE, "wrt_lit"), 10, [-5.5] * 8)
    assert simplest_within_one_error([plain, equal], at) is equal


def test_a_decay_that_is_as_good_as_none_is_not_chosen_however_it_scores() -> None:
    at, decaying = bench(8), PLAIN.with_value("decay", "shared")
    plain, better = scored(PLAIN, 10, [-6.0] * 8), scored(decaying, 11, [-5.9] * 8)
    assert simplest_within_one_error([plain, better], at) is better
    assert simplest_within_one_error([plain, replace(better, idle=True)], at) is plain


def test_a_quick_fit_says_whether_its_decay_is_as_good_as_none() -> None:
    fading = teacher()
    tops = {state: replace(top, decay=2.0) for state, top in fading.approvals.items()}
    found = {}
    for name, model in {"none": teacher(), "fading": replace(fading, approvals=tops)}.items():
        trials = [replace(t, participant_id=t.trial_id) for t in operator_trials(20, model, seed=2)]
        at = Bench(trials, WORLD, INTUITIVE, Settings(), 2, 1000)
        found[name] = at.fit(PLAIN.with_value("decay", "shared"), teacher()).idle
    assert found == {"none": True, "fading": False}


def test_the_standard_error_is_over_people_not_trials() -> None:
    at = bench(8)
    base = scored(PLAIN, 10, [0.0] * 8)
    within = scored(PLAIN, 10, [1.0, -1.0] * 4)
    between = scored(PLAIN, 10, [1.0, 1.0, -1.0, -1.0] * 2)
    assert gap(at, within, base) == (0.0, 0.0)
    assert gap(at, between, base)[1] == pytest.approx(2 * np.std([2, -2, 2, -2], ddof=1))


def test_what_is_named_has_the_weight_that_is_claimed_and_the_chosen_first() -> None:
    def at(delay: str, log_likelihood: float, num_free: int, behind: float | None = None) -> Candidate:
        return Candidate(PLAIN.with_value("delay", delay), num_free, log_likelihood, INTUITIVE, None, behind)

    none, shared, each = at("none", -100.0, 10), at("shared", -99.0, 11), at("per state", math.nan, 13, 20.0)
    for confidence in (0.5, 0.9, 0.99):
        answer = answer_of("delay", none, [none, shared, each], 22, confidence)
        assert sum(answer.weights.values()) == pytest.approx(1.0)
        assert answer.weights["per state"] == 0
        assert answer.weights["none"] / answer.weights["shared"] == pytest.approx(22**0.5 / math.e)
        assert sum(answer.weights[value] for value in answer.named) >= confidence
        assert answer.named[0] == "none"
        assert answer.told == (confidence == 0.5)
    against = answer_of("delay", shared, [none, at("shared", -107.0, 11), each], 22, 0.9)
    assert against.named == ("shared", "none")  # the held-out choice is named, however little it weighs


def test_the_cue_that_drives_a_state_is_found() -> None:
    result = found()
    assert result.settled
    assert result.chosen.structure.value(CUE) == "wrt_lit"
    (answer,) = [answer for answer in result.answers if answer.factor == CUE]
    assert answer.told
    rows = result.rows()
    assert [row["chosen"] for row in rows].count(True) == 1
    scores = [row["held_out"] for row in rows if row["held_out"] is not None]
    assert scores == sorted(scores, reverse=True)
    assert scores[0] == 0
    assert min(row["bic"] for row in rows if row["bic"] is not None) == 0


def test_the_model_is_that_of_a_fit_of_the_chosen_structure() -> None:
    result = found()
    assert result.fitted is not None
    assert result.fitted.certificate.trusted
    assert Structure.of(result.fitted.model).cues == result.chosen.structure.cues
    assert result.fitted.log_likelihood >= result.chosen.log_likelihood - 0.01
    assert result.fitted.settings.delays == result.chosen.structure.settings(Settings()).delays


@pytest.mark.verify
def test_structures_given_up_on_some_trials_are_those_that_all_trials_are_against() -> None:
    raced = search_structure(
        trials_by_wrt_lit(), cue_names=FEW_CUES, rests=(0.0,), folds=3, first_trials=14, thorough=0
    )
    whole = search_structure(trials_by_wrt_lit(), cue_names=FEW_CUES, rests=(0.0,), folds=3, thorough=0)
    given_up = {c.structure for c in raced.candidates if c.behind is not None}
    assert given_up
    assert raced.chosen.structure.cues == whole.chosen.structure.cues
    for candidate in whole.candidates:
        if candidate.structure in given_up:
            assert candidate.penalised < whole.chosen.penalised - 12


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"cue_names": ["mov_bright"]}, "cue_names: unknown cue 'mov_bright'; this world has mov_lit"),
        ({"confidence": 1.0}, "confidence: must be at least 0.5 and below 1, not 1"),
        ({"rests": [-1.0]}, "rests: must be finite and at least 0, not -1"),
    ],
)
def test_what_cannot_be_searched_is_one_clear_error(options: dict[str, object], message: str) -> None:
    with pytest.raises(FitError, match=message):
        search_structure(trials_by_wrt_lit(), **options)  # type: ignore[arg-type]


@pytest.mark.verify
def test_a_delay_of_three_tenths_of_a_second_and_a_decay_are_found_in_five_hundred_trials() -> None:
    row = study_row("delay + decay", 500, 100)
    assert row["chosen"].startswith(str(PLAIN))
    assert "none" not in row["delay"].split("|")
    assert "none" not in row["decay"].split("|")
    assert "shared" in row["delay"].split("|")
    assert "shared" in row["decay"].split("|")


def test_a_simulated_study_is_the_same_again_and_its_truth_is_what_it_says() -> None:
    one, other = (simulated_study("teachers differ", 4, (1, 2)) for _ in range(2))
    assert one == other
    assert [trial.participant_id for trial in one] == ["000", "000", "001", "001"]
    true = {name: Structure.of(model) for name, model in truths().items()}
    assert true["delay + decay"] == replace(PLAIN, delay="shared", decay="shared")
    assert true["rest"] == replace(PLAIN, rest=1.0)
    assert true["mov_closing"] == PLAIN.with_value("cue of that_dist", "mov_closing")


def test_one_person_cannot_be_held_out() -> None:
    alone = [replace(trial, participant_id="p") for trial in trials_by_wrt_lit()[:4]]
    with pytest.raises(FitError, match="at least two people"):
        search_structure(alone)


def test_the_command_writes_a_model_that_a_robot_takes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, out = tmp_path / "trials.jsonl", tmp_path / "model.json"
    write_trials(trials_by_wrt_lit(6), log)
    arguments = ["structure", log, "--out", out, "--folds", 2, "--rest", 0, "--starts", 1, "--thorough", 1]
    assert main([*map(str, arguments), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    model = TeacherModel.load(out)
    assert document["chosen"] == model.provenance["structure"]["chosen"]
    assert set(document["factors"]) == set(PLAIN.factors)
    assert document["fit"]["certificate"]
    assert sum(row["chosen"] for row in document["candidates"]) == 1
    record = json.loads((tmp_path / "model.json.run.json").read_text())
    assert record["settings"]["rests"] == [0.0]
    assert Robot(WORLD, model).act(None) in WORLD.actions(WORLD.start())


def test_the_command_refuses_the_trials_of_one_person(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, out = tmp_path / "trials.jsonl", tmp_path / "model.json"
    write_trials([replace(trials_by_wrt_lit()[0], participant_id="p")], log)
    assert main(["structure", str(log), "--out", str(out)]) == 3
    assert "at least two people" in capsys.readouterr().err
    assert not out.exists()
