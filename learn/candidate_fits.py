"""Quick fits of candidate structures: to all trials, to some, and without each fold of people."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from learn.ascent import ascend, climb_from
from learn.candidates import NONE, Structure, beginnings
from learn.coordinates import model_at, parameters_at, vector_of
from learn.em import prepare
from learn.exposure import trials_given
from learn.held_out import folds_of_people, person_of
from learn.mstep import Objective
from learn.optimum import climb_smoothly
from learn.settings import Settings
from learn.statistics import idle_decays
from taskcomm.lattice import Floats
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial
from taskcomm.world import World

STEPS, GAIN = 60, 1e-3
FEW_STEPS, COARSE = 30, 1e-2
ASIDE = (0.2, 0.03)
ROUNDS = 3
TIMES = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 6.0, 9.0)
GRID = {
    "rise": TIMES,
    "fall": TIMES,
    "delay": (0.0, 0.3, 0.6, 1.0, 1.5),
    "decay": (4.0, 8.0, 16.0, 40.0, 120.0),
}


@dataclass(frozen=True, eq=False)
class Candidate:
    """A structure and how well it does.

    `num_free` counts the coordinates that were fitted, and one for a rest above 0, which was chosen by the
    data too. `log_likelihood` is that of all trials at the fit to them, in nats; `held_out` (trials,) that of
    each trial at the fit without its fold, None where that was not worth finding out. `behind` is how many
    nats it was short of another structure on the first trials, where it was given up for that: then
    `log_likelihood` is nan. `idle`: it has decays, and is as likely without them, to a tenth of a nat.
    """

    structure: Structure
    num_free: int
    log_likelihood: float
    model: TeacherModel
    held_out: Floats | None = None
    behind: float | None = None
    idle: bool = False

    @property
    def total(self) -> float:
        """The held-out log-likelihood of all trials; -inf where it was not found out."""
        return -np.inf if self.held_out is None else float(self.held_out.sum())

    @property
    def penalised(self) -> float:
        """Log-likelihood less the number of parameters: about what is left of it on new trials."""
        return self.log_likelihood - self.num_free

    def bic(self, people: int) -> float:
        """-2 log-likelihood + parameters * log(people): the smaller the better."""
        return float(-2 * self.log_likelihood + self.num_free * np.log(people))


class Bench:
    """The trials that structures are tried on, and the quick fits to them.

    A quick fit climbs the log-likelihood itself from the best one or two of a few beginnings near another
    fit, and then from what a coarse grid of each time finds better. `first` are the trials of whole people,
    drawn by the seed, that a structure has to do well on before it is fitted to all: at least
    `first_trials`, or None where there are hardly more. Raises FitError for trials of fewer than two people.
    """

    def __init__(
        self,
        trials: Sequence[Trial],
        world: World,
        initial: TeacherModel,
        settings: Settings,
        folds: int,
        first_trials: int,
    ) -> None:
        self.trials = trials_given(trials, "a search of structures")
        self.world, self.initial, self.settings = world, initial, settings
        self.people = tuple(map(person_of, self.trials))
        self.fold = folds_of_people(self.people, folds, settings.seed)
        names = list(dict.fromkeys(self.people))
        self.member: NDArray[np.int64] = np.array([names.index(person) for person in self.people])
        self.num_people = len(names)
        self.first = self._first(first_trials)
        self._objectives: dict[Structure, tuple[Objective, Floats]] = {}

    def _first(self, least: int) -> tuple[Trial, ...] | None:
        if len(self.trials) < 1.5 * least:
            return None
        order = np.random.default_rng(self.settings.seed).permutation(self.num_people)
        sizes = np.bincount(self.member)[order]
        drawn = set(order[: int(np.searchsorted(np.cumsum(sizes), least)) + 1].tolist())
        return tuple(t for t, person in zip(self.trials, self.member, strict=True) if person in drawn)

    def fit(self, structure: Structure, near: TeacherModel, of_first: bool = False) -> Candidate:
        """The quick fit to all trials, or to the first, begun near a model of a like structure."""
        trials = self.first if of_first and self.first else self.trials
        base = structure.imposed_on(self.initial)
        objective = prepare(trials, self.world, base, structure.settings(self.settings))
        space = objective.space
        points = [space.point(vector) for vector in beginnings(structure, base, near, base.dt)]
        points.sort(key=objective.value, reverse=True)
        if of_first:
            point, value = _few_steps(objective, points[0])
        else:
            climbs = [
                climb_smoothly(objective, point, STEPS, GAIN) for point in points[: 1 if self.first else 2]
            ]
            point, value = _across(objective, *max(climbs, key=lambda climb: climb[1]))
            self._objectives[structure] = objective, point
        vector = space.vector(point)
        log_likelihood, model = value - objective.log_prior(vector), model_at(vector, base)
        free, idle = _num_free(structure, objective), _idle(structure, objective, point)
        return Candidate(structure, free, log_likelihood, model, idle=idle)

    def refit(self, candidate: Candidate, model: TeacherModel) -> Candidate:
        """The candidate at another fit to all trials."""
        objective, point = self._at(candidate.structure, model)
        value = objective.value(point) - objective.log_prior(objective.space.vector(point))
        self._objectives[candidate.structure] = objective, point
        idle = _idle(candidate.structure, objective, point)
        return replace(candidate, log_likelihood=value, model=model, held_out=None, idle=idle)

    def _at(self, structure: Structure, model: TeacherModel) -> tuple[Objective, Floats]:
        base = structure.imposed_on(self.initial)
        objective = prepare(self.trials, self.world, base, structure.settings(self.settings))
        return objective, objective.space.point(vector_of(model))

    def with_held_out(self, candidate: Candidate) -> Candidate:
        """The candidate with its held-out log-likelihoods, refitted without each fold from the fit to all."""
        if candidate.held_out is not None:
            return candidate
        known = self._objectives.pop(candidate.structure, None)
        objective, point = known or self._at(candidate.structure, candidate.model)
        held_out = np.empty(len(self.trials))
        for k in range(int(self.fold.max()) + 1):
            kept = objective.evidence.with_weights(self.fold != k)
            without = Objective(kept, objective.base, objective.space, objective.prior)
            there = _from_aside(without, point, np.random.default_rng((self.settings.seed, k)))
            parameters = parameters_at(objective.space.vector(there), objective.base)
            held_out[self.fold == k] = kept.log_likelihoods(parameters)[self.fold == k]
        return replace(candidate, held_out=held_out)

    def forget(self) -> None:
        """Let go of the lattices of candidates that will not be refitted."""
        self._objectives.clear()

    def by_person(self, of_trials: Floats) -> Floats:
        """Sums over the trials of each person, (people,)."""
        return np.bincount(self.member, of_trials, self.num_people).astype(np.float64)


def _few_steps(objective: Objective, point: Floats) -> tuple[Floats, float]:
    """A short climb: from near by, or to see how far it is."""
    space, begun = objective.space, climb_from(objective.value_and_rates, point)
    climb = ascend(objective.value_and_rates, begun, space.least, space.most, FEW_STEPS, COARSE)
    return climb.point, climb.value


def _across(objective: Objective, point: Floats, value: float) -> tuple[Floats, float]:
    """The end of a climb, each of its times moved anywhere on a coarse grid, and climbed from again.

    A climb does not see that a longer fall would explain a press that is a mistake to it (MODEL.md,
    section 7): it may stay far below.
    """
    space = objective.space
    for _ in range(ROUNDS):
        before = value
        for coordinate, kind in enumerate(space.kinds):
            for where in GRID.get(kind, ()):
                there = point.copy()
                moved = where * space.dt if kind == "delay" else np.log(where * space.dt)
                there[coordinate] = np.clip(moved, space.least[coordinate], space.most[coordinate])
                reached = objective.value(there)
                if reached > value:
                    point, value = there, reached
        if value - before <= COARSE:
            break
        climb = climb_smoothly(objective, point, STEPS, GAIN)
        if climb[1] > value:
            point, value = climb
    return point, value


def _from_aside(objective: Objective, point: Floats, rng: np.random.Generator) -> Floats:
    """A climb from beside the best point of other weights, then from beside where it has ended.

    At a kink a climb sees one side only and may stay; it would keep what it is to do without.
    """
    space, best, value = objective.space, point, -np.inf
    for aside in ASIDE:
        beside = np.clip(best + rng.normal(0, aside, len(best)), space.least, space.most)
        there, reached = _few_steps(objective, beside)
        if reached > value:
            best, value = there, reached
    return best


def _idle(structure: Structure, objective: Objective, point: Floats) -> bool:
    decays = [
        idle
        for idle, kind in zip(idle_decays(objective, point), objective.space.kinds, strict=True)
        if kind == "decay"
    ]
    return structure.decay != NONE and all(decays)


def _num_free(structure: Structure, objective: Objective) -> int:
    return len(objective.space.index) + (structure.rest > 0)
