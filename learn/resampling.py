"""The bootstrap: fits to teachers drawn again, with replacement, from those there are."""

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass

import numpy as np

from learn.ascent import ascend, climb_from
from learn.mstep import Objective
from learn.optimum import across_breakpoints
from taskcomm.lattice import Floats, Ints
from taskcomm.parallel import map_in_order
from taskcomm.trials import Trial

STEPS, GAIN = 60, 1e-3  # of each climb, in nats: far less than what resamples differ by
ROUNDS, ENOUGH = 4, 0.05


def groups_of(trials: Sequence[Trial]) -> tuple[Hashable, ...]:
    """Whose each trial is: its participant's, or nobody else's where none is named."""
    return tuple(
        (number,) if trial.participant_id is None else trial.participant_id
        for number, trial in enumerate(trials)
    )


def members_of(groups: Sequence[Hashable]) -> Ints:
    """The groups as numbers from 0 in the order in which they come, trial by trial."""
    order = {name: number for number, name in enumerate(dict.fromkeys(groups))}
    return np.array([order[name] for name in groups], dtype=np.int64)


@dataclass(frozen=True)
class Resample:
    """One fit to teachers drawn again: weights that count each teacher's trials as often as drawn.

    Climbs begin beside the fit to all, further from it, and, from the better end, across breakpoints.
    """

    objective: Objective
    centre: Floats
    member: Ints
    seed: int

    def __call__(self, number: int) -> Floats:
        """The natural parameters of resample `number`, always the same for a seed: shape (1 + 6 M,)."""
        rng = np.random.default_rng([self.seed, number])
        teachers = int(self.member.max()) + 1
        drawn = rng.multinomial(teachers, np.full(teachers, 1 / teachers))[self.member]
        given, space = self.objective.evidence.weights, self.objective.space
        weights = drawn if given is None else drawn * given
        objective = self.objective.with_weights(weights)
        near, aside = (
            np.clip(self.centre + rng.normal(0, size, len(self.centre)), space.least, space.most)
            for size in (0.01, 0.3)
        )
        ends = [_climbed(objective, start) for start in (near, aside)]
        best = max(ends, key=objective.value)
        value = objective.value(best)
        for _ in range(ROUNDS):
            before = value
            best, value = across_breakpoints(objective, best, before)
            if value - before <= ENOUGH:
                break
        return space.vector(best)


def _climbed(objective: Objective, start: Floats) -> Floats:
    space = objective.space
    climb = climb_from(objective.value_and_rates, start)
    return ascend(objective.value_and_rates, climb, space.least, space.most, STEPS, GAIN).point


def resampled(
    objective: Objective,
    centre: Floats,
    groups: Sequence[Hashable],
    resamples: int,
    seed: int,
    jobs: int,
    progress: Callable[[int], None] | None = None,
) -> Floats:
    """The fits to `resamples` draws of teachers, shape (resamples, 1 + 6 M).

    Raises ValueError for fewer than 2 resamples or teachers.
    """
    member = members_of(groups)
    if resamples < 2:
        raise ValueError(f"resamples: must be at least 2, not {resamples}")
    if member.max() < 1:
        raise ValueError("bootstrap: needs at least two teachers; these trials are all of one")
    work = Resample(objective, centre, member, seed)
    return np.array(map_in_order(work, range(resamples), jobs, progress))
