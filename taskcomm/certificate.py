"""How far from optimal an action can be at a horizon that the search did not finish.

Let x_k = E[C after step k] under a policy that begins with an action, in nats. Whatever the policy,

    x_1 is known,  0 <= x_k <= x_{k-1}  (expected entropy never rises),  x_{k-1} - x_k <= told_k,

and x_1 + ... + gamma^(j-1) x_j >= Q_j for every horizon j that was searched. The bounds below follow from
these alone; nothing is assumed of returns, which need not decrease.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Looked(NamedTuple):
    """What a search of `horizon` steps, ended or not, says, in nats.

    Bounds on Q_horizon by action; `first` (actions,) is x_1, `told` (horizon,) the most that each step can
    tell under any policy, infinite where nothing is known of it.
    """

    horizon: int
    lower: Floats
    upper: Floats
    first: Floats
    told: Floats


@dataclass(frozen=True)
class Certificate:
    """Bounds on Q of every action, in nats, at a `horizon` that may lie beyond the one reached.

    `lower` and `upper` enclose Q_horizon by action, in canonical order. `regret` is the most that the chosen
    action can cost above the best one at that horizon (its optimality gap), `optimal` whether the action is
    proven to be a best one there, ties within 1e-9 aside; `regret` is 0 then.
    """

    horizon: int
    lower: dict[Any, float]
    upper: dict[Any, float]
    regret: float
    optimal: bool

    def to_json(self) -> dict[str, Any]:
        """All of it as plain values."""
        return {
            "horizon": self.horizon,
            "lower": {str(action): value for action, value in self.lower.items()},
            "upper": {str(action): value for action, value in self.upper.items()},
            "regret": self.regret,
            "optimal": self.optimal,
        }


def certificate(
    actions: Sequence[Any],
    chosen: int,
    horizon: int,
    lower: Floats,
    upper: Floats,
    tie: float,
    same: Collection[int] = (),
) -> Certificate:
    """What bounds on Q_horizon prove of the action `chosen`.

        Q(chosen) - min_a Q(a) <= max(0, upper(chosen) - min_{a not chosen, not same} lower(a))

    since the least is either at the chosen action or at another; `same` are actions whose Q is that of the
    chosen one, whatever it is. Up to `tie` (nats) counts as 0.
    """
    least, most = lower.tolist(), upper.tolist()
    others = [bound for a, bound in enumerate(least) if a != chosen and a not in same]
    regret = max(0.0, most[chosen] - min(others, default=np.inf))
    return Certificate(
        horizon=horizon,
        lower=dict(zip(actions, least, strict=True)),
        upper=dict(zip(actions, most, strict=True)),
        regret=regret if regret > tie else 0.0,
        optimal=regret <= tie,
    )


def most_told(mistake: float, peaks: Floats, likeliest: float) -> float:
    """The most that any one step can tell about the task, in nats.

    P(press) lies in [mu, mu + sum of peaks] whatever the memory, so a step tells at most the capacity of
    the channel with these two points; and at most the divergence from what the likeliest task
    (of probability `likeliest`) makes of it, which the other tasks pay: (1 - likeliest) max KL.

    >>> round(most_told(0.005, np.array([0.1, 0.1, 0.1]), 1 / 24), 4)
    0.1119
    """
    low, high = mistake, mistake + float(peaks.sum())
    if high <= low:
        return 0.0
    slope = (_h2(high) - _h2(low)) / (high - low)
    press = 1.0 / (1.0 + np.exp(slope))
    capacity = _h2(press) - _h2(low) - (press - low) * slope
    apart = max(_divergence(high, low), _divergence(low, high))
    return float(min(np.log(2.0), max(0.0, capacity), (1.0 - likeliest) * apart))


def enclosed(looked: Sequence[Looked], told: Floats, gamma: float) -> tuple[Floats, Floats]:
    """Lower and upper bounds on Q_H by action, H = len(told), in nats.

    `looked` are searches of horizons up to H, at least one; `told` (H,) is the most that each step can tell,
    whatever they say of it.

        Q_H <= Q_h + (gamma^h + ... + gamma^(H-1)) x_h       under the policy of Q_h, and anything after
        Q_H >= Q_h + sum_{k > h} gamma^(k-1) min x_k         over all policies
    """
    first, told = looked[-1].first, told.copy()
    for one in looked:
        told[: one.horizon] = np.minimum(told[: one.horizon], one.told)
    sums = _least(looked, first, told, gamma)
    weight = _weights(gamma, len(told))
    upper = first * weight.sum()
    for one in looked:
        beyond = weight[one.horizon :].sum() * _last(sums, first, one.upper, one.horizon, weight)
        upper = np.minimum(upper, one.upper + beyond)
    return np.minimum(sums[-1], upper), upper  # they may cross by rounding


def _last(sums: Floats, first: Floats, most: Floats, horizon: int, weight: Floats) -> Floats:
    """The most that x_horizon can be under the policy whose Q_horizon is `most` or less.

    For i < horizon its steps i + 1 to horizon cost at most `most` - sums[i], and each no less than the last.
    """
    last = first
    for i in range(horizon):
        before, late = sums[i - 1] if i > 0 else 0.0, weight[i:horizon].sum()
        if late > 0.0:
            last = np.minimum(last, (most - before) / late)
    return np.maximum(last, 0.0)


def _least(looked: Sequence[Looked], first: Floats, told: Floats, gamma: float) -> Floats:
    """Lower bounds on x_1 + ... + gamma^(k-1) x_k under any policy, (H, actions).

    x_k is least where entropy stays at x_1 as long as it may and then falls as fast as it can: with
    fall_i = told_{i+1} + ... + told_k, for every m

        sum_k <= sum_{i <= m} gamma^(i-1) x_1 + sum_{i > m} gamma^(i-1) (x_k + fall_i),  solved for x_k.
    """
    horizon = len(told)
    known = np.zeros((horizon, len(first)))
    for one in looked:
        known[one.horizon - 1] = np.maximum(known[one.horizon - 1], one.lower)
    weight = _weights(gamma, horizon)
    sums = np.zeros((horizon, len(first)))
    sums[0] = least = first
    for k in range(1, horizon):
        falling = np.maximum(0.0, least - told[k])
        sums[k] = np.maximum(known[k], sums[k - 1] + weight[k] * falling)
        fall = told[1 : k + 1][::-1].cumsum()[::-1]
        late = weight[1 : k + 1][::-1].cumsum()[::-1]  # by m, from 1 to k, like what follows
        fallen = np.append(weight[1:k] * fall[1:], 0.0)[::-1].cumsum()[::-1]
        paid = weight.cumsum()[:k, None] * first + fallen[:, None]
        counts = late > 0.0  # not so where gamma is so small that steps weigh nothing
        solved = (sums[k] - paid[counts]) / late[counts, None]
        falling = np.maximum(falling, solved.max(axis=0, initial=0.0))
        least = falling
    return sums


def _weights(gamma: float, horizon: int) -> Floats:
    return np.asarray(gamma ** np.arange(horizon), dtype=np.float64)


def _h2(p: float) -> float:
    return float(-_xlogx(p) - _xlogx(1.0 - p))


def _xlogx(x: float) -> float:
    return x * float(np.log(x)) if x > 0.0 else 0.0


def _divergence(p: float, q: float) -> float:
    """KL of press probability p from q, in nats; infinite where q is 1 and p is not."""
    if q >= 1.0:
        return float(np.inf)
    return _xlogx(p) + _xlogx(1.0 - p) - p * float(np.log(q)) - (1.0 - p) * float(np.log(1.0 - q))
