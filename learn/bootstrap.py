"""Intervals by resampling people: the trials of one person are not independent of each other."""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike


@dataclass(frozen=True, slots=True)
class Interval:
    """An estimate and its percentile interval; `groups` is how many groups were resampled."""

    estimate: float
    low: float
    high: float
    groups: int

    def __str__(self) -> str:
        return f"{self.estimate:.3g} ({self.low:.3g} to {self.high:.3g})"

    def to_json(self) -> dict[str, float | int | None]:
        """Plain numbers; None where there is none."""
        values = {"estimate": self.estimate, "low": self.low, "high": self.high}
        found: dict[str, float | int | None] = {k: v if np.isfinite(v) else None for k, v in values.items()}
        return found | {"groups": self.groups}


def ratio_interval(
    numerator: ArrayLike,
    denominator: ArrayLike,
    groups: Sequence[Hashable] | None = None,
    *,
    level: float = 0.95,
    resamples: int = 4000,
    seed: int = 0,
) -> Interval:
    """sum(numerator) / sum(denominator) with its bootstrap interval, whole groups resampled.

    One value per trial; `groups` names whom it came from (every trial its own if None). With ones
    below it is a mean, with paired differences above a mean difference, with two times a ratio of
    mean times. Not a number where the denominator is 0; the interval of a single group has no width.

    >>> ratio_interval([1.0, 2.0, 3.0], [1.0, 1.0, 1.0]).estimate
    2.0
    """
    above, below = np.asarray(numerator, dtype=np.float64), np.asarray(denominator, dtype=np.float64)
    if above.shape != below.shape or above.ndim != 1:
        raise ValueError(f"numerator {above.shape} and denominator {below.shape} must be equally long")
    names = list(range(len(above))) if groups is None else list(groups)
    if len(names) != len(above):
        raise ValueError(f"groups: {len(names)} names for {len(above)} values")
    order = {name: index for index, name in enumerate(dict.fromkeys(names))}
    member = np.array([order[name] for name in names], dtype=np.int64)
    sums = [np.bincount(member, weights=values, minlength=len(order)) for values in (above, below)]
    if not len(order) or sums[1].sum() == 0:
        return Interval(float("nan"), float("nan"), float("nan"), len(order))
    rng = np.random.default_rng(seed)
    counts = rng.multinomial(len(order), np.full(len(order), 1 / len(order)), size=resamples)
    tops, bottoms = counts @ sums[0], counts @ sums[1]
    kept = bottoms != 0
    low, high = np.quantile(tops[kept] / bottoms[kept], [(1 - level) / 2, (1 + level) / 2])
    return Interval(float(sums[0].sum() / sums[1].sum()), float(low), float(high), len(order))
