"""The rows of a belief, weights of (task, memory), through one step: branched, merged, pruned."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from taskcomm.levels import Bools, Floats
from taskcomm.observation import WAITING
from taskcomm.teacher import Parameters


class Rows(NamedTuple):
    """`task` (R,), `weight` (R,), and the memory: `level` and `on_time`, each (R, M)."""

    task: NDArray[np.int64]
    weight: Floats
    level: Floats
    on_time: Floats

    def where(self, kept: Bools) -> "Rows":
        return Rows(self.task[kept], self.weight[kept], self.level[kept], self.on_time[kept])


def branched(rows: Rows, approval: Floats, mistake: float, told: Floats) -> Rows:
    """Every row for M without a reset, and again for every approval that can be, with its reset.

    `approval` (R, M) is P(M_t = m) of each row, `told` P(observation | M): (2 + M,), or by row (R, 2 + M).
    """
    number, states = rows.level.shape
    possible: list[bool] = list(np.any(np.atleast_2d(told), axis=0))
    waiting, erring, told = told[..., WAITING], told[..., 1], told[..., 2:]
    unreset = mistake * erring
    if possible[WAITING]:
        unreset = unreset + (1 - mistake - approval.sum(axis=1)) * waiting
    weight = rows.weight * unreset
    resets = [m for m in range(states) if possible[2 + m]]
    if not resets:
        return rows._replace(weight=weight)
    times = len(resets) + 1
    weight = np.concatenate([weight, *(rows.weight * approval[:, m] * told[..., m] for m in resets)])
    level, on_time = np.tile(rows.level, (times, 1)), np.tile(rows.on_time, (times, 1))
    for block, m in enumerate(resets, 1):
        reset = slice(block * number, (block + 1) * number)
        level[reset, m] = on_time[reset, m] = 0.0
    return Rows(np.tile(rows.task, times), weight, level, on_time)


def merged(rows: Rows, parameters: Parameters) -> Rows:
    """Rows of weight 0 dropped, rows of equal task and memory added up, sorted by task."""
    if not rows.weight.all():
        rows = rows.where(rows.weight > 0)
    task, weight, level, on_time = rows
    if len(task) < 2 or (task[1:] > task[:-1]).all():
        return rows
    order, starts = alike(task, level, on_time, parameters)
    kept = order[starts]
    return Rows(task[kept], np.add.reduceat(weight[order], starts), level[kept], on_time[kept])


def alike(
    task: NDArray[np.int64], level: Floats, on_time: Floats, parameters: Parameters
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """An order of the rows, by task, in which equal task and memory stand together, and where each begins."""
    memory = level
    if parameters.decays:
        memory = np.concatenate([level, on_time * np.isfinite(parameters.decay)], axis=1)
    order = np.lexsort((*memory.T, task))
    task, memory = task[order], memory[order]
    first = np.ones(len(task), dtype=np.bool_)
    first[1:] = (task[1:] != task[:-1]) | (memory[1:] != memory[:-1]).any(axis=1)
    return order, np.flatnonzero(first)


def pruned(rows: Rows, share: float) -> tuple[Rows, Rows]:
    """The rows without the lightest, which weigh at most `share` together; and those."""
    order = np.argsort(rows.weight, kind="stable")
    kept = np.ones(len(order), dtype=np.bool_)
    kept[order[np.cumsum(rows.weight[order]) <= share]] = False
    return rows.where(kept), rows.where(~kept)


def most_likely(told: Floats, approval: Floats, mistake: float) -> Floats:
    """The most that any memory makes of P(observation | task), (tasks,).

    `told` (tasks, 2 + M) is P(observation | M, task), `approval` (tasks, M) the most that P(M = m) can be.
    """
    gain = np.maximum(0.0, told[..., 2:] - told[..., WAITING, None])
    unreset = mistake * told[..., 1] + (1 - mistake) * told[..., WAITING]
    return np.asarray(unreset + (approval * gain).sum(axis=1))
