"""The numbers of a study by condition: ratings, times, share right; and conditions compared by teacher."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from scipy import stats

from learn.report import markdown_table
from learn.study_background import background_sentences
from learn.study_paired import Paired, exception_sentence, paired, t_interval
from learn.study_trials import (
    as_number,
    by_condition,
    by_planner,
    counted,
    rated_items,
    ratings,
    source_note,
    teacher_of,
    time_to_final,
)
from taskcomm.trials import Trial


@dataclass(frozen=True)
class Measure:
    """Something measured of a trial; `of` gives None where there is nothing. A `share` is of 0 and 1."""

    name: str
    phrase: str
    of: Callable[[Trial], float | None]
    share: bool = False


def measures(trials: Sequence[Trial]) -> list[Measure]:
    """What these trials can be measured by: their ratings, times, presses, and how many were right."""
    rated = [
        Measure(
            f"said {item}" if plain else f"rating {item}",
            f"rating of {item}",
            _rating_of(item),
            share=plain,
        )
        for item, plain in rated_items(trials).items()
    ]
    return [
        *rated,
        Measure("time to Final (s)", "time to Final", time_to_final),
        Measure("presses", "number of presses", _presses),
        Measure("right", "share right", _right, share=True),
    ]


def _rating_of(item: str) -> Callable[[Trial], float | None]:
    def of(trial: Trial) -> float | None:
        value = ratings(trial).get(item)
        return None if value is None else as_number(value)

    return of


def _presses(trial: Trial) -> float | None:
    return float(trial.presses.sum()) if trial.reason in ("final", "timeout") else None


def _right(trial: Trial) -> float | None:
    return None if trial.correct is None else float(trial.correct)


def summary_rows(trials: Sequence[Trial]) -> list[dict[str, Any]]:
    """Every measure in every condition: n, mean, sd, median, range, and a 95% interval of the mean.

    The interval is Student's, over the means of the teachers; for a share it is Clopper and Pearson's exact
    one, over trials. None where there is none.
    """
    grouped, rows = by_condition(trials), []
    for measure in measures(trials):
        for condition, members in grouped.items():
            values = np.array([v for trial in members if (v := measure.of(trial)) is not None])
            teachers = by_teacher(members, measure)
            low, high = _share_interval(values) if measure.share else t_interval(list(teachers.values()))
            row = {"measure": measure.name, "condition": condition, "trials": len(members), "n": len(values)}
            row |= {"teachers": len(teachers)}
            some = len(values) > 0
            row |= {
                "mean": float(values.mean()) if some else None,
                "sd": float(values.std(ddof=1)) if len(values) > 1 else None,
                "median": float(np.median(values)) if some else None,
                "least": float(values.min()) if some else None,
                "greatest": float(values.max()) if some else None,
                "low": None if math.isnan(low) else low,
                "high": None if math.isnan(high) else high,
                "interval": "Clopper-Pearson" if measure.share else "Student",
            }
            rows.append(row)
    return rows


def _share_interval(values: "np.ndarray[Any, np.dtype[np.float64]]") -> tuple[float, float]:
    if not len(values):
        return math.nan, math.nan
    found = stats.binomtest(int(values.sum()), len(values)).proportion_ci(0.95, "exact")
    return float(found.low), float(found.high)


def by_teacher(trials: Sequence[Trial], measure: Measure) -> dict[str, float]:
    """The mean of a measure over the trials of each teacher who has it."""
    values: dict[str, list[float]] = {}
    for trial in trials:
        value = measure.of(trial)
        if value is not None:
            values.setdefault(teacher_of(trial), []).append(value)
    return {teacher: sum(of) / len(of) for teacher, of in values.items()}


def comparisons(trials: Sequence[Trial], seed: int = 0) -> list[tuple[Measure, str, str, Paired]]:
    """Every measure between every two conditions, over the teachers who have it in both."""
    grouped, found = by_condition(trials), []
    for measure in measures(trials):
        of = {condition: by_teacher(members, measure) for condition, members in grouped.items()}
        for first, second in combinations(grouped, 2):
            if of[first].keys() & of[second].keys():
                found.append((measure, first, second, paired(of[first], of[second], seed)))
    return found


def operator_rows(trials: Sequence[Trial]) -> list[dict[str, Any]]:
    """Every measure of the trials that each operator controlled: n, mean, sd; none of a single one."""
    controlled = [trial for trial in trials if trial.operator_id is not None and not by_planner(trial)]
    names = sorted({str(trial.operator_id) for trial in controlled})
    rows: list[dict[str, Any]] = []
    for measure in measures(controlled) if len(names) > 1 else ():
        for name in names:
            of = [measure.of(trial) for trial in controlled if trial.operator_id == name]
            values = [value for value in of if value is not None]
            row = {"measure": measure.name, "operator": name, "trials": len(of), "n": len(values)}
            row |= {"mean": float(np.mean(values)) if values else None}
            rows.append(row | {"sd": float(np.std(values, ddof=1)) if len(values) > 1 else None})
    return rows


def paired_rows(trials: Sequence[Trial], seed: int = 0) -> list[dict[str, Any]]:
    """`comparisons` as plain rows; a difference is the first condition minus the second."""
    return [
        {"measure": measure.name, "first": first, "second": second, **found.row()}
        for measure, first, second, found in comparisons(trials, seed)
    ]


def statistics_text(
    trials: Sequence[Trial], answers: Mapping[str, Sequence[float]] | None = None, seed: int = 0
) -> str:
    """The statistics as a section of Markdown: tables by condition and of differences, and what they say.

    `answers` are those of the participants in numbers, by item, such as their age.
    """
    grouped = by_condition(trials)
    counts = ", ".join(f"{counted(len(members), 'trial')} with {name}" for name, members in grouped.items())
    teachers = counted(len({teacher_of(trial) for trial in trials}), "teacher")
    rows = [
        [
            f"{row['measure']}, {row['condition']}",
            row["n"],
            *(_number(row[name]) for name in ("mean", "sd", "median")),
            _span(row["low"], row["high"]),
        ]
        for row in summary_rows(trials)
    ]
    parts = [
        f"{source_note(trials).capitalize()} of {teachers}: {counts}. Intervals are 95%: of means Student's"
        " over teachers, of shares Clopper and Pearson's over trials. Times are of trials that showed Final;"
        f" a timeout is not right.{_unfinished(trials)}",
        markdown_table(["measure, condition", "n", "mean", "sd", "median", "95% interval"], rows),
    ]
    background = " ".join(background_sentences(trials, answers or {}))
    parts += [*_differences(trials, seed), *([background] if background else [])]
    return "\n\n".join(parts) + "\n"


def _unfinished(trials: Sequence[Trial]) -> str:
    broken = sum(trial.reason not in ("final", "timeout") for trial in trials)
    return f" {counted(broken, 'trial')} did not run to an end: only ratings count of them." if broken else ""


def _differences(trials: Sequence[Trial], seed: int) -> list[str]:
    found = comparisons(trials, seed)
    if not found:
        return ["No teacher has two conditions: there are no paired differences."]
    rows = [
        [
            f"{measure.name}, {first} minus {second}",
            one.people,
            _number(one.mean_difference),
            _span(one.t_low, one.t_high),
            _span(one.bootstrap_low, one.bootstrap_high),
            _number(one.signed_rank_p, ".3g"),
            f"{one.higher} / {one.same} / {one.lower}",
            _number(one.sign_p, ".3g"),
        ]
        for measure, first, second, one in found
    ]
    columns = ["paired difference", "teachers", "mean", "Student 95%", "bootstrap 95%"]
    columns += ["signed-rank p", "higher / same / lower", "sign p"]
    said = [
        exception_sentence(one, measure.phrase, first, second)
        for measure, first, second, one in found
        if not measure.share and measure.name.startswith("rating")
    ]
    about = (
        "Differences within teachers, the first condition minus the second. The bootstrap resamples"
        " teachers; the signed-rank test (Wilcoxon) is exact with its ties, differences of zero dropped; the"
        " sign test too is exact. Both are two-sided. No correction for several measures."
    )
    return [about, markdown_table(columns, rows), *said]


def _number(value: float | None, form: str = ".2f") -> str:
    return "" if value is None or math.isnan(value) else f"{value:{form}}"


def _span(low: float | None, high: float | None) -> str:
    return f"{_number(low)} to {_number(high)}" if _number(low) else ""
