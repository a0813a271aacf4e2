"""What may be observed in a step: as few outcomes as tell the same, and the most that they can tell."""

from typing import Any

import numpy as np

from taskcomm.levels import Bools, Floats
from taskcomm.observation import WAITING, Observer
from taskcomm.teacher import Parameters

ROUNDS = 60


def distinct_outcomes(observer: Observer, rests: bool) -> tuple[Bools, Floats]:
    """Whether the key is pressed, and P(outcome | M, task), (outcomes, tasks, 2 + M).

    Outcomes in proportion lead to the same belief and are added up; a press is told from none (True, False)
    only where the model `rests` after presses, else all are False.
    """
    every = observer.outcomes()
    pressed, table = np.array(every.pressed) & rests, every.table
    groups: dict[Any, list[int]] = {}
    for outcome, one in enumerate(table):
        if one.any():
            key = bool(pressed[outcome]), np.round(one / one.max(), 14).tobytes()
            groups.setdefault(key, []).append(outcome)
    kept = list(groups.values())
    return pressed[[group[0] for group in kept]], np.array([table[group].sum(axis=0) for group in kept])


def xlogx(x: Floats) -> Floats:
    """x ln x in nats, with 0 ln 0 = 0."""
    return np.asarray(x * np.log(np.where(x > 0, x, 1.0)))


def capacity(table: Floats, parameters: Parameters) -> float:
    """The most that an outcome can tell of task and mental state together, in nats, at any memory.

        I <= max_x KL(P_x, q)    for every q;   x: a task, and all approval on one state or on none

    with q from some rounds of the algorithm of Blahut and Arimoto.
    """
    mu, most = parameters.mistake, float(parameters.peak.sum())
    waiting = table[:, :, WAITING]
    points = [(1 - mu) * waiting + mu * table[:, :, 1]]
    points += [points[0] + most * (table[:, :, m] - waiting) for m in range(2, table.shape[2])]
    inputs = np.unique(np.concatenate(points, axis=1).T, axis=0)
    share = np.full(len(inputs), 1 / len(inputs))
    for _ in range(ROUNDS):
        out = share @ inputs
        apart = (xlogx(inputs) - inputs * np.log(np.where(out > 0, out, 1.0))).sum(axis=1)
        share = share * np.exp(apart)
        share /= share.sum()
    return float(apart.max())
