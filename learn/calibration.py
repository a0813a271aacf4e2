"""Whether a robot is right as often as it says: what it believed, against the teacher's card."""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from learn.bootstrap import Interval, ratio_interval
from learn.closed_loop import Outcome

EDGES = (0.0, 0.1, 0.25, 0.5, 0.75, 0.9, 0.98, 1.0)


@dataclass(frozen=True)
class Calibration:
    """Of the first moment a trial's belief passed `threshold`: in how many trials, how often right.

    `rows` is the reliability table: for the probability of the likeliest task in each range, the steps
    in it, the mean probability said, and the share of them in which that task was the teacher's.
    """

    threshold: float
    trials: int
    sure: int
    right: Interval
    said: float
    rows: tuple[dict[str, Any], ...]

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "threshold": self.threshold,
            "trials": self.trials,
            "sure": self.sure,
            "said": self.said if self.sure else None,
            "right": self.right.to_json(),
            "reliability": list(self.rows),
        }


def calibration(
    outcomes: Sequence[Outcome], groups: Sequence[Hashable] | None = None, threshold: float = 0.98
) -> Calibration:
    """Judge beliefs by the tasks that turned out true; steps of one trial are not independent.

    The interval of `right` resamples `groups` (whose trials they are).
    """
    names = list(range(len(outcomes))) if groups is None else list(groups)
    sure, right, said, whose = [], [], [], []
    for outcome, name in zip(outcomes, names, strict=True):
        passed = np.flatnonzero(outcome.highest > threshold)
        sure.append(bool(len(passed)))
        if len(passed):
            right.append(float(outcome.right[passed[0]]))
            said.append(float(outcome.highest[passed[0]]))
            whose.append(name)
    return Calibration(
        threshold=threshold,
        trials=len(outcomes),
        sure=sum(sure),
        right=ratio_interval(np.array(right), np.ones(len(right)), whose),
        said=float(np.mean(said)) if said else float("nan"),
        rows=tuple(_reliability(outcomes)),
    )


def _reliability(outcomes: Sequence[Outcome]) -> list[dict[str, Any]]:
    if not outcomes:
        return []
    highest = np.concatenate([outcome.highest for outcome in outcomes])
    right = np.concatenate([outcome.right for outcome in outcomes])
    rows = []
    for low, high in pairwise(EDGES):
        within = (highest > low) & (highest <= high)
        if within.any():
            said, share = float(highest[within].mean()), float(right[within].mean())
            rows.append({"above": low, "to": high, "steps": int(within.sum()), "said": said, "right": share})
    return rows
