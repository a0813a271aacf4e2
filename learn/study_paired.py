"""Two conditions compared within the people who went through both: differences, intervals, paired tests."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from learn.bootstrap import ratio_interval


@dataclass(frozen=True)
class Paired:
    """Differences of one measure, first condition minus second, one for each person.

    `t_low`, `t_high` is Student's interval of the mean, `bootstrap_low`, `bootstrap_high` the percentile
    interval with people resampled, both at 95%. `signed_rank` is the sum of the ranks of what is above
    zero, `signed_rank_p` its exact two-sided probability (`exact_signed_rank`). `higher`, `same` and `lower`
    count the people whose first is above, equal to, below their second; `sign_p` is the exact two-sided
    sign test of that. Not a number where there is none: an interval of one person, a test of no difference.
    """

    people: int
    mean_first: float
    mean_second: float
    mean_difference: float
    sd: float
    t_low: float
    t_high: float
    bootstrap_low: float
    bootstrap_high: float
    signed_rank: float
    signed_rank_p: float
    higher: int
    same: int
    lower: int
    sign_p: float

    def row(self) -> dict[str, Any]:
        """Plain values, None where there is none."""
        return {
            name: None if isinstance(value, float) and math.isnan(value) else value
            for name, value in asdict(self).items()
        }


def paired(first: Mapping[str, float], second: Mapping[str, float], seed: int = 0) -> Paired:
    """The comparison of a measure by person under two conditions; people without both are left out.

    Raises ValueError where nobody has both.

    >>> found = paired({"a": 9, "b": 8, "c": 7}, {"a": 7, "b": 8, "c": 6})
    >>> found.mean_difference, found.higher, found.same, found.lower
    (1.0, 2, 1, 0)
    """
    people = [person for person in first if person in second]
    if not people:
        raise ValueError("paired: nobody has both conditions")
    left = np.array([first[person] for person in people], dtype=np.float64)
    right = np.array([second[person] for person in people], dtype=np.float64)
    difference = left - right
    drawn = ratio_interval(difference, np.ones(len(people)), seed=seed)
    t_low, t_high = t_interval(difference)
    statistic, p = exact_signed_rank(difference)
    higher, lower = int((difference > 0).sum()), int((difference < 0).sum())
    alone = len(people) < 2
    return Paired(
        people=len(people),
        mean_first=float(left.mean()),
        mean_second=float(right.mean()),
        mean_difference=float(difference.mean()),
        sd=math.nan if alone else float(difference.std(ddof=1)),
        t_low=t_low,
        t_high=t_high,
        bootstrap_low=math.nan if alone else drawn.low,
        bootstrap_high=math.nan if alone else drawn.high,
        signed_rank=statistic,
        signed_rank_p=p,
        higher=higher,
        same=len(people) - higher - lower,
        lower=lower,
        sign_p=float(stats.binomtest(higher, higher + lower).pvalue) if higher + lower else math.nan,
    )


def t_interval(values: ArrayLike, level: float = 0.95) -> tuple[float, float]:
    """Student's interval of the mean; not a number for fewer than two values.

    >>> [round(end, 3) for end in t_interval([1.0, 2.0, 3.0])]
    [-0.484, 4.484]
    """
    seen = np.asarray(values, dtype=np.float64)
    if len(seen) < 2:
        return math.nan, math.nan
    half = float(stats.t.ppf((1 + level) / 2, len(seen) - 1)) * float(seen.std(ddof=1)) / math.sqrt(len(seen))
    return float(seen.mean()) - half, float(seen.mean()) + half


def exact_signed_rank(differences: ArrayLike) -> tuple[float, float]:
    """Wilcoxon's signed-rank test: the sum of the ranks above zero, and its exact two-sided probability.

    Differences of zero are dropped; ties share the mean of their ranks. Probabilities are over all ways of
    giving signs to the ranks seen, so they stay exact where there are ties, as ratings always have them.
    Not a number where all differences are zero.

    >>> exact_signed_rank([1.0, 2.0, 3.0])
    (6.0, 0.25)

    Source: F. Wilcoxon, Individual comparisons by ranking methods, Biometrics Bulletin 1 (1945).
    """
    seen = np.asarray(differences, dtype=np.float64)
    seen = seen[seen != 0]
    if not len(seen):
        return math.nan, math.nan
    doubled = np.rint(2 * stats.rankdata(np.abs(seen))).astype(np.int64)
    share = np.zeros(int(doubled.sum()) + 1)  # P(twice the rank sum)
    share[0] = 1.0
    for rank in doubled:
        share[rank:] = (share[rank:] + share[: len(share) - rank]) / 2
        share[:rank] /= 2
    above = int(doubled[seen > 0].sum())
    tail = min(share[: above + 1].sum(), share[above:].sum())
    return above / 2, min(1.0, 2 * float(tail))


def exception_sentence(found: Paired, what: str, first: str, second: str) -> str:
    """How many teachers went against the rest, and both means: as the paper gives its ratings."""
    if found.higher >= found.lower:
        above, below, against = (first, found.mean_first), (second, found.mean_second), found.lower
    else:
        above, below, against = (second, found.mean_second), (first, found.mean_first), found.higher
    who = f"With the exception of {against} of {found.people} teachers, all" if against else "All teachers"
    return (
        f"{who} have the same or a higher {what} with {above[0]} than with {below[0]}"
        f" (mean of {above[1]:.2f} vs. {below[1]:.2f}, n = {found.people})."
    )
