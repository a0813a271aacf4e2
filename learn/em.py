"""EM from several starts, the search across breakpoints, and the test of the optimum."""

import platform
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from learn.coordinates import Bounds, Coordinates, model_at, names_of
from learn.estep import Evidence
from learn.exposure import Exposure, FitError, expose, trials_given
from learn.mstep import MistakePrior, Objective
from learn.optimum import (
    COARSE,
    TOLERANCE,
    across_breakpoints,
    climb_smoothly,
    one_sided_slopes,
    polish,
    recombine,
)
from learn.path import Path, starting_points
from learn.result import FitResult, Start
from learn.statistics import informed, marks_of, remarks_of, ridges, settle
from taskcomm.lattice import Floats
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
    delays: bool = False,
    starts: int = 6,
    max_iter: int = 500,
    rtol: float = 1e-8,
    mistake_prior: MistakePrior | None = MistakePrior(),  # noqa: B008 (frozen)
    bounds: Bounds = Bounds(),  # noqa: B008 (frozen)
    task_prior: ArrayLike | None = None,
    search: bool = True,
    seed: int = 0,
    progress: Progress | None = None,
) -> FitResult:
    """The teacher model under which the presses of `trials` are most probable.

    EM over the reasons of the presses, from `initial` (the intuitive model by default) and `starts` - 1
    other starts; then, from where each has ended, a search of the log-likelihood itself across the
    breakpoints of rise, fall and delay, and EM again, until neither rises. Learned are mistake, peaks,
    rises, falls and, with `delays`, the delays, within `bounds`; decay, rest and cues stay those of
    `initial`. The task of a trial is its card's; where that is None, all tasks are summed over with
    `task_prior` (uniform by default). `mistake_prior` may be None. EM stops when an iteration gains no
    more than `rtol` of the objective, or unconverged after `max_iter` iterations. `search=False` leaves
    EM alone. `progress(done, total)` is called as parts of the work finish.

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
    if starts < 1 or max_iter < 1:
        raise FitError(f"starts and max_iter must be at least 1, not {starts} and {max_iter}")
    world = trials[0].world if world is None else world
    initial = TeacherModel.intuitive() if initial is None else initial
    tell = progress or (lambda done, total: None)
    space, objective, exposure = _prepare(trials, world, initial, delays, bounds, mistake_prior, task_prior)
    rng = np.random.default_rng(seed)
    paths = [Path(name, point) for name, point in starting_points(initial, space, starts, delays, rng)]
    total = len(paths) + 2
    for number, path in enumerate(paths):
        path.run(objective, max_iter, rtol)
        path.em_alone = path.values[-1]
        if search:
            nudged = np.clip(path.point + rng.normal(0, 0.01, len(path.point)), space.least, space.most)
            path.move(objective, climb_smoothly(objective, nudged, gain=COARSE)[0])
        path.searched = path.values[-1]
        tell(number + 1, total)
    ends = np.array([path.values[-1] for path in paths])
    best = int(np.flatnonzero(ends >= ends.max() - 10 * COARSE)[0])
    if search:
        paths[best].move(objective, paths[int(ends.argmax())].point)
        others = [path.point for path in paths]
        _search(objective, paths[best], others, max_iter, rtol, rng)
    tell(total - 1, total)
    settings = {
        "delays": delays, "starts": starts, "max_iter": max_iter, "rtol": rtol, "seed": seed,
        "search": search, "bounds": asdict(bounds),
        "mistake_prior": None if mistake_prior is None else asdict(mistake_prior),
        "task_prior": None if task_prior is None else [float(p) for p in np.asarray(task_prior)],
    }  # fmt: skip
    result = _result(initial, objective, exposure, paths, best, settings)
    tell(total, total)
    return result


def _prepare(
    trials: Sequence[Trial],
    world: World,
    initial: TeacherModel,
    delays: bool,
    bounds: Bounds,
    mistake_prior: MistakePrior | None,
    task_prior: ArrayLike | None,
) -> tuple[Coordinates, Objective, Exposure]:
    try:
        base = initial.parameters(world.cue_names)
    except ModelError as error:
        raise FitError(str(error)) from None
    states = len(initial.approvals)
    free = np.ones(1 + 4 * states, dtype=np.bool_)
    free[1 + 3 * states :] = delays
    extent = Coordinates(initial, bounds, free).extent(base)
    exposure = expose(trials, world, initial, extent, task_prior, MOST_MEMORIES)
    for m, ever_on in enumerate(exposure.cue_ever_on):
        if not ever_on:
            free[1 + m :: states] = False
    space = Coordinates(initial, bounds, free)
    return space, Objective(Evidence(exposure), base, space, mistake_prior), exposure


def _search(
    objective: Objective,
    path: Path,
    others: list[Floats],
    max_iter: int,
    rtol: float,
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
        path.run(objective, max_iter, rtol)
        if path.values[-1] - before <= 10 * rtol * abs(before):
            break


def _result(
    initial: TeacherModel,
    objective: Objective,
    exposure: Exposure,
    paths: list[Path],
    best: int,
    settings: dict[str, Any],
) -> FitResult:
    space, path, states = objective.space, paths[best], list(initial.approvals)
    point = settle(objective, path.point)
    vector = space.vector(point)
    slopes = one_sided_slopes(objective.value, space, point)
    expectation = objective.expect(point)
    responsibilities = _responsibilities(objective, exposure)
    seen = informed(objective, vector, expectation)
    marks = marks_of(space, point, slopes, seen, ridges(objective, point), states)
    value = expectation.value + objective.log_prior(vector)
    status = "converged"
    if not path.converged:
        status = f"not converged: EM still rising after {path.iterations} iterations"
    elif slopes.steepest > TOLERANCE:
        status = f"not converged: a slope of {slopes.steepest:.3g} nats is left, above {TOLERANCE:g}"
    em_alone = max(path.em_alone for path in paths)
    names = names_of(states)
    model = model_at(vector, initial)
    provenance = {
        "made_by": "learn.fit",
        "versions": _versions(),
        "settings": settings,
        "initial_sha256": initial.sha256,
        **(
            {"initial_conversion": conversion} if (conversion := initial.provenance.get("conversion")) else {}
        ),
        "trials": len(exposure.hashes),
        "trial_sha256": sorted(exposure.hashes),
        "log_likelihood": expectation.value,
        "converged": status == "converged",
        "status": status,
    }
    return FitResult(
        model=replace(model, provenance=provenance),
        initial=initial,
        log_likelihood=expectation.value,
        objective=value,
        converged=status == "converged",
        status=status,
        iterations=path.iterations,
        paths=tuple(np.array(path.values) for path in paths),
        starts=tuple(
            Start(p.name, p.values[0], p.em_alone, p.iterations, p.converged, p.searched) for p in paths
        ),
        best_start=best,
        em_alone=em_alone,
        search_gain=value - em_alone,
        steepest=slopes.steepest,
        monotone=all(_never_falls(path.values) for path in paths),
        trial_ids=exposure.trial_ids,
        trial_hashes=exposure.hashes,
        log_likelihoods=expectation.log_likelihood,
        responsibilities=responsibilities,
        steps=dict(zip(names, map(float, seen.steps), strict=True)),
        presses=dict(zip(names, map(float, seen.presses), strict=True)),
        marks=marks,
        remarks=remarks_of(marks, states),
        free=space.free.copy(),
    )


def _never_falls(values: Sequence[float]) -> bool:
    return bool((np.diff(values) >= -1e-10 * np.abs(values[:-1])).all()) if len(values) > 1 else True


def _responsibilities(objective: Objective, exposure: Exposure) -> tuple[Floats, ...]:
    """P(M_t = m | trial) of every press of every trial, from the last E-step."""
    chain = objective.evidence.chain
    result = [np.zeros((count, 2 + len(objective.base.peak))) for count in exposure.presses]
    for unit, trial in enumerate(exposure.unit_trial):
        result[trial][:, 1:] += chain.reasons(unit)
    return tuple(result)


def _versions() -> dict[str, str]:
    import numba

    from taskcomm import __version__

    return {
        "taskcomm": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "numba": numba.__version__,
    }
