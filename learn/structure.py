"""Which structure of the teacher the trials favour, and which they cannot tell apart (MODEL.md, section 7).

A greedy search: factor by factor (the cue of each approval state, rest, delay, decay), all values of one
factor are tried with the others as they stand, until a whole round changes nothing. It may miss a
structure that is better only in two factors at once.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from learn.candidate_fits import Bench, Candidate
from learn.candidates import Structure, Value, alternatives
from learn.em import fit
from learn.exposure import FitError, trials_given
from learn.result import FitResult
from learn.settings import Settings
from learn.structure_choice import Answer, answer_of, gap, rank, simplest_within_one_error
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial
from taskcomm.world import World

NEAR = 10.0
GIVEN_UP, HOPELESS = 12.0, 30.0
ROUNDS = 4
RAISED = 0.01
Tell = Callable[[str], None]


@dataclass(frozen=True)
class StructureSearch:
    """What a search has tried and chosen.

    `candidates` come the best held-out first, then those that were not refitted by fold, then those given
    up. `chosen` is the simplest within one standard error of the best, `best_bic` that of the least BIC.
    `settled` says whether the last round changed nothing. `fitted` is the thorough fit of the chosen one to
    all trials, None where none was asked for.
    """

    candidates: tuple[Candidate, ...]
    chosen: Candidate
    best_bic: Candidate
    answers: tuple[Answer, ...]
    confidence: float
    settled: bool
    initial: Structure
    bench: Bench
    fitted: FitResult | None

    @property
    def best(self) -> Candidate:
        """The greatest held-out log-likelihood."""
        return self.candidates[0]

    def gap(self, candidate: Candidate, other: Candidate | None = None) -> tuple[float, float]:
        """Held-out log-likelihood minus that of the best (or another), in nats, and its standard error.

        The error is over people: sqrt(P) times the standard deviation of their differences.
        """
        return gap(self.bench, candidate, other or self.best)

    def rows(self) -> list[dict[str, Any]]:
        """A row a candidate, for a table file."""
        least = self.best_bic.bic(self.bench.num_people)
        rows = []
        for candidate in self.candidates:
            tried = candidate.behind is None
            difference, error = (None, None) if candidate.held_out is None else self.gap(candidate)
            rows.append(
                {
                    "structure": str(candidate.structure),
                    "beside_initial": candidate.structure.beside(self.initial),
                    "parameters": candidate.num_free,
                    "held_out": difference,
                    "standard_error": error,
                    "log_likelihood": candidate.log_likelihood if tried else None,
                    "bic": candidate.bic(self.bench.num_people) - least if tried else None,
                    "behind": candidate.behind,
                    "chosen": candidate is self.chosen,
                }
            )
        return rows


def search_structure(
    trials: Sequence[Trial],
    world: World | None = None,
    initial: TeacherModel | None = None,
    *,
    settings: Settings | None = None,
    cue_names: Sequence[str] | None = None,
    rests: Sequence[float] | None = None,
    folds: int = 10,
    confidence: float = 0.9,
    first_trials: int = 50,
    thorough: int = 3,
    tell: Tell | None = None,
) -> StructureSearch:
    """Search the structures around that of `initial` (the intuitive model by default).

    Tried are every cue of `cue_names` (those of the world by default) for each approval state, every rest of
    `rests` (s; by default 0 to 4 steps), and delay and decay: none, one shared, one for each state. The
    observation model stays that of `initial`.

    A structure that is GIVEN_UP nats short of the one that stands, on some `first_trials` trials drawn by
    the seed, is not fitted to all (nats are always less one for each parameter); a value HOPELESS nats short
    is not tried in later rounds. Structures within NEAR nats of the best of their factor are refitted
    without each of `folds` folds of people. Held-out log-likelihood decides, by one standard error in
    favour of fewer parameters. At last the best `thorough` structures are fitted from all starts of
    `settings`, and chosen among anew; 0 leaves that out. `tell` hears what is being tried.

    Raises FitError as `fit` does, for trials of fewer than two people, and for a cue that the world lacks.
    """
    trials = trials_given(trials, "a search of structures")
    world = trials[0].world if world is None else world
    initial = TeacherModel.intuitive() if initial is None else initial
    names = tuple(world.cue_names if cue_names is None else cue_names)
    tries = [step * initial.dt for step in range(5)] if rests is None else list(rests)
    _check(world, names, tries, confidence)
    settings = replace(settings or Settings(), observe=())
    bench = Bench(trials, world, initial, settings, folds, first_trials)
    search = _Search(bench, names, tries, tell or (lambda text: None))
    settled = search.run(Structure.of(initial), initial)
    fits = search.refine(thorough)
    chosen = search.choose()
    if thorough and chosen.structure not in fits:
        fits[chosen.structure] = search.fit_thoroughly(chosen)
    everyone = tuple(search.tried.values())
    ordered = sorted(everyone, key=lambda c: rank(c, bench))
    return StructureSearch(
        candidates=tuple(ordered),
        chosen=chosen,
        best_bic=min((c for c in everyone if c.behind is None), key=lambda c: c.bic(bench.num_people)),
        answers=tuple(
            answer_of(factor, chosen, everyone, bench.num_people, confidence)
            for factor in chosen.structure.factors
        ),
        confidence=confidence,
        settled=settled,
        initial=Structure.of(initial),
        bench=bench,
        fitted=fits.get(chosen.structure),
    )


def _check(world: World, cue_names: Sequence[str], rests: Sequence[float], confidence: float) -> None:
    for name in cue_names:
        if name not in world.cue_names:
            raise FitError(f"cue_names: unknown cue {name!r}; this world has {', '.join(world.cue_names)}")
    for rest in rests:
        if not (math.isfinite(rest) and rest >= 0):
            raise FitError(f"rests: must be finite and at least 0, not {rest:g}")
    if not 0.5 <= confidence < 1:
        raise FitError(f"confidence: must be at least 0.5 and below 1, not {confidence:g}")


class _Search:
    """The structures tried so far, and where the search stands."""

    def __init__(self, bench: Bench, cue_names: Sequence[str], rests: Sequence[float], tell: Tell) -> None:
        self.bench, self.cue_names, self.rests, self.tell = bench, cue_names, rests, tell
        self.tried: dict[Structure, Candidate] = {}
        self.hopeless: set[tuple[str, Value]] = set()
        self._on_first: dict[Structure, Candidate] = {}

    def run(self, structure: Structure, model: TeacherModel) -> bool:
        """Rounds over the factors until one changes nothing, or ROUNDS of them; whether it did settle."""
        standing = self._try(structure, model, None)
        for number in range(1, ROUNDS + 1):
            before = standing.structure
            for factor in before.factors:
                self.tell(f"round {number}: {factor}, beside {standing.structure}")
                standing = self._best_of(factor, standing)
            chosen = self.choose()
            if chosen.structure == before:
                return True
            standing = chosen
        return False

    def _best_of(self, factor: str, standing: Candidate) -> Candidate:
        around = [
            structure
            for structure in alternatives(standing.structure, factor, self.cue_names, self.rests)
            if structure in self.tried or (factor, structure.value(factor)) not in self.hopeless
        ]
        near = standing
        for structure in around:
            found = self._try(structure, near.model, standing)
            if factor in ("delay", "decay") and found.behind is None:
                near = max(
                    near, found, key=lambda c: c.log_likelihood
                )  # one for all leads on to one for each
        fitted = [self.tried[s] for s in around if self.tried[s].behind is None]
        best = max(candidate.penalised for candidate in fitted)
        for candidate in fitted:
            if candidate.penalised >= best - NEAR:
                self.tried[candidate.structure] = self.bench.with_held_out(candidate)
        self.bench.forget()
        for structure in around:
            found = self.tried[structure]
            short = best - found.penalised if found.behind is None else found.behind
            if short > HOPELESS:
                self.hopeless.add((factor, structure.value(factor)))
        return simplest_within_one_error([self.tried[c.structure] for c in fitted], self.bench)

    def _try(self, structure: Structure, near: TeacherModel, standing: Candidate | None) -> Candidate:
        """The candidate of a structure, fitted near another unless it was tried before."""
        if structure not in self.tried:
            found = self._first(structure, near, standing)
            self.tried[structure] = self.bench.fit(structure, found.model) if found.behind is None else found
        return self.tried[structure]

    def _first(self, structure: Structure, near: TeacherModel, standing: Candidate | None) -> Candidate:
        if self.bench.first is None:
            return Candidate(structure, 0, math.nan, near)
        if structure not in self._on_first:
            self._on_first[structure] = self.bench.fit(structure, near, of_first=True)
        found = self._on_first[structure]
        if standing is None:
            return found
        behind = self._on_first[standing.structure].penalised - found.penalised
        return replace(found, log_likelihood=math.nan, behind=behind) if behind > GIVEN_UP else found

    def choose(self) -> Candidate:
        """The simplest of all within one standard error of the best."""
        return simplest_within_one_error(list(self.tried.values()), self.bench)

    def refine(self, count: int) -> dict[Structure, FitResult]:
        """Thorough fits of the best `count` structures; those that they raise are scored anew."""
        if not count:
            return {}
        first = self.choose()
        scored = [c for c in self.tried.values() if c.held_out is not None and c is not first]
        scored.sort(key=lambda c: rank(c, self.bench))
        return {c.structure: self.fit_thoroughly(c) for c in [first, *scored[: count - 1]]}

    def fit_thoroughly(self, candidate: Candidate) -> FitResult:
        """The fit of a structure from all starts; the candidate is scored anew where that raises it."""
        bench, structure = self.bench, candidate.structure
        self.tell(f"fitting thoroughly: {structure}")
        settings = structure.settings(bench.settings)
        found = fit(bench.trials, bench.world, structure.imposed_on(bench.initial), settings=settings)
        if found.log_likelihood < candidate.log_likelihood - RAISED:
            found = fit(bench.trials, bench.world, candidate.model, settings=settings)
        if found.log_likelihood > candidate.log_likelihood + RAISED:
            raised = self.bench.refit(candidate, found.model)
            self.tried[structure] = self.bench.with_held_out(raised)
        return found
