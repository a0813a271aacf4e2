"""Intervals as users get them: by which method, of what, in tables and files."""

import json
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from taught import WORLD, operator_trials, teacher

from learn import FitError, FitResult, Uncertainty, fit, uncertainty
from learn.bands import table_top_bands
from learn.certainty import profile_curve
from learn.coordinates import model_at
from learn.interval_figure import coverage_plot, profile_plot
from learn.intervals import ParameterInterval, interval_text
from learn.plots import table_top
from learn.profile import AGAIN, CLOSE
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial

STARTS = 6


@cache
def trials(teachers: int = 6) -> tuple[Trial, ...]:
    """Three trials of every teacher."""
    return tuple(
        replace(trial, participant_id=f"p{number % teachers}")
        for number, trial in enumerate(operator_trials(18, teacher()))
    )


@cache
def fitted() -> FitResult:
    return fit(trials(), WORLD, starts=STARTS)


@cache
def by(method: Any) -> Uncertainty:
    return uncertainty(fitted(), trials(), method=method, resamples=12)


def learned() -> list[str]:
    return [name for name, mark in fitted().marks.items() if mark not in ("fixed", "no data")]


@pytest.mark.parametrize("method", ["likelihood", "wald", "bootstrap"])
def test_every_method_says_of_each_parameter_what_it_can(method: str) -> None:
    found = by(method)
    assert found.teachers == 6
    assert [each.parameter for each in found.intervals[:19]] == list(fitted().parameters)
    for each in found.intervals:
        mark = fitted().marks.get(each.parameter, "")
        assert (each.standard_error is None) == (each.robust_error is None)
        assert (each.standard_error is not None) <= (mark == "")
        if each.parameter not in learned() or (method == "wald" and mark):
            assert (each.how, each.low, each.high) == ("none", None, None)
            assert interval_text(each) == ""
        else:
            assert each.how == {"likelihood": "profile"}.get(method, method)
            assert each.low is not None
            assert each.high is not None
            assert each.low < each.high or (method == "bootstrap" and each.open_low)
            if method != "bootstrap":
                assert each.low <= each.estimate <= each.high
    assert found.above < 0.01


def test_with_many_trials_the_profile_is_the_parabola_of_the_standard_error() -> None:
    """Where the log-likelihood is smooth: mistake."""
    profile, wald = (by(method)["mistake"] for method in ("likelihood", "wald"))
    assert wald.low is not None
    assert wald.high is not None
    assert wald.standard_error is not None
    assert (profile.low, profile.high) == pytest.approx((wald.low, wald.high), rel=0.15)
    relative = np.log(wald.high / wald.low) / (2 * 1.959964)
    assert wald.standard_error == pytest.approx(wald.estimate * relative, rel=0.02)


def test_from_a_fit_short_of_the_best_the_intervals_are_those_of_the_best() -> None:
    short = fit(trials(), WORLD, starts=1, search=False)
    assert short.objective < fitted().objective - 0.05
    found, expected = uncertainty(short, trials()), by("likelihood")
    assert found.above == pytest.approx(fitted().objective - short.objective, abs=0.05)
    assert found.highest is not None
    again = fit(trials(), WORLD, starts=1, search=False, also=[model_at(found.highest, short.model)])
    assert again.objective > short.objective + found.above - 1e-6
    for name in ("mistake", "that_dist.peak"):
        ends = [(each.low, each.high) for each in (found[name], expected[name])]
        assert ends[0] == pytest.approx(ends[1], rel=0.02)


def test_a_fit_that_its_own_intervals_surpass_is_not_to_be_trusted() -> None:
    found = by("likelihood")
    assert fitted().with_uncertainty(replace(found, above=0.09)).certificate == fitted().certificate
    judged = fitted().with_uncertainty(replace(found, above=0.5))
    assert (judged.certificate.kind, judged.converged) == ("surpassed", False)
    assert "a model 0.50 nats more likely lies beside it" in judged.status
    kept = TeacherModel.from_json(judged.model.to_json()).provenance
    assert kept["certificate"] == judged.certificate.to_dict()
    assert (kept["converged"], kept["status"]) == (False, judged.status)


def test_a_trial_counted_twice_is_two_trials() -> None:
    """Weights of 2, or every trial given twice: the same standard errors and ends."""
    many = operator_trials(40, teacher(), seed=2)
    once = fit(many, WORLD, starts=1, weights=[2.0] * 40)
    again = tuple(replace(trial, trial_id=f"{trial.trial_id}-again") for trial in many)
    twice = replace(once, trial_hashes=once.trial_hashes * 2)
    weighted = uncertainty(once, many, method="wald", weights=[2.0] * 40)
    doubled = uncertainty(twice, many + again, method="wald")
    pairs = [(a, b) for a, b in zip(weighted.intervals, doubled.intervals, strict=True) if a.how == "wald"]
    assert len(pairs) >= 3
    for a, b in pairs:
        assert a.standard_error == pytest.approx(b.standard_error, rel=1e-6)
        assert (a.low, a.high) == pytest.approx((b.low, b.high), rel=1e-6)


def test_a_lower_level_lies_within_a_higher_one() -> None:
    half = uncertainty(fitted(), trials(), level=0.5)
    for name in learned():
        inner, outer = half[name], by("likelihood")[name]
        slack = 1 + CLOSE + AGAIN
        assert inner.open_low or outer.open_low or outer.low <= inner.low * slack  # type: ignore[operator]
        assert inner.open_high or outer.open_high or inner.high <= outer.high * slack  # type: ignore[operator]
        assert inner.low < outer.high  # type: ignore[operator]


def test_the_bootstrap_is_that_of_its_seed_on_any_number_of_processes() -> None:
    first, second = (
        uncertainty(fitted(), trials(), method="bootstrap", resamples=4, seed=0, jobs=jobs) for jobs in (1, 2)
    )
    other = uncertainty(fitted(), trials(), method="bootstrap", resamples=4, seed=1)
    assert first.intervals == second.intervals != other.intervals
    np.testing.assert_array_equal(first.draws, by("bootstrap").draws[:4])  # type: ignore[index]
    assert (first.resamples, first.seed, other.seed) == (4, 0, 1)


def test_bootstrap_fits_are_nearly_as_good_as_fits_from_the_start() -> None:
    from learn.coordinates import vector_of
    from learn.em import prepare
    from learn.resampling import Resample, groups_of, members_of

    objective = prepare(trials(), WORLD, fitted().model, fitted().settings)
    centre, member = objective.space.point(vector_of(fitted().model)), members_of(groups_of(trials()))
    for number in range(2):
        vector = Resample(objective, centre, member, seed=3)(number)
        drawn = np.random.default_rng([3, number]).multinomial(6, np.full(6, 1 / 6))[member]
        full = fit(trials(), WORLD, starts=2, weights=drawn)
        weighted = prepare(trials(), WORLD, fitted().model, fitted().settings, drawn)
        assert weighted.value(weighted.space.point(vector)) > full.objective - 0.1


def test_teachers_who_are_given_no_name_are_one_each() -> None:
    nameless = tuple(replace(trial, participant_id=None) for trial in trials())
    assert uncertainty(fitted(), nameless, method="wald").teachers == 18


def test_written_and_read_it_is_the_same() -> None:
    for method in ("likelihood", "wald", "bootstrap"):
        found = by(method)
        read = Uncertainty.from_dict(json.loads(json.dumps(found.to_dict())))
        assert read == replace(found, draws=None)
    with pytest.raises(ValueError, match=r"^uncertainty: not what Uncertainty.to_dict gives: "):
        Uncertainty.from_dict({"method": "wald"})
    with pytest.raises(KeyError, match=r"nose: no such parameter; there are mistake, that_mov\.peak"):
        found["nose"]


@pytest.mark.parametrize(
    ("low", "high", "open_low", "open_high", "text", "covered"),
    [
        (0.51, 1.4, False, False, "0.51 to 1.4", [False, True, False]),
        (0.5, 1.4, True, False, "< 1.4", [True, True, False]),
        (0.51, 10.0, False, True, "> 0.51", [False, True, True]),
        (0.5, 10.0, True, True, "any", [True, True, True]),
        (None, None, False, False, "", [False, False, False]),
    ],
)
def test_an_interval_is_said_in_words_and_open_ends_cover_what_is_beyond(
    low: float | None, high: float | None, open_low: bool, open_high: bool, text: str, covered: list[bool]
) -> None:
    interval = ParameterInterval(
        "that_mov.rise", 1.0, low=low, high=high, open_low=open_low, open_high=open_high
    )
    assert interval_text(interval) == text
    assert [interval.covers(value) for value in (0.1, 1.0, 20.0)] == covered


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        (
            {"method": "guess"},
            ValueError,
            "^method: must be one of likelihood, wald, bootstrap, not 'guess'$",
        ),
        ({"level": 95}, ValueError, "^level: must be above 0 and below 1, not 95$"),
        ({"method": "bootstrap", "resamples": 1}, ValueError, "^resamples: must be at least 2, not 1$"),
        ({"trials": ()}, FitError, "^no trials: uncertainty needs at least one$"),
        ({"trials": operator_trials(3, teacher())}, FitError, "^trials: not those of the fit"),
    ],
)
def test_what_cannot_be_asked_is_one_error(
    change: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        uncertainty(fitted(), change.pop("trials", trials()), **change)


def test_one_teacher_alone_cannot_be_drawn_again() -> None:
    alone = trials(teachers=1)
    with pytest.raises(ValueError, match="needs at least two teachers"):
        uncertainty(fitted(), alone, method="bootstrap")
    assert all(each.robust_error is None for each in uncertainty(fitted(), alone, method="wald").intervals)


@pytest.mark.parametrize("method", ["likelihood", "bootstrap"])
def test_bands_hold_the_plateau_between_the_ends_of_the_peak(method: str) -> None:
    found, model = by(method), fitted().model
    low, high = table_top_bands(found, model)("that_mov", np.array([-1.0, 0.7, 50.0]), "on")
    assert low[0] == high[0] == 0
    assert (low <= high).all()
    peak = found["that_mov.peak"]
    assert (low[-1], high[-1]) == pytest.approx((peak.low, peak.high), rel=0.02)


def test_a_band_is_drawn_behind_its_model_and_needs_draws() -> None:
    found, model = by("likelihood"), fitted().model
    bands = {"learned": table_top_bands(found, model)}
    ax = table_top({"learned": model, "other": teacher()}, "that_mov", bands=bands)
    assert len(ax.collections) == 1
    with pytest.raises(ValueError, match=r"^bands: need an uncertainty just made by"):
        table_top_bands(by("wald"), model)


def test_a_profile_curve_passes_the_ends_of_the_interval_at_the_drop_and_nowhere_exceeds_the_fit() -> None:
    one = by("likelihood")["that_dist.peak"]
    values, drops = profile_curve(fitted(), trials(), "that_dist.peak", points=9)
    assert (np.diff(values) > 0).all()
    assert drops.min() == pytest.approx(0, abs=1e-3)
    assert values[drops.argmin()] == pytest.approx(one.estimate, rel=1e-6)
    assert np.interp([one.low or 0, one.high or 0], values, drops) == pytest.approx(1.92, abs=0.15)
    with pytest.raises(KeyError, match=r"that_dist\.delay: not among the parameters that were learned"):
        profile_curve(fitted(), trials(), "that_dist.delay")
    ax = profile_plot((values, drops), one, truth=0.15)
    assert {line.get_label() for line in ax.lines} >= {"profile", "interval", "truth"}


def test_the_figure_of_coverage_has_a_line_for_every_row_of_every_table() -> None:
    row = {"parameter": "mistake", "coverage": "0.94", "coverage_low": "0.9", "coverage_high": "0.97"}
    tables = {"profile": [row, row | {"parameter": "that_mov.peak"}], "standard error": [row]}
    ax = coverage_plot(tables)
    assert [text.get_text() for text in ax.get_yticklabels()] == ["mistake", "that_mov.peak"]
    assert sum(len(line.get_xdata()) == 2 for line in ax.lines) >= 3  # type: ignore[arg-type]
    legend = ax.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["profile", "standard error"]


def test_shared_delays_and_decays_have_one_interval_each() -> None:
    tops = {s: replace(top, delay=0.3, decay=3.0, hold=1.0) for s, top in teacher().approvals.items()}
    late = operator_trials(6, replace(teacher(), approvals=tops), seed=4)
    result = fit(late, WORLD, starts=1, delays="shared", decays="shared")
    found = uncertainty(result, late)
    for kind in ("delay", "decay"):
        own = [found[f"{state}.{kind}"] for state in tops]
        assert own[0].how == "profile"
        assert len({(each.low, each.high) for each in own}) == 1
        assert own[0].covers(own[0].estimate)
