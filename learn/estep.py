"""The E-step: what the presses of every trial say of reasons and memories, at one set of parameters."""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from learn.exposure import Exposure, FitError, expose
from taskcomm.lattice import Floats
from taskcomm.parallel import over_ranges
from taskcomm.smoother import Chain, smooth
from taskcomm.teacher import Parameters, TeacherModel
from taskcomm.trials import Trial
from taskcomm.world import World

LEAST, TINY = -1e300, 1e-300  # stand for -inf and 0 where a trial is impossible


@dataclass(frozen=True)
class Expectation:
    """The E-step's answer, weighted by P(task | trial) where the task is unknown, and by trial weights.

    `log_likelihood` (trials,) in nats; `memory` (memories,) is P(memory | trial); `press`
    (memories, 2 + M) is P(memory, M at the event that ends it | trial), columns as `mental_states`;
    `rates` (1 + 6 M,) are those of the summed log-likelihood in mistake, then peaks, rises, falls,
    delays, decays and holds; `unit` (units,) is P(tasks of the unit | trial),
    unweighted; `value` is the weighted sum of the log-likelihoods, in nats.
    """

    log_likelihood: Floats
    memory: Floats
    press: Floats
    rates: Floats
    unit: Floats
    value: float


class Evidence:
    """All trials, ready for the E-step and for the expected log-likelihood of the M-step.

    It keeps buffers for one evaluation at a time; what it returns is the caller's.
    """

    def __init__(self, exposure: Exposure) -> None:
        self.exposure = exposure
        self.chain = Chain(exposure.lattice)
        self._by_share, self._spread = np.zeros_like(self.chain.share), np.zeros_like(self.chain.waiting)
        trial = exposure.unit_trial
        self._first = np.flatnonzero(np.diff(trial, prepend=-1))
        with np.errstate(divide="ignore"):
            self._log_prior = np.log(exposure.unit_prior)
        self.weights: Floats | None = None

    def with_weights(self, weights: ArrayLike | None) -> Self:
        """The same trials, their log-likelihoods multiplied by `weights` (trials,); it shares the buffers.

        Raises FitError for another number of weights, or ones that are not finite and at least 0.
        """
        other = copy(self)
        other.weights = None if weights is None else np.array(weights, dtype=np.float64)
        count = len(self.exposure.trial_ids)
        if other.weights is not None:
            if other.weights.shape != (count,):
                raise FitError(f"weights: must be {count} numbers, one per trial, not {other.weights.shape}")
            if not (np.isfinite(other.weights) & (other.weights >= 0)).all() or not other.weights.any():
                raise FitError("weights: must be finite, at least 0, and not all 0")
        return other

    def _total(self, log_likelihoods: Floats) -> float:
        return float(log_likelihoods.sum() if self.weights is None else self.weights @ log_likelihoods)

    def _smooth(self, unit: Floats) -> None:
        self.chain.smooth(unit if self.weights is None else unit * self.weights[self.exposure.unit_trial])

    def log_likelihoods(self, parameters: Parameters) -> Floats:
        """Log-likelihood of each trial in nats: given its task, or summed over tasks."""
        return self._over_tasks(self.chain.run(parameters))[0]

    def _over_tasks(self, of_units: Floats) -> tuple[Floats, Floats]:
        """Log-likelihoods of trials, -inf for an impossible one, and P(unit | trial)."""
        trial, joint = self.exposure.unit_trial, of_units + self._log_prior
        best = np.maximum(np.maximum.reduceat(joint, self._first), LEAST)
        weight = np.exp(joint - best[trial])
        total = np.add.reduceat(weight, self._first)
        with np.errstate(divide="ignore"):
            return best + np.log(total), weight / np.maximum(total, TINY)[trial]

    def expect(self, parameters: Parameters) -> Expectation:
        """The E-step at `parameters`."""
        log_likelihood, unit = self._over_tasks(self.chain.run(parameters))
        self._smooth(unit)
        flow, memory = self.chain.flow, self.chain.memory
        _, rates = self._sum(parameters, memory, flow, as_counts=False)
        press, value = self.chain.press, self._total(log_likelihood)
        return Expectation(log_likelihood, memory, press, rates, unit, value)

    def value(self, parameters: Parameters) -> float:
        """Log-likelihood of all trials, weighted, in nats."""
        return self._total(self.log_likelihoods(parameters))

    def value_and_rates(self, parameters: Parameters) -> tuple[float, Floats]:
        """Log-likelihood of all trials in nats, and its rates, shape (1 + 6 M,)."""
        log_likelihood, unit = self._over_tasks(self.chain.run(parameters))
        self._smooth(unit)
        _, rates = self._sum(parameters, self.chain.memory, self.chain.flow, as_counts=False)
        return self._total(log_likelihood), rates

    def expected_log_likelihood(
        self, parameters: Parameters, expectation: Expectation
    ) -> tuple[float, Floats]:
        """Q: sum of E[log P(M_t | memory, cues)], and its rates, shape (1 + 6 M,).

        Q is -inf where a press has a reason that these parameters rule out.
        """
        self.chain.trace(parameters)
        return self._sum(parameters, expectation.memory, expectation.press, as_counts=True)

    def _sum(
        self, parameters: Parameters, memory: Floats, press: Floats, as_counts: bool
    ) -> tuple[float, Floats]:
        from learn import _slopes

        p, chain, lattice = parameters, self.chain, self.exposure.lattice

        def part(first: int, last: int) -> Floats:
            answer, rates = np.zeros(2), np.zeros((6, len(p.peak)))
            _slopes.expected(
                lattice, chain.courses, first, last, p.mistake, p.peak, chain.share, chain.waiting,
                chain.before, chain.scale, memory, press, as_counts, self._spread, self._by_share, answer,
            )  # fmt: skip
            _slopes.collapse(
                lattice, chain.courses, first, last, p.peak, chain.share, chain.slope, self._by_share, rates
            )
            return np.concatenate([answer, rates.ravel()])

        total = np.sum(over_ranges(part, chain.ranges), axis=0)
        return float(total[0]), total[1:]


def log_likelihood(
    trials: Sequence[Trial], world: World, model: TeacherModel, prior: ArrayLike | None = None
) -> float:
    """Log-likelihood of the presses of all trials, in nats: the sum over steps of log P(O_t | past).

    Given the task where it is known; otherwise summed over tasks weighted by `prior` (uniform by
    default). Equal to what `Belief.update` predicts, step by step. Raises FitError, see `expose`.

    >>> from taskcomm.world import NOA, BallWorld
    >>> from taskcomm.trials import Step
    >>> world = BallWorld()
    >>> trial = Trial("quiet", world, world.tasks[0], (Step(NOA, False),) * 2)
    >>> round(log_likelihood([trial], world, TeacherModel.intuitive()), 6)
    -0.010025

    Source: MODEL.md, section 7.
    """
    return float(log_likelihoods(trials, world, model, prior).sum())


def log_likelihoods(
    trials: Sequence[Trial], world: World, model: TeacherModel, prior: ArrayLike | None = None
) -> Floats:
    """`log_likelihood` of each trial, shape (trials,), in nats."""
    evidence = Evidence(expose(trials, world, model, prior=prior, use="a log-likelihood"))
    return evidence.log_likelihoods(model.parameters(world.cue_names))


def responsibilities(
    trial: Trial, world: World, model: TeacherModel, prior: ArrayLike | None = None
) -> Floats:
    """P(M_t = m | whole trial) at every press: shape (presses, mental states).

    Columns as `model.mental_states`, so the first, waiting, is 0. Tasks as in `log_likelihood`.
    Raises FitError, see `expose`.
    """
    if not isinstance(trial, Trial):
        raise TypeError(f"trial: must be one Trial, not a {type(trial).__name__}")
    expose([trial], world, model, prior=prior)
    return smooth(trial, model, world, prior).reasons
