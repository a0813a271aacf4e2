"""Press probabilities without a teacher model: one for all steps, or one for each time since a change."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from taskcomm.lattice import Bools, Floats, Ints
from taskcomm.smoother import cue_tables, index_of_task
from taskcomm.trials import Trial

# Bins of steps since the cues last changed: [0, 1), [1, 2), ... [4, 6), [6, 8), [8, 12), [12, 16), ...
EDGES = np.array([0, 1, 2, 3, *(part << n for n in range(1, 9) for part in (2, 3))], dtype=np.int64)
Cell = tuple[bytes, int]


def steps_since_change(cues: Bools) -> Ints:
    """How many steps ago any of the cues (T, C) last changed, 0 where it just has, or the trial began.

    >>> steps_since_change(np.array([[0], [0], [1], [1], [0]], dtype=np.bool_)).tolist()
    [0, 1, 0, 1, 0]
    """
    steps = np.arange(len(cues))
    changed = np.ones(len(cues), dtype=np.bool_)
    changed[1:] = (cues[1:] != cues[:-1]).any(axis=1)
    return np.asarray(steps - np.maximum.accumulate(np.where(changed, steps, 0)), dtype=np.int64)


def cells(trial: Trial) -> Iterator[tuple[Cell, Ints]]:
    """The steps of a trial by cell: which cues are on, and the bin of the steps since they changed."""
    world = trial.world
    task = index_of_task(trial, world, trial.task)
    cues = cue_tables(trial, world, np.arange(len(world.cue_names)))[:, :, task]
    bins = np.searchsorted(EDGES, steps_since_change(cues), side="right") - 1
    starts = np.flatnonzero(np.diff(bins, prepend=-1) | (steps_since_change(cues) == 0))
    for first, last in zip(starts, [*starts[1:], len(cues)], strict=True):
        yield (cues[first].tobytes(), int(bins[first])), np.arange(first, last)


@dataclass(frozen=True)
class FreeBins:
    """Piecewise-constant press probability: one number for each cell, nothing remembered of presses.

    A cell is a set of cues that are on, with a bin of EDGES: how many steps ago any cue changed. Its
    probability is (presses + pooled) / (steps + 1), over the recorded steps in it: one step at the
    `pooled` probability is added to each, and a cell that was never met has that one. Without `cells` it
    is a constant, (presses + 1/2) / (steps + 1).
    """

    pooled: float
    cells: Mapping[Cell, float]

    @classmethod
    def fit(cls, trials: Sequence[Trial], constant: bool = False) -> "FreeBins":
        """The probabilities of `trials`, whose tasks must be known."""
        presses = sum(int(trial.presses.sum()) for trial in trials)
        pooled = (presses + 0.5) / (sum(int(trial.recorded.sum()) for trial in trials) + 1)
        counts: dict[Cell, Floats] = {}
        for trial in () if constant else trials:
            pressed, recorded = trial.presses, trial.recorded
            for cell, steps in cells(trial):
                counts.setdefault(cell, np.zeros(2))
                counts[cell] += pressed[steps].sum(), recorded[steps].sum()
        return cls(pooled, {cell: (k + pooled) / (n + 1) for cell, (k, n) in counts.items()})

    @property
    def num_free(self) -> int:
        """How many probabilities there are."""
        return len(self.cells) or 1

    def press_probability(self, trial: Trial) -> Floats:
        """P(press) in every step, shape (T,)."""
        probability = np.full(trial.num_steps, self.pooled)
        for cell, steps in cells(trial) if self.cells else ():
            probability[steps] = self.cells.get(cell, self.pooled)
        return probability

    def log_likelihoods(self, trials: Sequence[Trial]) -> Floats:
        """Log-likelihood of the recorded steps of each trial, in nats."""
        return np.array([bernoulli(self.press_probability(trial), trial) for trial in trials])


def bernoulli(probability: Floats, trial: Trial) -> float:
    """Log-likelihood in nats of a trial's recorded presses, each step having this P(press)."""
    of_step = np.where(trial.presses, np.log(probability), np.log1p(-probability))
    return float(of_step[trial.recorded].sum())
