"""Whether a robot is right as often as it says: what it believed, against the teacher's card."""

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from learn.bootstrap import Interval, Resampling, ratio_intervals
from learn.closed_loop import Outcome
from learn.reliability import Scores, reliability_table, scores

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
THRESHOLDS = (
    0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.92, 0.94, 0.95, 0.96, 0.97, 0.98, 0.984, 0.987, 0.99, 0.992, 0.994,
    0.995, 0.996, 0.997, 0.998, 0.9985, 0.999, 0.9993, 0.9995, 0.9997, 0.9998, 0.9999,
)  # fmt: skip
ENOUGH = 0.5  # a threshold is asked about where at least this share of the trials passed it


@dataclass(frozen=True, slots=True)
class Needed:
    """The least threshold from which on a robot is right in a share `goal` of the trials that pass it.

    `threshold` is the estimate, `low` and `high` its 95% interval; infinite where no threshold does it
    of those asked about, up to `most` (not a number where too few trials passed any). `reached` is the
    share of the resamples in which there is one.
    """

    goal: float
    threshold: float
    low: float
    high: float
    reached: float
    most: float

    def __str__(self) -> str:
        if math.isnan(self.most):
            return "too few trials passed any threshold"
        named = [
            f"none up to {self.most:g}" if math.isinf(t) else f"{t:g}" for t in (self.threshold, self.high)
        ]
        low = named[1] if math.isinf(self.low) else f"{self.low:g}"
        return f"{named[0]} ({low} to {named[1]})"

    def to_json(self) -> dict[str, float | None]:
        """Plain numbers; None where there is none."""
        names = ("goal", "threshold", "low", "high", "reached", "most")
        values = {name: float(getattr(self, name)) for name in names}
        return {name: value if math.isfinite(value) else None for name, value in values.items()}


@dataclass(frozen=True)
class Calibration:
    """Of the first moment a trial's belief passed `threshold`: in how many trials, how often right.

    `rows` is the reliability table: for the probability of the likeliest task in each range, the steps
    in it, the mean probability said, and the share of them in which that task was the teacher's.
    `curve` asks the same as `right` of other thresholds, a row for each: `passed` trials of them all,
    the mean probability then `said`, the share `right`, and the mean `seconds` to it (a trial that did
    not get there counts at its length), the last two with `_low` and `_high`. `needed` says which
    threshold it takes to be right as often as asked, `scores` judges every moment (None without any).
    """

    threshold: float
    trials: int
    sure: int
    right: Interval
    said: float
    rows: tuple[dict[str, Any], ...]
    curve: tuple[dict[str, Any], ...]
    needed: Needed
    scores: Scores | None

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "threshold": self.threshold,
            "trials": self.trials,
            "sure": self.sure,
            "said": self.said if self.sure else None,
            "right": self.right.to_json(),
            "reliability": list(self.rows),
            "curve": [{key: _plain(value) for key, value in row.items()} for row in self.curve],
            "needed": self.needed.to_json(),
            "scores": None if self.scores is None else self.scores.to_json(),
        }


def _plain(value: float) -> float | None:
    return value if math.isfinite(value) else None


class _First(NamedTuple):
    """The first moment above each threshold, each (trials, thresholds); 0 where not `passed`."""

    passed: Bools
    said: Floats
    right: Bools
    steps: Floats


def calibration(
    outcomes: Sequence[Outcome],
    groups: Sequence[Hashable] | None = None,
    threshold: float = 0.98,
    *,
    goal: float = 0.98,
    ended_at: float = 1.0,
    dt: float = 0.5,
) -> Calibration:
    """Judge beliefs by the tasks that turned out true; steps of one trial are not independent.

    Intervals resample `groups` (whose trials they are). Up to the first moment above a threshold, a
    robot with that threshold does what one with a higher one does: so trials that were `ended_at` a
    threshold say exactly what any lower one would have come to, and nothing of higher ones, which are
    not asked about. A belief under the true model is right as often as it says at every such moment.
    `goal` is the share right that a threshold is sought for; `dt` is the step in seconds. Raises
    ValueError for probabilities that are none, a threshold above `ended_at`, or not one group a trial.
    """
    names = list(range(len(outcomes))) if groups is None else list(groups)
    if len(names) != len(outcomes):
        raise ValueError(f"groups: {len(names)} names for {len(outcomes)} trials")
    for name, value in (("threshold", threshold), ("goal", goal), ("ended_at", ended_at)):
        if not 0 < value <= 1:
            raise ValueError(f"{name}: must be above 0 and at most 1, not {value!r}")
    if threshold > ended_at:
        raise ValueError(f"threshold: {threshold:g} says nothing, as the trials were ended at {ended_at:g}")
    drawn = Resampling.of(names)
    asked = np.array(sorted({threshold, *(t for t in THRESHOLDS if t <= ended_at)}))
    first = _first(outcomes, asked)
    curve = _curve(first, asked, drawn, dt)
    at = curve[int(np.searchsorted(asked, threshold))]
    return Calibration(
        threshold=threshold,
        trials=len(outcomes),
        sure=at["passed"],
        right=Interval(at["right"], at["right_low"], at["right_high"], drawn.counts.shape[1]),
        said=at["said"],
        rows=reliability_table(outcomes, drawn),
        curve=curve,
        needed=_needed(first, asked, drawn, goal),
        scores=scores(outcomes, drawn),
    )


def _first(outcomes: Sequence[Outcome], asked: Floats) -> _First:
    shape = (len(outcomes), len(asked))
    first = _First(np.zeros(shape, np.bool_), np.zeros(shape), np.zeros(shape, np.bool_), np.zeros(shape))
    for n, outcome in enumerate(outcomes):
        at = np.searchsorted(np.maximum.accumulate(outcome.highest), asked, side="right")
        passed = at < len(outcome.highest)
        first.passed[n] = passed
        first.said[n, passed] = outcome.highest[at[passed]]
        first.right[n, passed] = outcome.right[at[passed]]
        first.steps[n] = np.where(passed, at, outcome.steps)
    return first


def _curve(first: _First, asked: Floats, drawn: Resampling, dt: float) -> tuple[dict[str, Any], ...]:
    share = ratio_intervals(first.right, first.passed, drawn)
    time = ratio_intervals(first.steps * dt, np.ones_like(first.steps), drawn)
    count = first.passed.sum(axis=0)
    said = np.divide(first.said.sum(axis=0), count, out=np.full(len(asked), np.nan), where=count > 0)
    return tuple(
        {"threshold": float(t), "passed": int(count[n]), "said": float(said[n])}
        | {"right": share[n].estimate, "right_low": share[n].low, "right_high": share[n].high}
        | {"seconds": time[n].estimate, "seconds_low": time[n].low, "seconds_high": time[n].high}
        for n, t in enumerate(asked)
    )


def _needed(first: _First, asked: Floats, drawn: Resampling, goal: float) -> Needed:
    kept = first.passed.mean(axis=0) >= ENOUGH if len(first.passed) else np.zeros(len(asked), np.bool_)
    if not kept.any():
        return Needed(goal, math.inf, math.inf, math.inf, 0.0, math.nan)
    (right, many_right), (passed, many_passed) = drawn.sums(first.right), drawn.sums(first.passed)
    there = np.append(asked[kept], math.inf)
    least = goal * (1 - 1e-12)  # 49 of 50 are 98%
    estimate = _least((right >= least * passed)[None, kept])[0]
    resampled = _least((many_right >= least * many_passed)[:, kept])
    low, high = np.quantile(resampled, [0.025, 0.975], method="inverted_cdf")
    reached, most = float((resampled < kept.sum()).mean()), float(there[-2])
    return Needed(goal, float(there[estimate]), float(there[low]), float(there[high]), reached, most)


def _least(enough: Bools) -> NDArray[np.int64]:
    """In each row the first place from which on all are true, or the number of places."""
    onward = np.logical_and.accumulate(enough[:, ::-1], axis=1)[:, ::-1]
    return np.asarray(enough.shape[1] - onward.sum(axis=1), dtype=np.int64)
