"""Whether a population helps with teachers it has not met: trial by trial, as each becomes known."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from learn.bootstrap import Interval, ratio_interval
from learn.exposure import trials_given
from learn.held_out import folds_of_people, person_of
from taskcomm.lattice import Floats
from taskcomm.parallel import map_in_order
from taskcomm.trials import Trial

POOLED, UPDATED, AVERAGED, SEPARATE = "pooled", "population", "population, averaged", "own trials alone"
FEW = 2  # starts of a fit to the few trials of one teacher


@dataclass(frozen=True)
class HeldOutTeachers:
    """Log-likelihoods in nats of each trial's presses, under each arm, shape (trials,) each.

    Every teacher is left out of the fits in turn, with others of the same fold, and then met trial by trial:
    `met[n]` is how many trials of the teacher `people[n]` were known before trial n. Arms:
    `pooled`, one model for all teachers; `population`, the mode of the posterior given the trials
    known (of none: the mean teacher); `population, averaged`, the likelihood averaged over that posterior
    instead; `own trials alone`, a fit to the trials known that starts from `pooled`, and stays there in
    what they say nothing of.
    """

    log_likelihood: Mapping[str, Floats]
    people: tuple[str, ...]
    trial_ids: tuple[str, ...]
    met: NDArray[np.int64]
    fold: NDArray[np.int64]

    @property
    def arms(self) -> tuple[str, ...]:
        return tuple(self.log_likelihood)

    def gain(self, arm: str, met: int | None = None, baseline: str = POOLED) -> Interval:
        """Mean log-likelihood per trial minus the baseline's; teachers are resampled whole.

        Over the trials before which `met` trials of the teacher were known; over all, where it is None.
        """
        kept = np.flatnonzero(self.met >= 0 if met is None else self.met == met)
        gains = (self.log_likelihood[arm] - self.log_likelihood[baseline])[kept]
        return ratio_interval(gains, np.ones(len(kept)), [self.people[n] for n in kept])

    def rows(self) -> list[dict[str, Any]]:
        """One row a trial, for a table file."""
        return [
            {"person": person, "trial_id": self.trial_ids[n], "known": int(self.met[n])}
            | {"fold": int(self.fold[n])}
            | {f"log_likelihood {arm}": float(self.log_likelihood[arm][n]) for arm in self.arms}
            for n, person in enumerate(self.people)
        ]


@dataclass
class _Left:
    """The fits without one fold, and the scores of that fold by trial; run in a process of its own."""

    trials: tuple[Trial, ...]
    people: tuple[str, ...]
    fold: NDArray[np.int64]
    separate: bool
    seed: int
    population: Mapping[str, Any]
    options: Mapping[str, Any]

    def __call__(self, left_out: int) -> dict[str, list[float]]:
        from learn import fit, fit_population, log_likelihoods

        world = self.trials[0].world
        kept = [trial for trial, fold in zip(self.trials, self.fold, strict=True) if fold != left_out]
        pooled = fit(kept, world, **self.options)
        population = fit_population(kept, world, pooled=pooled, **{"seed": self.seed, **self.population})
        few = {**self.options, "initial": pooled.model, "starts": FEW}
        scores: dict[str, list[float]] = {POOLED: [], UPDATED: [], AVERAGED: []}
        if self.separate:
            scores[SEPARATE] = []
        so_far: dict[str, float] = {}
        for n in np.flatnonzero(self.fold == left_out):
            trial, known = self.trials[n], self.known(int(n))
            models = {POOLED: pooled.model, UPDATED: population.teacher(known)}
            if self.separate:
                models[SEPARATE] = fit(known, world, **few).model if known else pooled.model
            for arm, model in models.items():
                scores[arm].append(float(log_likelihoods([trial], world, model)[0]))
            together = population.log_predictive([*known, trial])
            scores[AVERAGED].append(together - so_far.get(self.people[n], 0.0))
            so_far[self.people[n]] = together
        return scores

    def known(self, n: int) -> list[Trial]:
        """The trials of the teacher of trial n that came before it."""
        return [
            trial for trial, who in zip(self.trials[:n], self.people, strict=False) if who == self.people[n]
        ]


def held_out_teachers(
    trials: Sequence[Trial],
    *,
    folds: int = 5,
    separate: bool = True,
    seed: int = 0,
    jobs: int = 1,
    progress: Callable[[int], None] | None = None,
    population: Mapping[str, Any] | None = None,
    **options: Any,
) -> HeldOutTeachers:
    """Score every trial of every teacher under fits to other teachers, as the teacher becomes known.

    The trials of a teacher are taken in the order given. `options` are those of `fit`, `initial` among
    them, and `population` those of `fit_population`; `separate=False` leaves out the fits to own trials
    alone. Raises FitError for trials that cannot be fitted together, and where a fit would be left with
    fewer than two teachers.
    """
    trials = trials_given(trials, "a comparison")
    people = tuple(map(person_of, trials))
    fold = folds_of_people(people, folds, seed)
    left = _Left(trials, people, fold, separate, seed, dict(population or {}), options)
    scored = map_in_order(left, range(int(fold.max()) + 1), jobs, progress)
    arms = {arm: np.empty(len(trials)) for arm in scored[0]}
    for k, scores in enumerate(scored):
        for arm, values in scores.items():
            arms[arm][fold == k] = values
    return HeldOutTeachers(
        log_likelihood=arms,
        people=people,
        trial_ids=tuple(trial.trial_id for trial in trials),
        met=np.array([len(left.known(n)) for n in range(len(trials))]),
        fold=fold,
    )
