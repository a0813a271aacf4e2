"""Weighted fits of one channel of the observation model, mental state by mental state, by pomegranate.

A distribution's `summarize` takes the values seen with the responsibilities P(M_t = m | trial) as weights,
its `from_summaries` gives the parameters. Weak priors keep them off the edges.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from learn.without_jit import without_jit
from taskcomm.channels import NONE, Channel, NormalChannel, PlainChannel, TargetChannel
from taskcomm.lattice import Floats, Ints

PSEUDOCOUNT = 0.5  # of every value in every mental state: Jeffreys' prior
PSEUDO_SPREAD = 1.0  # one observation that lies at the overall standard deviation


def categorical(values: Sequence[str], seen: Ints, weight: Floats) -> dict[str, float]:
    """P(value) from values `seen`, as places among `values`, weighted: (weight of the value + PSEUDOCOUNT)
    over their sum.

    >>> categorical(["a", "b"], np.array([0, 0, 1]), np.array([1.0, 1.0, 1.0]))
    {'a': 0.625, 'b': 0.375}
    """
    torch, Categorical, _ = _pomegranate()
    even = torch.full((1, len(values)), 1 / len(values), dtype=torch.float64)
    distribution = Categorical(even, pseudocount=PSEUDOCOUNT, check_data=False)
    codes, place = np.unique(seen, return_inverse=True)
    if len(codes):
        summed = np.bincount(place, weight)
        distribution.summarize(torch.tensor(codes)[:, None], sample_weight=torch.tensor(summed)[:, None])
        distribution.from_summaries()
    probs = distribution.probs[0].detach().numpy()
    return dict(zip(values, map(float, probs / probs.sum()), strict=True))


def normal(values: Floats, weight: Floats, overall: float) -> tuple[float, float] | None:
    """Mean and standard deviation of weighted numbers; None where they weigh next to nothing.

    The variance is that of the numbers with PSEUDO_SPREAD more of them at `overall`.
    """
    total = float(weight.sum())
    if total < 1e-6:
        return None
    torch, _, Normal = _pomegranate()
    at_first = torch.zeros(1, dtype=torch.float64), torch.ones(1, dtype=torch.float64)
    distribution = Normal(*at_first, covariance_type="diag", check_data=False)
    # Seen from the heaviest of them: squares of numbers far from 0 could leave a variance below 0.
    origin = values[weight.argmax()]
    distribution.summarize(
        torch.tensor(values - origin)[:, None], sample_weight=torch.tensor(weight)[:, None]
    )
    distribution.from_summaries()
    mean = float(origin) + float(distribution.means[0])
    spread = max(0.0, float(distribution.covs[0]))
    variance = (total * spread + PSEUDO_SPREAD * overall**2) / (total + PSEUDO_SPREAD)
    return mean, float(np.sqrt(variance))


def log_prior(channel: Channel, overall: float = 1.0) -> float:
    """Log density of the weak priors, in nats, up to a constant."""
    if isinstance(channel, NormalChannel):
        sds = np.array(
            [sd for row in channel.sd.values() for sd in (row.values() if channel.target else [row])]
        )
        return float((-PSEUDO_SPREAD * (np.log(sds) + 0.5 * (overall / sds) ** 2)).sum())
    rows = [p for row in channel.table.values() for p in row.values()]
    return float(PSEUDOCOUNT * np.log(np.maximum(rows, 1e-300)).sum())


def count(channel: Channel) -> int:
    """How many numbers of a channel are free."""
    if isinstance(channel, NormalChannel):
        return 2 * len(channel.mean) * max(1, len(channel.roles))
    return sum(len(row) - 1 for row in channel.table.values())


def opened(channel: Channel) -> Channel:
    """The channel without probabilities of 0, from which EM could not move."""
    if isinstance(channel, NormalChannel):
        return channel
    table = {
        state: {value: (p + 1e-3) / (1 + 1e-3 * len(row)) for value, p in row.items()}
        for state, row in channel.table.items()
    }
    return type(channel)(table)


def first_guess(
    seen: Sequence[str | float], states: Sequence[str], roles: Mapping[str, str] | None
) -> Channel:
    """A channel that says nothing of M yet, for the signals `seen`: of a target where all of them are
    names in `roles` (or "none"), a plain one for other words, a normal one for numbers.
    """
    if all(isinstance(value, str) for value in seen):
        words = sorted({str(value) for value in seen})
        if roles and set(words) <= {*roles, NONE}:
            words = [*dict.fromkeys(roles.values()), NONE]
            return TargetChannel({state: dict.fromkeys(words, 1 / len(words)) for state in states})
        return PlainChannel({state: dict.fromkeys(words, 1 / len(words)) for state in states})
    numbers = np.array([float(value) for value in seen])
    spread = float(numbers.std()) or 1.0
    return NormalChannel(dict.fromkeys(states, float(numbers.mean())), dict.fromkeys(states, spread))


def _pomegranate() -> tuple[Any, Any, Any]:
    """torch, Categorical, Normal; they load when first needed."""
    with without_jit():
        import torch
        from pomegranate.distributions import Categorical, Normal
    return torch, Categorical, Normal
