"""What was said against what turned out, moment by moment: the reliability table and the scores."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from learn.bootstrap import Interval, Resampling, ratio_intervals
from learn.closed_loop import Outcome

Floats = NDArray[np.float64]
EDGES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98, 1.0)
LEAST_DOUBT = 2.0**-53  # what rounding can tell from certainty


@dataclass(frozen=True, slots=True)
class Scores:
    """Scores of the probability said of the likeliest task, means over all moments; 0 is the best.

    `brier` is the mean of (said - right)^2, `log` that of -log of what was said of the thing that came
    true, in nats. Over the ranges of the reliability table, brier = reliability - resolution +
    uncertainty + within: how far the shares are from what was said, how far they are from the overall
    share, the variance of being right, and what the spread of what was said within a range adds.

    Source: Murphy (1973); for `within`, Stephenson et al. (2008).
    """

    brier: Interval
    log: Interval
    reliability: float
    resolution: float
    uncertainty: float
    within: float

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        parts = ("reliability", "resolution", "uncertainty", "within")
        return {"brier": self.brier.to_json(), "log": self.log.to_json()} | {
            part: getattr(self, part) for part in parts
        }


def ranges(edges: Sequence[float] = EDGES) -> list[tuple[float, float]]:
    """The ranges of the table: above the first number, up to the second."""
    return list(pairwise(edges))


def _by_trial(outcomes: Sequence[Outcome], what: Any) -> Floats:
    """The sums of `what(said, right)` (moments, columns) over the moments of each trial."""
    return np.array([what(o.highest, o.right).sum(axis=0) for o in outcomes], dtype=np.float64)


def _within(said: Floats) -> NDArray[np.bool_]:
    """In which range each moment falls, (moments, ranges)."""
    return np.stack([(said > low) & (said <= high) for low, high in ranges()], axis=1)


def reliability_table(outcomes: Sequence[Outcome], drawn: Resampling) -> tuple[dict[str, Any], ...]:
    """A row for every range that occurs: `steps` in it, of how many `trials`, `said`, the mean
    probability, and `right`, the share in which that task was the teacher's, with its interval."""
    if not outcomes:
        return ()
    counts = _by_trial(outcomes, lambda said, right: _within(said))
    said = _by_trial(outcomes, lambda said, right: _within(said) * said[:, None])
    right = _by_trial(outcomes, lambda said, right: _within(said) & right[:, None])
    shares = ratio_intervals(right, counts, drawn)
    return tuple(
        {
            "above": low,
            "to": high,
            "steps": int(counts[:, n].sum()),
            "trials": int((counts[:, n] > 0).sum()),
            "said": float(said[:, n].sum() / counts[:, n].sum()),
            "right": shares[n].estimate,
            "low": shares[n].low,
            "high": shares[n].high,
        }
        for n, (low, high) in enumerate(ranges())
        if counts[:, n].any()
    )


def scores(outcomes: Sequence[Outcome], drawn: Resampling) -> Scores | None:
    """The scores over all moments of all trials; None where there are none."""
    rows = reliability_table(outcomes, drawn)
    if not rows:
        return None
    lost = _by_trial(outcomes, _lost)
    moments = np.array([len(o.highest) for o in outcomes], dtype=np.float64)
    brier, log = ratio_intervals(lost, np.stack([moments, moments], axis=1), drawn)
    steps, said, right = (np.array([row[key] for row in rows]) for key in ("steps", "said", "right"))
    weight = steps / steps.sum()
    overall = float(weight @ right)
    reliability, resolution = float(weight @ (said - right) ** 2), float(weight @ (right - overall) ** 2)
    uncertainty = overall * (1 - overall)
    within = brier.estimate - (reliability - resolution + uncertainty)
    return Scores(brier, log, reliability, resolution, uncertainty, within)


def _lost(said: Floats, right: NDArray[np.bool_]) -> Floats:
    """Both losses of every moment, (moments, 2)."""
    true = np.maximum(np.where(right, said, 1 - said), LEAST_DOUBT)
    return np.stack([(said - right) ** 2, -np.log(true)], axis=1)
