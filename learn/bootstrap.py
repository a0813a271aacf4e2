"""Intervals by resampling people: the trials of one person are not independent of each other."""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


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


@dataclass(frozen=True, slots=True)
class Resampling:
    """Whole groups drawn anew: `member` (values,) is the group of each value, `counts` (resamples, groups).

    `groups` names whom each value came from.
    """

    member: NDArray[np.int64]
    counts: NDArray[np.int64]

    @classmethod
    def of(cls, groups: Sequence[Hashable], resamples: int = 4000, seed: int = 0) -> Self:
        """As many groups as there are, with replacement, `resamples` times."""
        order = {name: index for index, name in enumerate(dict.fromkeys(groups))}
        member = np.array([order[name] for name in groups], dtype=np.int64)
        if not order:
            return cls(member, np.zeros((resamples, 0), dtype=np.int64))
        share = np.full(len(order), 1 / len(order))
        return cls(member, np.random.default_rng(seed).multinomial(len(order), share, size=resamples))

    def sums(self, values: ArrayLike) -> tuple[Floats, Floats]:
        """Sums of the columns of `values` (values, columns): as they are, and in every resample."""
        of_groups = np.zeros((self.counts.shape[1], np.shape(values)[1]))
        np.add.at(of_groups, self.member, np.asarray(values, dtype=np.float64))
        return of_groups.sum(axis=0), self.counts @ of_groups


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
    drawn = Resampling.of(names, resamples, seed)
    (found,) = ratio_intervals(above[:, None], below[:, None], drawn, level)
    return found


def ratio_intervals(
    numerator: ArrayLike, denominator: ArrayLike, drawn: Resampling, level: float = 0.95
) -> tuple[Interval, ...]:
    """`ratio_interval` of every column of (values, columns), all from the same resamples."""
    (tops, many_tops), (bottoms, many_bottoms) = drawn.sums(numerator), drawn.sums(denominator)
    found, groups = [], drawn.counts.shape[1]
    for column, bottom in enumerate(bottoms):
        if bottom == 0:
            found.append(Interval(float("nan"), float("nan"), float("nan"), groups))
            continue
        kept = many_bottoms[:, column] != 0
        ratios = many_tops[kept, column] / many_bottoms[kept, column]
        low, high = np.quantile(ratios, [(1 - level) / 2, (1 + level) / 2])
        found.append(Interval(float(tops[column] / bottom), float(low), float(high), groups))
    return tuple(found)
