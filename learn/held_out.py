"""How well each model foresees the presses of people that it was not fitted to."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from learn.bootstrap import Interval, ratio_interval
from learn.exposure import FitError, trial_hash, trials_given
from taskcomm.parallel import map_in_order
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
LEARNED, BLIND = "learned", "input-blind"


@dataclass(frozen=True)
class HeldOut:
    """Log-likelihoods in nats of each trial's presses, under each arm, shape (trials,) each.

    `people[n]` is whose trial n is, `fold[n]` the fold it was left out with; `learned[k]` is the model
    fitted without fold k, and `converged[k]` whether that fit converged. `in_sample[arm]` marks trials
    that a given model was fitted to, by the hashes its file carries.
    """

    log_likelihood: Mapping[str, Floats]
    in_sample: Mapping[str, Bools]
    people: tuple[str, ...]
    presses: NDArray[np.int64]
    fold: NDArray[np.int64]
    models: Mapping[str, TeacherModel]
    learned: tuple[TeacherModel, ...]
    converged: tuple[bool, ...]

    @property
    def arms(self) -> tuple[str, ...]:
        return tuple(self.log_likelihood)

    def model(self, arm: str, trial: int) -> TeacherModel:
        """The teacher model of an arm for a trial: of `learned`, that of the trial's fold."""
        return self.learned[int(self.fold[trial])] if arm == LEARNED else self.models[arm]

    def per_trial(self, arm: str, baseline: str | None = None) -> Interval:
        """Mean log-likelihood per trial, minus the baseline's; people are resampled whole."""
        return ratio_interval(self._gain(arm, baseline), np.ones(len(self.people)), self.people)

    def per_press(self, arm: str, baseline: str | None = None) -> Interval:
        """Log-likelihood per press, minus the baseline's."""
        return ratio_interval(self._gain(arm, baseline), self.presses, self.people)

    def _gain(self, arm: str, baseline: str | None) -> Floats:
        ours = self.log_likelihood[arm]
        return ours if baseline is None else ours - self.log_likelihood[baseline]

    def rows(self, trials: Sequence[Trial]) -> list[dict[str, Any]]:
        """One row a trial, for a table file."""
        return [
            {"trial_id": trial.trial_id, "person": self.people[n], "fold": int(self.fold[n])}
            | {"steps": trial.num_steps, "presses": int(self.presses[n])}
            | {f"log_likelihood {arm}": float(self.log_likelihood[arm][n]) for arm in self.arms}
            for n, trial in enumerate(trials)
        ]


def person_of(trial: Trial) -> str:
    """Whose trial it is; a trial without a participant stands for a person of its own."""
    return trial.participant_id if trial.participant_id is not None else f"trial {trial.trial_id}"


def folds_of_people(people: Sequence[str], folds: int, seed: int = 0) -> NDArray[np.int64]:
    """The fold of each trial, whole people together, folds equal in people to within one.

    There are at most as many folds as people. Raises FitError for fewer than two people, since
    nobody is then left to fit to.

    >>> fold = folds_of_people(["a", "b", "a", "c"], 3)
    >>> fold[0] == fold[2], sorted(set(fold.tolist()))
    (np.True_, [0, 1, 2])
    """
    names = list(dict.fromkeys(people))
    if len(names) < 2:
        raise FitError("held-out figures need trials of at least two people (participant_id)")
    shuffled = np.random.default_rng(seed).permutation(len(names)) % min(folds, len(names))
    fold = dict(zip(names, shuffled.tolist(), strict=True))
    return np.array([fold[person] for person in people], dtype=np.int64)


def _fitted_to(model: TeacherModel) -> set[str]:
    """Hashes of the trials that a model says it was fitted to; provenance is free and may hold anything."""
    hashes = model.provenance.get("trial_sha256", ())
    return {h for h in hashes if isinstance(h, str)} if isinstance(hashes, (list, tuple)) else set()


@dataclass
class _Refit:
    """The fits without one fold, and the scores of that fold; run in a process of its own."""

    trials: tuple[Trial, ...]
    fold: NDArray[np.int64]
    options: Mapping[str, Any]
    blind: bool

    def __call__(self, left_out: int) -> tuple[TeacherModel, bool, dict[str, Floats]]:
        from learn import fit, log_likelihoods

        kept = [trial for trial, fold in zip(self.trials, self.fold, strict=True) if fold != left_out]
        left = [trial for trial, fold in zip(self.trials, self.fold, strict=True) if fold == left_out]
        result = fit(kept, world=kept[0].world, **self.options)
        scores = {LEARNED: np.asarray(log_likelihoods(left, kept[0].world, result.model))}
        if self.blind:
            from learn.blind import fit_blind

            scores[BLIND] = fit_blind(kept).score(left)
        return result.model, bool(result.converged), scores


def held_out(
    trials: Sequence[Trial],
    models: Mapping[str, TeacherModel],
    *,
    folds: int = 5,
    seed: int = 0,
    blind: bool = True,
    fit_options: Mapping[str, Any] | None = None,
    jobs: int = 1,
    progress: Callable[[int], None] | None = None,
) -> HeldOut:
    """Score every trial under `models` as they are, under models refitted without its people, and blind.

    `learned` is refitted once a fold, with `fit_options`; so is `input-blind`, an HMM of presses alone
    (with `blind`; it loads torch). Raises FitError for trials that cannot be fitted together, and
    ValueError for a model named like one of these arms.
    """
    from learn import log_likelihoods

    if {LEARNED, BLIND} & set(models):
        raise ValueError(f"{LEARNED!r} and {BLIND!r} are names of arms; call the model otherwise")
    trials = trials_given(trials, "a comparison")
    people = tuple(map(person_of, trials))
    fold = folds_of_people(people, folds, seed)
    world = trials[0].world
    scores = {arm: np.asarray(log_likelihoods(trials, world, model)) for arm, model in models.items()}
    refit = _Refit(trials, fold, dict(fit_options or {}), blind)
    refitted = map_in_order(refit, range(int(fold.max()) + 1), jobs, progress)
    for arm in refitted[0][2]:
        scores[arm] = np.empty(len(trials))
        for k, (_, _, of_fold) in enumerate(refitted):
            scores[arm][fold == k] = of_fold[arm]
    hashes = [trial_hash(trial) for trial in trials]
    seen = {arm: _fitted_to(model) for arm, model in models.items()}
    return HeldOut(
        log_likelihood=scores,
        in_sample={arm: np.array([h in seen.get(arm, ()) for h in hashes]) for arm in scores},
        people=people,
        presses=np.array([int(trial.presses.sum()) for trial in trials]),
        fold=fold,
        models=dict(models),
        learned=tuple(model for model, _, _ in refitted),
        converged=tuple(converged for _, converged, _ in refitted),
    )
