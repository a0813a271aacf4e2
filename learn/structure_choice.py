"""The choice among structures that were tried, and what can be claimed of each factor."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from learn.candidate_fits import Bench, Candidate
from learn.candidates import Value, spoken


@dataclass(frozen=True)
class Answer:
    """What the trials say of one factor.

    `weights` by value are BIC weights, exp(-BIC / 2) over their sum, each value with the best structure that
    has it. `named` are the fewest values whose weights sum to `confidence`, and with them the chosen one
    (first): the claim is that the true value is among them as often as that. More than one of them: the
    trials cannot tell.
    """

    factor: str
    chosen: Value
    named: tuple[Value, ...]
    weights: Mapping[Value, float]

    @property
    def told(self) -> bool:
        """Whether one value alone is named."""
        return len(self.named) == 1

    def __str__(self) -> str:
        chosen, *others = map(spoken, self.named)
        return chosen if not others else f"{chosen}; cannot tell from {', '.join(others)}"


def rank(candidate: Candidate, bench: Bench) -> tuple[int, float]:
    """To sort by: the best held-out first, then by BIC those without, then those that were given up."""
    if candidate.held_out is not None:
        return 0, -candidate.total
    return (1, candidate.bic(bench.num_people)) if candidate.behind is None else (2, candidate.behind)


def gap(bench: Bench, candidate: Candidate, other: Candidate) -> tuple[float, float]:
    """Held-out log-likelihood of one minus the other, in nats, and its standard error over people."""
    assert candidate.held_out is not None
    assert other.held_out is not None
    differences = bench.by_person(candidate.held_out - other.held_out)
    return float(differences.sum()), float(np.sqrt(bench.num_people) * differences.std(ddof=1))


def simplest_within_one_error(candidates: Sequence[Candidate], bench: Bench) -> Candidate:
    """The fewest parameters within one standard error of the best held-out; of equals, the best.

    One with a decay that is as good as none is not chosen, where there is another.
    """
    every = [candidate for candidate in candidates if candidate.held_out is not None]
    scored = [candidate for candidate in every if not candidate.idle] or every
    best = max(scored, key=lambda c: c.total)
    within = [c for c in scored if (short := gap(bench, c, best))[0] >= -short[1]]
    return min(within, key=lambda c: (c.num_free, -c.total))


def answer_of(
    factor: str, chosen: Candidate, everyone: Sequence[Candidate], people: int, confidence: float
) -> Answer:
    """What `everyone` that was tried says of a factor."""
    best: dict[Value, float] = {}
    for candidate in everyone:
        value = candidate.structure.value(factor)
        bic = candidate.bic(people) if candidate.behind is None else math.inf
        best[value] = min(best.get(value, math.inf), bic)
    least = min(best.values())
    raw = {value: math.exp(-(bic - least) / 2) for value, bic in best.items()}
    weights = {value: weight / sum(raw.values()) for value, weight in raw.items()}
    picked = chosen.structure.value(factor)
    named: list[Value] = []
    for value in sorted(weights, key=lambda value: -weights[value]):
        if sum(weights[each] for each in named) >= confidence:
            break
        named.append(value)
    others = tuple(value for value in named if value != picked)
    return Answer(factor, picked, (picked, *others), weights)
