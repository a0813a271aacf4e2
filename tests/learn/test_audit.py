"""The audit: what informs each parameter, the verdict by its rule, and that the mark stays with the model."""

import json
from dataclasses import replace
from functools import cache

import pytest
from taught import WORLD, by_hand, operator_trials, teacher

from learn import FitResult, fit, log_likelihood
from learn.audit import AS_NONE, FEW, WIDE, audited
from learn.certainty import uncertainty
from learn.intervals import ParameterInterval
from learn.report import parameter_table
from taskcomm.teacher import TeacherModel

TRIALS = operator_trials(8, teacher(peaks=(0.3, 0.3, 0.2)))


@cache
def fitted() -> FitResult:
    return fit(TRIALS, WORLD, starts=2)


@cache
def with_intervals() -> FitResult:
    return fitted().with_uncertainty(uncertainty(fitted(), TRIALS))


def interval(low: float, high: float, **ends: bool) -> ParameterInterval:
    return ParameterInterval("m.rise", 1.0, low=low, high=high, how="profile", **ends)


@pytest.mark.parametrize(
    ("presses", "mark", "found", "verdict"),
    [
        (FEW, "", None, "informed"),
        (FEW - 0.1, "", None, "weak"),
        (50.0, "at a kink", None, "informed"),
        (50.0, "at its bound", None, "informed"),
        (50.0, "ridge", None, "weak"),
        (50.0, "", interval(1.0, WIDE), "informed"),
        (50.0, "", interval(1.0, WIDE + 0.1), "weak"),
        (50.0, "", interval(1.0, 2.0, open_high=True), "weak"),
        (50.0, "", interval(0.5, 2.0, open_low=True), "informed"),
        (50.0, AS_NONE, None, "weak"),
        (0.0, "no data", None, "none"),
        (50.0, "fixed", None, "given"),
    ],
)
def test_the_verdict_follows_from_presses_mark_and_interval(
    presses: float, mark: str, found: ParameterInterval | None, verdict: str
) -> None:
    assert audited("m.rise", 100.0, presses, mark, found).verdict == verdict


def test_a_delay_is_not_judged_by_a_factor() -> None:
    assert audited("m.delay", 100.0, 50.0, "", interval(0.01, 0.4)).verdict == "informed"


def test_every_parameter_is_audited_with_the_counts_of_the_fit() -> None:
    result = fitted()
    assert [each.parameter for each in result.audit] == list(result.parameters)
    for each in result.audit:
        assert (each.steps, each.presses) == (result.steps[each.parameter], result.presses[each.parameter])
        assert each.verdict == ("given" if result.marks[each.parameter] == "fixed" else each.verdict)
    assert {each.verdict for each in result.audit} >= {"informed", "given"}


def test_intervals_can_only_lower_a_verdict() -> None:
    order = ["none", "weak", "informed"]
    plain = {each.parameter: each.verdict for each in fitted().audit}
    for each in with_intervals().audit:
        if each.verdict != "given":
            assert order.index(each.verdict) <= order.index(plain[each.parameter])


def test_a_parameter_without_data_stays_and_its_mark_stays_in_the_model_file() -> None:
    trials = [by_hand(["light_on(1)", *["noa"] * 12], [4, 8, 11], trial_id=str(n)) for n in range(3)]
    initial = teacher(falls=(2.5, 1.3, 0.9))
    result = fit(trials, WORLD, initial, starts=3)
    kept = TeacherModel.from_json(result.model.to_json())
    assert kept.approvals["that_mov"].fall == 2.5
    assert kept.approvals["that_dist"] == initial.approvals["that_dist"]
    audit = kept.provenance["audit"]
    assert audit["that_mov.fall"] == {
        "steps": 0.0, "presses": 0.0, "verdict": "none", "why": "it stays where it was", "mark": "no data",
    }  # fmt: skip
    assert [audit[f"that_dist.{name}"]["verdict"] for name in ("peak", "rise", "fall")] == ["none"] * 3
    assert audit["that_mov.peak"]["verdict"] == "informed"
    assert audit["that_mov.delay"]["verdict"] == "given"


def test_the_table_has_the_verdict_and_the_interval_where_there_is_one() -> None:
    columns, rows = parameter_table(fitted())
    assert columns == ["parameter", "intuitive", "learned", "presses", "steps", "data", "mark"]
    assert {row[5] for row in rows} <= {"informed", "weak", "none"}
    columns, rows = parameter_table(with_intervals())
    assert columns[3] == "95% interval"
    assert rows[0][3].count(" to ") == 1
    assert max(len(" ".join(row)) for row in rows) < 90


def test_intervals_come_into_the_model_file_and_it_loads_again() -> None:
    result = with_intervals()
    document = json.loads(result.model.to_json())
    json.dumps(document, allow_nan=False)
    kept = TeacherModel.from_json(result.model.to_json())
    assert kept == result.model
    found = {each["parameter"]: each for each in kept.provenance["uncertainty"]["intervals"]}
    mistake = found["mistake"]
    assert mistake["low"] < result.model.mistake < mistake["high"]
    assert kept.provenance["certificate"] == result.certificate.to_dict()
    assert fitted().uncertainty is None


def test_a_row_is_plain_json_with_none_at_an_open_end() -> None:
    for row in with_intervals().table():
        document = row.to_dict()
        json.dumps(document, allow_nan=False)
        if row.interval is not None and row.interval.open_high:
            assert document["high"] is None
        assert document["verdict"] == row.verdict


def test_a_ridge_has_a_row_for_the_ratio_that_is_known() -> None:
    flashing = ["light_on(1)", "light_off(1)", "noa", "noa"] * 12
    trial = by_hand(flashing, [4, 12, 20, 28, 36])
    result = fit([trial], WORLD, starts=2)
    assert result.marks["that_mov.peak"] == "ridge"
    assert {each.verdict for each in result.audit if each.parameter == "that_mov.rise"} == {"weak"}
    whole = result.with_uncertainty(uncertainty(result, [trial]))
    (row,) = [row for row in whole.table() if row.parameter == "that_mov.peak/rise"]
    top = whole.model.approvals["that_mov"]
    assert row.learned == pytest.approx(top.peak / top.rise)
    assert row.interval is not None


def test_a_decay_without_which_the_presses_are_as_likely_is_marked_and_not_called_informed() -> None:
    found = fit(operator_trials(12, teacher()), WORLD, starts=1, decays="shared")
    decay = found.model.approvals["that_mov"].decay
    assert decay is not None
    tops = {state: replace(top, decay=None) for state, top in found.model.approvals.items()}
    without = log_likelihood(operator_trials(12, teacher()), WORLD, replace(found.model, approvals=tops))
    assert without > found.log_likelihood - 0.1
    verdicts = {each.parameter: each for each in found.audit}
    for state in found.model.approvals:
        assert found.marks[f"{state}.decay"] == AS_NONE
        assert verdicts[f"{state}.decay"].verdict == "weak"
        assert f"{state}.decay" in found.certificate.bounds
    assert any("without it the presses are as likely" in remark for remark in found.remarks)


def test_a_decay_that_the_presses_need_is_not_marked() -> None:
    fading = teacher()
    tops = {state: replace(top, decay=2.0) for state, top in fading.approvals.items()}
    trials = operator_trials(20, replace(fading, approvals=tops))
    found = fit(trials, WORLD, starts=1, decays="shared", search=False)
    assert found.marks["that_mov.decay"] != AS_NONE
