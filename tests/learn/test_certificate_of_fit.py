"""The certificate: each kind where it belongs, remarks that are no faults, numbers that are the fit's own."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from taught import WORLD, by_hand, operator_trials, teacher

from learn import Certificate, FitResult, fit, log_likelihood
from learn.basins import DIP
from learn.certificate import degeneracies, flat_direction, kind_of
from learn.coordinates import names_of, vector_of
from learn.em import prepare
from learn.settings import Settings
from taskcomm.teacher import TeacherModel

TRUTH = teacher()
INTUITIVE = TeacherModel.intuitive()


@cache
def fitted() -> FitResult:
    return fit(operator_trials(12, TRUTH), WORLD, starts=4)


def test_a_certificate_says_what_its_fit_is() -> None:
    result, certificate = fitted(), fitted().certificate
    assert certificate.trusted is result.converged is True
    assert certificate.kind in ("converged", "at a bound")
    assert (certificate.kind == "at a bound") == ("at its bound" in result.marks.values())
    assert certificate.status == result.status == "converged"
    assert certificate.reasons == ()
    assert certificate.log_likelihood == result.log_likelihood
    assert certificate.search_gain == result.objective - certificate.em_alone
    assert certificate.steepest == result.steepest <= certificate.tolerance
    assert certificate.kinks == tuple(name for name, mark in result.marks.items() if mark == "at a kink")
    assert certificate.monotone


def test_every_start_is_placed_beside_the_result_which_none_exceeds() -> None:
    result = fitted()
    endings = result.certificate.endings
    assert [ending.start for ending in endings] == [start.name for start in result.starts]
    for ending, start in zip(endings, result.starts, strict=True):
        assert ending.below == pytest.approx(result.objective - start.searched, abs=1e-6)
        assert ending.below >= 0
        assert (ending.distance > 0) == (ending.along != "")
        assert 0 <= ending.basin < result.certificate.basins
    assert max(ending.basin for ending in endings) + 1 == result.certificate.basins


def test_starts_that_end_together_share_a_basin_and_a_separate_peak_is_another() -> None:
    """A fit that starts at the optimum stays on its hill; a delay and a long fall are hills apart."""
    result = fitted()
    at_end = fit(operator_trials(12, TRUTH), WORLD, result.model, starts=1)
    assert at_end.certificate.basins == 1
    assert at_end.certificate.endings[0].below < DIP
    many = fit(operator_trials(6, TRUTH, seed=3), WORLD, starts=6, delays=True).certificate
    assert many.basins > 1
    apart = [ending for ending in many.endings if ending.basin > 0]
    assert all(ending.distance > 0.05 for ending in apart)


def test_too_few_iterations_are_the_kind_iteration_limit() -> None:
    certificate = fit(operator_trials(6, TRUTH), WORLD, starts=1, max_iter=2).certificate
    assert certificate.kind == "iteration limit"
    assert not certificate.trusted
    assert certificate.reasons[0] == "EM still rising after 2 iterations"


def test_a_slope_that_is_left_is_named_with_its_direction() -> None:
    result = fit(operator_trials(12, TRUTH), WORLD, teacher(falls=(0.5, 0.5, 0.5)), starts=1, search=False)
    assert result.certificate.kind == "slope left"
    assert result.certificate.steepest is not None
    assert result.certificate.steepest > result.certificate.tolerance
    assert any(name in result.certificate.steepest_along for name in ("rise", "fall"))
    assert result.status.startswith("not converged: a slope of")


def test_the_gravest_kind_is_named_with_every_reason() -> None:
    assert kind_of([], 9, True, 0.0, True, False) == ("converged", ())
    assert kind_of([], 9, True, 0.0, True, True) == ("at a bound", ())
    assert kind_of([], 9, True, 0.0, False, True)[0] == "not monotone"
    assert kind_of([], 9, True, 1.0, False, True)[0] == "slope left"
    kind, reasons = kind_of(["no press"], 9, False, 1.0, False, True)
    assert kind == "degenerate"
    assert len(reasons) == 3


def test_what_cannot_be_an_estimate_is_degenerate_and_says_why() -> None:
    lit = ["light_on(1)", *["noa"] * 20]
    silent = fit([by_hand(lit, [])], WORLD, starts=2)
    assert silent.certificate.kind == "degenerate"
    assert "no press in any trial" in silent.status
    off_cue = fit([by_hand(["light_on(2)", *["noa"] * 20], [3, 9])], WORLD, starts=2, mistake_prior=None)
    assert "no cue was ever on" in off_cue.status
    on_cue = fit([by_hand(lit, [5, 11, 17])], WORLD, starts=2, mistake_prior=None)
    assert "mistake has vanished" in on_cue.status
    only_mistakes = by_hand(["noa"] * 10 + ["light_on(1)", "noa", "noa"], [2, 5, 8])
    assert "every peak has vanished" in fit([only_mistakes], WORLD, starts=2).status
    always = by_hand(["noa"] * 30, range(30))
    assert "every step has a press" in fit([always], WORLD, starts=2, mistake_prior=None).status


def test_peaks_that_sum_to_1_are_a_bound_and_no_fault() -> None:
    """Cues that are never on together: each peak would be near 1 if the others left it room."""
    one = by_hand(["light_on(1)", *["noa"] * 9], range(1, 10))
    other = by_hand(["pick_up(1)", "light_on(2)", *["noa"] * 9], range(2, 11), trial_id="other")
    result = fit([one, other], WORLD, starts=3)
    assert sum(top.peak for top in result.model.approvals.values()) > 1 - 0.11
    assert "sum of the peaks" in result.certificate.bounds
    assert result.certificate.kind == "at a bound"
    assert any("sum to 1" in remark for remark in result.remarks)


def test_a_peak_that_vanished_alone_is_a_bound_and_its_times_have_no_data() -> None:
    trial = by_hand(["light_on(1)", *["noa"] * 20, "pick_up(1)", "light_on(2)", *["noa"] * 9], [6, 12, 18])
    result = fit([trial], WORLD, starts=3)
    assert result.certificate.kind == "at a bound"
    assert result.marks["that_wrt.peak"] == "at its bound"
    assert result.marks["that_wrt.rise"] == result.marks["that_wrt.fall"] == "no data"
    assert result.model.approvals["that_wrt"].rise == INTUITIVE.approvals["that_wrt"].rise
    assert any(remark.startswith("that_wrt: its peak has vanished") for remark in result.remarks)


def test_two_states_that_nothing_tells_apart_are_a_flat_direction() -> None:
    """Levels that are full again one step after a reset: of two states with one cue, the sum is known."""
    tops = dict(TRUTH.approvals)
    tops["that_wrt"] = replace(tops["that_wrt"], cue="mov_lit", rise=0.5, fall=0.5, peak=3 / 31 - 0.06)
    tops["that_mov"] = replace(tops["that_mov"], rise=0.5, fall=0.5, peak=0.05)
    trial = by_hand(["light_on(1)", *["noa"] * 30], [9, 15, 21])
    model = replace(TRUTH, approvals=tops)
    objective = prepare([trial], WORLD, model, Settings())
    point = objective.space.point(vector_of(model))
    names = names_of(list(tops))
    index = objective.space.index.tolist()
    peaks = [index.index(names.index(f"{state}.peak")) for state in ("that_mov", "that_wrt")]
    direction = flat_direction(objective, point, peaks)
    assert direction is not None
    assert np.sign(direction[peaks[0]]) == -np.sign(direction[peaks[1]])
    assert flat_direction(objective, point, peaks[:1]) is None
    labels = [names[i] for i in index]
    marks = {name: "" if name in {names[index[p]] for p in peaks} else "fixed" for name in names}
    assert any("it is flat" in reason for reason in degeneracies(objective, point, marks, names, labels))


def test_a_certificate_is_plain_json_and_stays_in_the_model_file() -> None:
    result = fitted()
    document = result.certificate.to_dict()
    assert json.loads(json.dumps(document, allow_nan=False)) == document
    kept = TeacherModel.from_json(result.model.to_json()).provenance["certificate"]
    assert kept == document
    assert kept["kind"] == result.certificate.kind
    assert kept["endings"][0]["start"] == "initial"


def test_the_printed_certificate_fits_its_lines_and_shouts_only_where_it_must() -> None:
    text = "\n".join(fitted().certificate.lines())
    assert text.startswith("may be trusted")
    assert "NOT" not in text
    limited = fit(operator_trials(6, TRUTH), WORLD, starts=1, max_iter=2).certificate
    assert limited.lines()[0] == ("NOT TO BE TRUSTED: iteration limit (EM still rising after 2 iterations)")


def test_the_likelihood_of_an_ending_is_that_of_a_model_there() -> None:
    """With one start and no search, the start ended where the result is."""
    trials = operator_trials(6, TRUTH)
    result = fit(trials, WORLD, starts=1, search=False)
    (ending,) = result.certificate.endings
    assert ending.log_likelihood == pytest.approx(log_likelihood(trials, WORLD, result.model), abs=1e-6)
    assert isinstance(result.certificate, Certificate)


def test_a_time_that_nothing_near_it_changes_but_the_initial_one_would_goes_to_its_bound() -> None:
    """A level so low that any short fall clears it in one step; a long one would leave presses to explain."""
    flashing = ["light_on(1)", *["noa"] * 5, "light_off(1)", *["noa"] * 5] * 6
    trial = by_hand(flashing, [5, 17, 29, 41, 53, 65])
    result = fit([trial], WORLD, teacher(falls=(6.0, 1.0, 1.0)), starts=4)
    fall = result.model.approvals["that_mov"].fall
    assert result.marks["that_mov.fall"] == ("no data" if fall == 6.0 else "at its bound")
    assert fall < 6.0


@pytest.mark.verify
@pytest.mark.parametrize("count", [2, 6, 22])
def test_small_studies_of_plain_teachers_are_rarely_called_degenerate(count: int) -> None:
    """What few trials leave open are kinks, ridges and bounds, which are remarks."""
    kinds = [
        fit(operator_trials(count, TRUTH, seed=100 + seed), WORLD, starts=3).certificate.kind
        for seed in range(24)
    ]
    assert sum(kind in ("converged", "at a bound") for kind in kinds) >= 23
