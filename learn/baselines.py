"""What a table-top is worth beside simpler and freer accounts of the same presses."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from learn.bootstrap import Interval, ratio_interval
from learn.em import fit
from learn.estep import log_likelihoods
from learn.freebins import FreeBins
from learn.held_out import folds_of_people, person_of
from learn.result import FitResult
from learn.settings import Settings
from taskcomm.lattice import Floats
from taskcomm.parallel import map_in_order
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial

REFIT_STARTS = 2  # the initial model and a wide one; the fit to all trials has looked from more
CONSTANT, FITTED, DECAY, BINS = "constant probability", "fitted table-top", "with decay", "free bins"


@dataclass(frozen=True)
class Arm:
    """One account of the presses: its free parameters, and log-likelihoods of each trial in nats.

    `log_likelihood` is with everything known, `held_out` without the trial's fold, both (trials,).
    `model` is the teacher model that it is, if it is one; `converged` says whether every fit did.
    """

    parameters: int
    log_likelihood: Floats
    held_out: Floats
    model: TeacherModel | None = None
    converged: bool = True


@dataclass(frozen=True)
class Baselines:
    """Accounts of the same trials, side by side.

    `people[n]` is whose trial n is; `fold[n]` is the fold that it was held out with, whole people (or,
    where there is one person alone, whole trials) together, as `held_out_by` says.
    """

    arms: Mapping[str, Arm]
    people: tuple[str, ...]
    fold: NDArray[np.int64]
    held_out_by: str

    def per_trial(self, arm: str, baseline: str | None = None) -> Interval:
        """Held-out log-likelihood per trial, minus the baseline's; people are resampled whole."""
        gain = self.arms[arm].held_out - (0 if baseline is None else self.arms[baseline].held_out)
        return ratio_interval(gain, np.ones(len(gain)), self.people)

    def bic(self, arm: str) -> float:
        """Free parameters times log(people), minus twice the log-likelihood; the smaller the better.

        People, who are held out and resampled too, are what the sample counts (trials, for one person).
        """
        found, units = self.arms[arm], len(set(self.people))
        size = units if self.held_out_by == "person" else len(self.fold)
        return float(found.parameters * np.log(size) - 2 * found.log_likelihood.sum())

    def to_json(self) -> dict[str, Any]:
        """The table as plain values."""
        rows = [
            {
                "account": name,
                "parameters": arm.parameters,
                "log_likelihood": float(arm.log_likelihood.sum()),
                "bic": self.bic(name),
                "held_out_per_trial": self.per_trial(name).to_json(),
                f"minus_{CONSTANT.replace(' ', '_')}": self.per_trial(name, CONSTANT).to_json(),
                "converged": arm.converged,
            }
            for name, arm in self.arms.items()
        ]
        return {"held_out_by": self.held_out_by, "folds": int(self.fold.max()) + 1, "accounts": rows}


def compare_baselines(
    trials: Sequence[Trial],
    fitted: FitResult,
    given: Mapping[str, TeacherModel],
    *,
    folds: int = 5,
    seed: int = 0,
    jobs: int = 1,
    progress: Callable[[int], None] | None = None,
) -> Baselines:
    """The fitted table-top beside a constant, models as `given`, a table-top with decay, and free bins.

    `fitted` is the fit to all `trials`, whose tasks must be known; the others have its settings and its
    initial model, but REFIT_STARTS starts at most. The table-top with decay starts from the one without, and
    is left out where `fitted` has a decay already. People are held out whole; with one person alone,
    trials are. Raises FitError for a single trial.
    """
    people = tuple(map(person_of, trials))
    by = "person" if len(set(people)) > 1 else "trial"
    fold = folds_of_people(people if by == "person" else [trial.trial_id for trial in trials], folds, seed)
    prior = fitted.settings.prior
    prior = prior and replace(prior, model=prior.model or fitted.initial)  # wherever a fit starts
    few = replace(fitted.settings, starts=min(fitted.settings.starts, REFIT_STARTS), prior=prior)
    settings = {FITTED: few}
    if not fitted.settings.decays and all(top.decay is None for top in fitted.initial.approvals.values()):
        settings[DECAY] = replace(few, decays=True)
    refit = _Refit(tuple(trials), fold, fitted, settings)
    whole, *parts = map_in_order(refit, [None, *range(int(fold.max()) + 1)], jobs, progress)
    arms: dict[str, Arm] = {}
    for name, found in whole.items():
        held = np.empty(len(trials))
        for k, part in enumerate(parts):
            held[fold == k] = part[name].scores
        converged = all(part[name].converged for part in (whole, *parts))
        arms[name] = Arm(found.parameters, found.scores, held, found.model, converged)
    for name, model in given.items():
        scores = np.asarray(log_likelihoods(trials, trials[0].world, model))
        arms[name] = Arm(0, scores, scores, model)
    arms = {name: arms[name] for name in (CONSTANT, *given, *settings, BINS)}
    return Baselines(arms, people, fold, by)


class _Found(NamedTuple):
    """One account, fitted without a fold, and the log-likelihoods of that fold's trials."""

    scores: Floats
    parameters: int
    model: TeacherModel | None
    converged: bool


@dataclass(frozen=True)
class _Refit:
    """All accounts without one fold, or of all trials (None); run in a process of its own."""

    trials: tuple[Trial, ...]
    fold: NDArray[np.int64]
    fitted: FitResult
    settings: Mapping[str, Settings]

    def __call__(self, left_out: int | None) -> dict[str, _Found]:
        kept = [trial for trial, fold in zip(self.trials, self.fold, strict=True) if fold != left_out]
        left = [t for t, fold in zip(self.trials, self.fold, strict=True) if left_out in (None, fold)]
        world, found = kept[0].world, {}
        for name, bins in ((CONSTANT, FreeBins.fit(kept, constant=True)), (BINS, FreeBins.fit(kept))):
            found[name] = _Found(bins.log_likelihoods(left), bins.num_free, None, True)
        start = self.fitted.initial
        for name, settings in self.settings.items():  # FITTED first
            known = left_out is None and name == FITTED
            one = self.fitted if known else fit(kept, world, start, settings=settings)
            start = one.model
            scores = np.asarray(log_likelihoods(left, world, one.model))
            found[name] = _Found(scores, informed_parameters(one), one.model, one.converged)
        return found


def informed_parameters(fitted: FitResult) -> int:
    """How many parameters were learned from data: the free ones, but for those marked "no data"."""
    free = dict(zip(fitted.parameters, fitted.free.tolist(), strict=True))
    without = [name for name, mark in fitted.marks.items() if mark == "no data" and free[name]]
    return fitted.num_free - len(without)
