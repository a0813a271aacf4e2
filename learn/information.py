"""The observed information: how sharply the log-likelihood bends, exactly."""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from learn.coordinates import NAMES, parameters_at
from learn.estep import Evidence
from learn.mstep import MistakePrior, Objective
from taskcomm.lattice import Bools, Floats, Lattice
from taskcomm.teacher import Parameters

STEP = 1e-4


@dataclass(frozen=True)
class Curvature:
    """Derivatives of the log-likelihood at one set of parameters, in nats.

    `log_likelihood` (trials,), `score` (trials, n) its rates trial by trial, unweighted; `hessian` (n, n)
    the second derivatives of the sum, trials weighted as the evidence has them.
    """

    log_likelihood: Floats
    score: Floats
    hessian: Floats


def curvature(evidence: Evidence, parameters: Parameters, wanted: Bools | None = None) -> Curvature:
    """Exact first and second derivatives in the n = 1 + 6 M natural parameters, as `names_of` has them.

    A forward pass that carries them along with the weights of the memories. Those of parameters that are
    not `wanted` (n,) are left 0. Where a level has just reached 0 or 1, the derivatives are those of its
    staying there, as in `Evidence.value_and_rates`.

    Source: MODEL.md, section 7, by the chain rule.
    """
    from learn import _curvature

    p, exposure = parameters, evidence.exposure
    lattice, trial, states = exposure.lattice, exposure.unit_trial, len(p.peak)
    count, units = 1 + len(NAMES) * states, evidence.chain.units
    kept = np.arange(count) if wanted is None else np.flatnonzero(wanted)
    column = np.full(count, -1, dtype=np.int64)
    column[kept] = np.arange(len(kept))
    of_units, rates = np.zeros(units), np.zeros((units, len(kept)))
    bends = np.zeros((units, len(kept), len(kept)))
    expectation = evidence.expect(p)  # P(tasks of the unit | trial), and the events scaled for p
    _curvature.curve(
        lattice, 0, units, p.dt, p.mistake, p.peak, p.rise, p.fall, p.steps_late, p.part_late, p.decay,
        p.hold, column, _buffers(lattice, states, len(kept)), of_units, rates, bends,
    )  # fmt: skip
    log_likelihood, share = expectation.log_likelihood, expectation.unit
    trials = len(log_likelihood)
    score, hessian = np.zeros((trials, count)), np.zeros((count, count))
    of_trials = np.zeros((trials, len(kept)))
    np.add.at(of_trials, trial, share[:, None] * rates)
    weight = np.ones(trials) if evidence.weights is None else evidence.weights
    of_units = share * weight[trial]
    bent = np.einsum("u,uab->ab", of_units, bends) + (rates * of_units[:, None]).T @ rates
    hessian[np.ix_(kept, kept)] = bent - (of_trials * weight[:, None]).T @ of_trials
    score[:, kept] = of_trials
    return Curvature(log_likelihood, score, hessian)


def _buffers(lattice: Lattice, states: int, size: int) -> Any:
    """Room for the unit with the longest tracks and the layer with the most memories."""
    from learn._curvature import Buffers

    starts = np.append(lattice.track_at, lattice.size)[lattice.unit_tracks]
    levels = int(np.diff(starts).max(initial=1))
    memories = int(np.diff(lattice.layer_memories).max(initial=1))
    pair = np.zeros((5, 5), dtype=np.int64)
    pair[np.triu_indices(5)] = np.arange(15)
    return Buffers(
        pair=np.maximum(pair, pair.T),
        share=np.zeros(levels),
        first=np.zeros((5, levels)),
        second=np.zeros((15, levels)),
        weight=np.zeros((2, memories)),
        rates=np.zeros((2, memories, size)),
        bends=np.zeros((2, memories, size, size)),
        by=np.zeros(1 + 6 * states, dtype=np.int64),
        rate=np.zeros(1 + 6 * states),
        by_one=np.zeros(20 * states, dtype=np.int64),
        by_other=np.zeros(20 * states, dtype=np.int64),
        bend=np.zeros(20 * states),
        quiet_rates=np.zeros(size),
        quiet_bends=np.zeros((size, size)),
    )


@dataclass(frozen=True)
class Information:
    """Derivatives of what a fit climbs at `point`, in its k free coordinates, prior included.

    `bend` (k, k) is the observed information, minus the second derivatives; `score` (trials, k) the rates
    of each trial's log-likelihood, unweighted and without the prior; `jacobian` (n, k) the rates of the
    natural parameters in the coordinates.
    """

    point: Floats
    bend: Floats
    score: Floats
    jacobian: Floats

    def covariance(self, smooth: Bools) -> Floats:
        """The inverse information of the `smooth` coordinates (k,), the others held; 0 in the others.

        Not a number throughout where the log-likelihood does not bend downward in some direction.
        """
        inner = self.bend[np.ix_(smooth, smooth)]
        covariance = np.zeros_like(self.bend)
        if smooth.any():
            positive = np.linalg.eigvalsh(inner)[0] > 0
            inverse = np.linalg.inv(inner) if positive else np.full_like(inner, np.nan)
            covariance[np.ix_(smooth, smooth)] = inverse
        return covariance

    def robust_covariance(self, smooth: Bools, groups: Sequence[Hashable], weights: Floats | None) -> Floats:
        """The sandwich: scores summed over each of the `groups` of trials (teachers), which may differ.

        Not a number where there is one group alone. Source: Liang and Zeger, Longitudinal data analysis
        using generalized linear models, 1986.
        """
        order = {name: number for number, name in enumerate(dict.fromkeys(groups))}
        member = np.array([order[name] for name in groups], dtype=np.int64)
        sums = np.zeros((len(order), len(self.point)))
        np.add.at(sums, member, self.score if weights is None else self.score * weights[:, None])
        if len(order) < 2:
            return np.full_like(self.bend, np.nan)
        bread, factor = self.covariance(smooth), len(order) / (len(order) - 1)
        return np.asarray(factor * bread @ (sums.T @ sums) @ bread, dtype=np.float64)


def information(objective: Objective, point: Floats) -> Information:
    """The observed information at a point of a fit's objective.

    The coordinates are functions of the natural parameters: their own curvature is that of the exact
    rates of `Coordinates`, by central differences.
    """
    space = objective.space
    vector = space.vector(point)
    found = curvature(objective.evidence, parameters_at(vector, objective.base), space.free)
    weights = objective.evidence.weights
    rates = found.score.sum(axis=0) if weights is None else weights @ found.score
    hessian = found.hessian.copy()
    if objective.prior is not None:
        rates[0] += objective.prior.rate(float(vector[0]))
        hessian[0, 0] += _prior_bend(objective.prior, float(vector[0]))
    jacobian = np.array([space.rates(vector, row) for row in np.eye(len(vector))])
    bend = jacobian.T @ hessian @ jacobian
    for i in range(len(point)):
        step = STEP * np.eye(len(point))[i]
        ahead, behind = (space.rates(space.vector(at), rates) for at in (point + step, point - step))
        bend[i] += (ahead - behind) / (2 * STEP)
    if objective.pull is not None:
        bend -= objective.pull.precision
    score = np.array([space.rates(vector, row) for row in found.score])
    return Information(point, -(bend + bend.T) / 2, score, jacobian)


def _prior_bend(prior: MistakePrior, mistake: float) -> float:
    """The second derivative of the log prior of mistake."""
    return -prior.steps * (prior.mean / mistake**2 + (1 - prior.mean) / (1 - mistake) ** 2)
