"""Comparing models: people stay whole, nobody is scored by a model that knew them, reports say so."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from menustudy import FAST, START, TRUE, WORLD, comparison, study

from learn import FitError, compare_models, fit, log_likelihood
from learn.blind import fit_blind
from learn.held_out import BLIND, LEARNED, folds_of_people, held_out
from learn.report import report
from taskcomm.teacher import TeacherModel


@given(
    people=st.lists(st.sampled_from("abcdefgh"), min_size=2), folds=st.integers(2, 6), seed=st.integers(0, 99)
)
def test_folds_keep_people_whole_and_are_equal_to_within_one_person(
    people: list[str], folds: int, seed: int
) -> None:
    if len(set(people)) < 2:
        with pytest.raises(FitError, match="at least two people"):
            folds_of_people(people, folds, seed)
        return
    fold = folds_of_people(people, folds, seed)
    of_person = {
        person: {int(k) for p, k in zip(people, fold, strict=True) if p == person} for person in people
    }
    assert all(len(found) == 1 for found in of_person.values())
    sizes = [sum(found == {k} for found in of_person.values()) for k in range(int(fold.max()) + 1)]
    assert len(sizes) == min(folds, len(of_person))
    assert max(sizes) - min(sizes) <= 1


def test_held_out_scores_come_from_fits_without_that_person() -> None:
    scored = comparison().held_out
    for k in range(3):
        kept = [t for t, fold in zip(study(), scored.fold, strict=True) if fold != k]
        left = np.flatnonzero(scored.fold == k).tolist()
        model = fit(kept, world=WORLD, seed=0, initial=START, starts=1).model
        for n in left:
            alone = log_likelihood([study()[n]], WORLD, model)
            assert scored.log_likelihood[LEARNED][n] == pytest.approx(alone, abs=1e-9)
            assert scored.model(LEARNED, n) == model
        blind = fit_blind(kept).score([study()[n] for n in left])
        np.testing.assert_allclose(scored.log_likelihood[BLIND][left], blind, atol=1e-9)
    for n, trial in enumerate(study()):
        assert scored.log_likelihood["intuitive"][n] == pytest.approx(log_likelihood([trial], WORLD, START))


def test_a_model_that_was_fitted_to_the_trials_is_marked() -> None:
    scored = comparison().held_out
    assert scored.in_sample["seen"].tolist() == [n < 4 for n in range(14)]
    assert not scored.in_sample["intuitive"].any()
    assert not scored.in_sample[LEARNED].any()


def test_free_provenance_of_another_kind_marks_no_trial() -> None:
    kinds: tuple[object, ...] = (5, None, "abc", [["abc"]], {"abc": 1})
    models = {str(kind): replace(START, provenance={"trial_sha256": kind}) for kind in kinds}
    scored = held_out(study(), models, folds=2, blind=False, fit_options=FAST)
    assert not np.any([scored.in_sample[name] for name in models])
    text = report(comparison(), title="T")
    assert "seen (in-sample: 4 of 14 trials)" in text
    assert "Figures marked in-sample" in text


def test_gains_are_paired_and_resample_people() -> None:
    scored = comparison().held_out
    gain = scored.log_likelihood[LEARNED] - scored.log_likelihood["intuitive"]
    found = scored.per_trial(LEARNED, "intuitive")
    assert found.estimate == pytest.approx(gain.mean())
    assert found.groups == 7
    assert scored.per_press(LEARNED, "intuitive").estimate == pytest.approx(gain.sum() / scored.presses.sum())


def test_the_teacher_that_taught_is_foreseen_better_by_its_own_model_than_by_the_blind() -> None:
    true = held_out(study(), {"true": TRUE}, folds=2, fit_options=FAST)
    assert true.log_likelihood["true"].sum() > true.log_likelihood[BLIND].sum() + 5


def test_nothing_depends_on_the_number_of_processes() -> None:
    one, two = (
        held_out(study(), {"a": START}, folds=2, blind=False, fit_options=FAST, jobs=jobs) for jobs in (1, 2)
    )
    for arm in one.arms:
        np.testing.assert_array_equal(one.log_likelihood[arm], two.log_likelihood[arm])


def test_the_report_says_that_simulated_trials_are_simulated() -> None:
    text = report(comparison(), title="A title", intro="An introduction.", outro="An end.")
    assert text.startswith("# A title\n\nAn introduction.\n\n**These trials are simulated**")
    assert text.endswith("An end.\n")
    for heading in ("learned teacher", "Foreseeing", "planner would do", "closed loop", "right when it says"):
        assert heading in text
    people = replace(comparison(), sources=("human",))
    assert "simulated**" not in report(people, title="T").split("## ")[0]
    mixed = replace(comparison(), sources=("human", "simulated"))
    assert "Some of these trials are simulated" in report(mixed, title="T")


def test_the_report_says_where_a_robot_knows_its_teachers_exactly() -> None:
    assert "knows its teachers exactly" in report(comparison(), title="T")
    assert "knows its teachers exactly" not in report(replace(comparison(), truths=(TRUE,)), title="T")


def test_numbers_of_the_comparison_are_json_and_agree_with_its_parts() -> None:
    document = json.loads(json.dumps(comparison().to_json(), allow_nan=False))
    assert set(document["held_out"]) == {"intuitive", "seen", LEARNED, BLIND}
    assert document["held_out"]["seen"]["in_sample_trials"] == 4
    loop = document["closed_loop"]["arms"]
    assert set(loop) == {"intuitive", "seen", LEARNED}
    assert "time_ratio" not in loop["intuitive"]
    found = comparison()
    assert found.loop is not None
    assert loop[LEARNED]["time"]["estimate"] == found.loop.time(LEARNED).mean()
    assert document["closed_loop"]["settings"]["truths"] == [found.fitted.model.sha256]
    assert document["decisions"]["intuitive"]["decisions"] == len(found.disagreement["intuitive"].differs)


def test_without_a_loop_decisions_or_the_blind_arm_the_rest_stands() -> None:
    found = compare_models(
        study(),
        {"intuitive": START},
        folds=2,
        blind=False,
        decisions=0,
        loop_trials=0,
        jobs=1,
        fit_options=FAST,
    )
    assert found.held_out.arms == ("intuitive", LEARNED)
    text = report(found, title="T")
    assert "closed loop\n" not in text
    assert "planner would do" not in text
    assert "closed_loop" not in found.to_json()


def test_what_cannot_be_compared_is_refused() -> None:
    with pytest.raises(FitError, match="no trials"):
        compare_models((), {"a": START})
    alone = [replace(trial, participant_id="p") for trial in study()]
    with pytest.raises(FitError, match="at least two people"):
        held_out(alone, {"a": START})
    with pytest.raises(ValueError, match="names of arms"):
        held_out(study(), {LEARNED: TRUE})
    with pytest.raises(ValueError, match="at least one model"):
        compare_models(study(), {})
    with pytest.raises(FitError, match="dt"):
        held_out(study(), {"a": TeacherModel.from_json(START.to_json()).with_dt(0.25)}, fit_options=FAST)
