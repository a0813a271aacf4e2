"""From the end of a climb to a FitResult: the point settled, tested, counted and marked."""

import math
import platform
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from learn.audit import AS_NONE
from learn.basins import endings, labels_of
from learn.certificate import Certificate, degeneracies, kind_of, remarked, steepest_along
from learn.coordinates import model_at, names_of, parameters_at
from learn.joint import labels_of_emissions, slopes_of
from learn.mstep import Objective
from learn.optimum import TOLERANCE, Slopes
from learn.path import Path
from learn.result import FitResult, Start
from learn.settings import Settings
from learn.statistics import full, idle_decays, informed, marks_of, remarks_of, ridges, settle
from taskcomm.lattice import Floats
from taskcomm.teacher import TeacherModel


def conclude(
    initial: TeacherModel, objective: Objective, paths: Sequence[Path], best: int, settings: Settings
) -> FitResult:
    """The result of a fit whose best path has ended at its optimum."""
    exposure = objective.evidence.exposure
    space, path, states = objective.space, paths[best], list(initial.approvals)
    point = settle(objective, path.point)
    vector, names = space.vector(point), names_of(states)
    slopes = slopes_of(objective, point)
    expectation = objective.expect(point)
    seen = informed(objective, vector, expectation)
    responsibilities = _responsibilities(objective, vector)
    idle = idle_decays(objective, point)
    marks = marks_of(space, point, slopes, seen, ridges(objective, point), idle, states)
    certificate = _certified(objective, paths, best, point, slopes, marks, names, expectation.value)
    model = model_at(vector, initial)
    if objective.observing is not None:
        model = replace(model, observation=objective.observing.observation)
    result = FitResult(
        model=model,
        initial=initial,
        log_likelihood=expectation.value,
        objective=certificate.objective,
        converged=certificate.trusted,
        status=certificate.status,
        iterations=path.iterations,
        paths=tuple(np.array(path.values) for path in paths),
        starts=tuple(
            Start(p.name, p.values[0], p.em_alone, p.iterations, p.converged, p.searched) for p in paths
        ),
        best_start=best,
        em_alone=certificate.em_alone,
        search_gain=certificate.search_gain,
        steepest=slopes.steepest,
        monotone=certificate.monotone,
        trial_ids=exposure.trial_ids,
        trial_hashes=exposure.hashes,
        log_likelihoods=expectation.log_likelihood,
        responsibilities=responsibilities,
        steps=dict(zip(names, map(float, seen.steps), strict=True)),
        presses=dict(zip(names, map(float, seen.presses), strict=True)),
        marks=marks,
        remarks=remarks_of(marks, states, full(objective, point)),
        free=space.free.copy(),
        num_free=len(space.index) + (0 if objective.observing is None else objective.observing.num_free),
        settings=settings,
        certificate=certificate,
        dropped=exposure.dropped,
    )
    return replace(result, model=replace(model, provenance=_provenance(result)))


def _certified(
    objective: Objective,
    paths: Sequence[Path],
    best: int,
    point: Floats,
    slopes: Slopes,
    marks: Mapping[str, str],
    names: Sequence[str],
    log_likelihood: float,
) -> Certificate:
    space, path, filled = objective.space, paths[best], full(objective, point)
    labels, value = labels_of(space, names), log_likelihood + objective.log_prior(space.vector(point))
    em_alone = max(path.em_alone for path in paths)
    monotone = all(_never_falls(path.values) for path in paths)
    kind, reasons = kind_of(
        degeneracies(objective, point, marks, names, labels),
        path.iterations,
        path.converged,
        slopes.steepest,
        monotone,
        filled or not {"at its bound", AS_NONE}.isdisjoint(marks.values()),
    )
    ended = endings(objective, paths, point, labels)
    return Certificate(
        kind=kind,
        reasons=reasons,
        log_likelihood=log_likelihood,
        objective=value,
        iterations=path.iterations,
        endings=ended,
        basins=1 + max(ending.basin for ending in ended),
        em_alone=em_alone,
        search_gain=value - em_alone,
        monotone=monotone,
        steepest=slopes.steepest if math.isfinite(slopes.steepest) else None,
        steepest_along=steepest_along(slopes, (*labels, *labels_of_emissions(objective))),
        tolerance=TOLERANCE,
        **remarked(marks, filled),
    )


def _provenance(result: FitResult) -> dict[str, Any]:
    """Where the model came from and how far it may be trusted, for its file."""
    conversion = result.initial.provenance.get("conversion")
    return {
        "made_by": "learn.fit",
        "versions": _versions(),
        "settings": result.settings.to_dict(),
        "initial_sha256": result.initial.sha256,
        **({"initial_conversion": conversion} if conversion else {}),
        "trials": len(result.trial_hashes),
        "trial_sha256": sorted(result.trial_hashes),
        "log_likelihood": result.log_likelihood,
        "converged": result.converged,
        "status": result.status,
        "certificate": result.certificate.to_dict(),
        "audit": result.audit_to_dict(),
    }


def _never_falls(values: Sequence[float]) -> bool:
    return bool((np.diff(values) >= -1e-10 * np.abs(values[:-1])).all()) if len(values) > 1 else True


def _responsibilities(objective: Objective, vector: Floats) -> tuple[Floats, ...]:
    """P(M_t = m | trial) of every press of every trial."""
    evidence, exposure = objective.evidence.with_weights(None), objective.evidence.exposure
    evidence.expect(parameters_at(vector, objective.base))
    chain = evidence.chain
    result = [np.zeros((steps, 2 + len(objective.base.peak))) for steps in exposure.steps]
    for unit, trial in enumerate(exposure.unit_trial):
        result[trial][chain.events(unit)] += chain.reasons(unit)
    return tuple(each[at] for each, at in zip(result, exposure.press_steps, strict=True))


def _versions() -> dict[str, str]:
    import numba

    from taskcomm import __version__

    return {
        "taskcomm": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "numba": numba.__version__,
    }
