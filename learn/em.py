"""EM from several starts, the search across breakpoints, and the test of the optimum."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from learn.conclude import conclude
from learn.coordinates import NAMES, Coordinates, parameters_at, vector_of
from learn.estep import Evidence
from learn.exposure import FitError, expose, trials_given
from learn.imagined import pull_of
from learn.joint import settle_jointly
from learn.mstep import Objective
from learn.observing import Observing, with_channels
from learn.optimum import COARSE, across_breakpoints, climb_smoothly, polish, recombine
from learn.path import Path, starting_points
from learn.result import FitResult
from learn.settings import Settings
from taskcomm.lattice import Bools, Floats
from taskcomm.teacher import ModelError, TeacherModel
from taskcomm.trials import Trial
from taskcomm.world import World

Progress = Callable[[int, int], None]
ROUNDS = 4
MOST_MEMORIES = 20_000


def fit(
    trials: Sequence[Trial],
    world: World | None = None,
    initial: TeacherModel | None = None,
    *,
    weights: ArrayLike | None = None,
    settings: Settings | None = None,
    also: Sequence[TeacherModel] = (),
    progress: Progress | None = None,
    **options: Any,
) -> FitResult:
    """The teacher model under which the presses of `trials` are most probable.

    EM over the reasons of the presses, from `initial` (the intuitive model by default) and other
    starts; then, from where each has ended, a search of the log-likelihood itself across the
    breakpoints of rise, fall, delay and hold, and EM again, until neither rises. `options` are those of
    `Settings`, changed from `settings` (its defaults). Learned are mistake, peaks, rises, falls and, with
    `delays`, `decays`, `holds` (True, or "shared" for one in all approval states), those; rest and cues
    stay those of `initial`. The task of a trial is its card's; where that is None, all tasks are summed
    over with `task_prior` (uniform by default). `prior` draws the fit towards a model, see `learn.prior`;
    `mistake_prior`, on mistake alone, may be None. EM stops when an iteration
    gains no more than `rtol` of the objective, or unconverged after `max_iter` iterations. `search=False`
    leaves EM alone. `observe` names what is learned of the observation model: "miss", "false_press", or
    channels (a signal that the initial model has no channel for gets one). With `labels`, presses that
    annotators labelled have one of the reasons they gave. Key states that were not recorded are summed
    over, with `dropped_mass` without the memories that hold no more than it together at any event (see
    `expose`). `weights` (trials,) multiply the log-likelihoods of the trials: whole numbers count them so
    many times. `also` are models to start from beside the others. `progress(done, total)` is called as parts
    of the work finish.

    Deterministic for a seed; the order of the trials does not matter (but for rounding). Raises FitError
    for trials that cannot be fitted together or with this model, see `expose`, and for one with more
    than MOST_MEMORIES memories under one task: shorter bounds help.

    >>> from taskcomm.world import NOA, Action, BallWorld
    >>> from taskcomm.trials import Step
    >>> steps = [Step(Action.parse("light_on(1)"), False)] + [Step(NOA, t % 4 == 3) for t in range(40)]
    >>> trial = Trial("example", BallWorld(), BallWorld().tasks[0], tuple(steps))
    >>> result = fit([trial], starts=1)
    >>> result.converged, result.marks["that_mov.fall"]
    (True, 'no data')

    Source: MODEL.md, section 7.
    """
    trials = trials_given(trials)
    try:
        settings = replace(settings or Settings(), **options)
    except ValueError as error:
        raise FitError(str(error)) from None
    world = trials[0].world if world is None else world
    initial = TeacherModel.intuitive() if initial is None else initial
    tell = progress or (lambda done, total: None)
    if settings.prior is not None and settings.prior.model is None:
        settings = replace(settings, prior=replace(settings.prior, model=initial))
    objective = prepare(trials, world, initial, settings, weights)
    space, rng = objective.space, np.random.default_rng(settings.seed)
    starts = starting_points(initial, space, settings.starts, rng)
    starts += [(f"given {n}", space.point(vector_of(model))) for n, model in enumerate(also, start=1)]
    begun = None if objective.observing is None else objective.observing.observation
    paths = [Path(name, point, observation=begun) for name, point in starts]
    paths = [path for path in paths if np.isfinite(objective.value(path.point))]
    if not paths:
        raise FitError(_impossible(objective, starts[0][1]))
    total = len(paths) + 2
    for number, path in enumerate(paths):
        path.resume(objective)
        path.run(objective, settings.max_iter, settings.rtol)
        path.em_alone = path.values[-1]
        if settings.search:
            nudged = np.clip(path.point + rng.normal(0, 0.01, len(path.point)), space.least, space.most)
            path.move(objective, climb_smoothly(objective, nudged, gain=COARSE)[0])
        path.searched, path.ended = path.values[-1], path.point
        tell(number + 1, total)
    ends = np.array([path.values[-1] for path in paths])
    best = int(np.flatnonzero(ends >= ends.max() - 10 * COARSE)[0])
    paths[best].resume(objective)
    if settings.search:
        paths[best].move(objective, paths[int(ends.argmax())].point)
        others = [path.point for path in paths]
        _search(objective, paths[best], others, settings, rng)
        settle_jointly(objective, paths[best], rng)
    tell(total - 1, total)
    result = conclude(initial, objective, paths, best, settings)
    tell(total, total)
    return result


def prepare(
    trials: Sequence[Trial],
    world: World,
    initial: TeacherModel,
    settings: Settings,
    weights: ArrayLike | None = None,
) -> Objective:
    """What `fit` climbs: the objective over the free coordinates, with the trials as one lattice.

    Free are the parameters that `settings` name and that some cue could inform. Raises FitError.
    """
    try:
        base = initial.parameters(world.cue_names)
    except ModelError as error:
        raise FitError(str(error)) from None
    if settings.observe:
        initial = with_channels(initial, trials, world, settings.observe)
    states = len(initial.approvals)
    rows = np.ones((len(NAMES), states), dtype=np.bool_)
    rows[3:] = [[bool(free)] for free in (settings.delays, settings.decays, settings.holds)]
    rows[5] &= rows[4] | np.isfinite(base.decay)
    extent = _space(initial, settings, rows).extent(base)
    exposure = expose(
        trials, world, initial, extent, settings.task_prior, MOST_MEMORIES,
        labels=settings.labels, dropped_mass=settings.dropped_mass, together=not settings.observe,
    )  # fmt: skip
    space = _space(initial, settings, rows & exposure.cue_ever_on)
    evidence = Evidence(exposure).with_weights(weights)
    observing = Observing(trials, world, initial, settings.observe, evidence) if settings.observe else None
    pull = None
    if settings.prior is not None and settings.prior.trials > 0:
        pull = pull_of(settings.prior, trials, world, initial, space, weights, settings.task_prior)
    return Objective(evidence, base, space, settings.mistake_prior, observing, pull)


def _impossible(objective: Objective, point: Floats) -> str:
    evidence = objective.evidence
    each = evidence.log_likelihoods(parameters_at(objective.space.vector(point), objective.base))
    named = [evidence.exposure.trial_ids[n] for n in np.flatnonzero(~np.isfinite(each))]
    left_out = ", or it needs what dropped_mass leaves out" if evidence.exposure.dropped > 0 else ""
    return (
        f"trial {', '.join(named[:5])}: impossible at every start: a label or an observation contradicts"
        f" them{left_out}"
    )


def _space(initial: TeacherModel, settings: Settings, rows: Bools) -> Coordinates:
    free = np.concatenate([[True], rows.ravel()])
    return Coordinates(initial, settings.bounds, free, settings.shared)


def _search(
    objective: Objective,
    path: Path,
    others: list[Floats],
    settings: Settings,
    rng: np.random.Generator,
) -> None:
    """Breakpoints, what other starts found, polish, and EM again, until none of them rises."""
    for _ in range(ROUNDS):
        before = path.values[-1]
        candidate, value = across_breakpoints(objective, path.point, before)
        candidate, value = recombine(objective, candidate, value, others)
        others = []
        if value > before:
            path.move(objective, candidate)
        path.move(objective, polish(objective, path.point, rng)[0])
        path.run(objective, settings.max_iter, settings.rtol)
        if path.values[-1] - before <= 10 * settings.rtol * abs(before):
            break
