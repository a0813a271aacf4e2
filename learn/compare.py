"""Teacher models against each other: on people they were not fitted to, as planners, and as robots."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from learn.calibration import Calibration, calibration
from learn.closed_loop import ClosedLoop, outcome_of, run_closed_loop
from learn.decisions import Disagreement, disagreement
from learn.exposure import trials_given
from learn.held_out import BLIND, LEARNED, HeldOut, held_out
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial

if TYPE_CHECKING:
    from learn.result import FitResult

Stage = Callable[[str, int], AbstractContextManager[Callable[[int], None]]]


def quiet(_text: str, _total: int) -> AbstractContextManager[Callable[[int], None]]:
    """A stage that says nothing."""
    return nullcontext(lambda _done: None)


@dataclass(frozen=True)
class Comparison:
    """Everything that `compare_models` found; see its parts for the laws and units.

    `fitted` is the fit to all trials: the robot `learned` of the closed loop. `disagreement[arm]` is of
    that arm against `learned`. `calibration` is by arm, on the logs and in the closed loop. `truth`
    says who taught in the closed loop, `sources` what the logs hold (`simulated` or `human`).
    """

    trials: int
    people: int
    presses: int
    sources: tuple[str, ...]
    held_out: HeldOut
    fitted: "FitResult"
    robots: Mapping[str, TeacherModel]
    disagreement: Mapping[str, Disagreement]
    calibration: Mapping[str, Calibration]
    loop: ClosedLoop | None
    loop_calibration: Mapping[str, Calibration]
    truth: str
    truths: tuple[TeacherModel, ...]

    @property
    def baseline(self) -> str:
        """The arm that the others are held against: the first model given."""
        return next(iter(self.held_out.models))

    def to_json(self) -> dict[str, Any]:
        """Plain values, without the single trials (they are in the tables)."""
        scored = self.held_out
        document: dict[str, Any] = {
            "trials": self.trials,
            "people": self.people,
            "presses": self.presses,
            "sources": list(self.sources),
            "baseline": self.baseline,
            "folds_converged": list(scored.converged),
            "held_out": {
                arm: {
                    "log_likelihood": float(scored.log_likelihood[arm].sum()),
                    "per_trial": scored.per_trial(arm).to_json(),
                    "per_press": scored.per_press(arm).to_json(),
                    "gain_per_trial": scored.per_trial(arm, self.baseline).to_json(),
                    "gain_per_press": scored.per_press(arm, self.baseline).to_json(),
                    "in_sample_trials": int(scored.in_sample[arm].sum()),
                }
                for arm in scored.arms
            },
            "decisions": {arm: found.to_json() for arm, found in self.disagreement.items()},
            "calibration_logs": {arm: found.to_json() for arm, found in self.calibration.items()},
        }
        if self.loop is not None:
            document["closed_loop"] = loop_json(self.loop, self.baseline) | {"truth": self.truth}
            document["calibration_closed_loop"] = {
                arm: found.to_json() for arm, found in self.loop_calibration.items()
            }
        return document


def loop_json(loop: ClosedLoop, baseline: str) -> dict[str, Any]:
    """Means, paired differences and ratios of a closed loop, as plain values."""
    arms = {}
    for arm in loop.arms:
        arms[arm] = {
            what: loop.mean(arm, what).to_json() for what in ("time", "correct", "timeout", "presses")
        }
        if arm != baseline:
            arms[arm]["time_ratio"] = loop.time_ratio(arm, baseline).to_json()
            for what in ("time", "correct", "presses"):
                arms[arm][f"{what}_difference"] = loop.difference(arm, baseline, what).to_json()
    return {"settings": dict(loop.settings), "arms": arms}


def compare_models(
    trials: Sequence[Trial],
    models: Mapping[str, TeacherModel],
    *,
    truth: Sequence[TeacherModel] = (),
    truth_note: str = "the model learned from all of the logs",
    folds: int = 5,
    blind: bool = True,
    decisions: int = 300,
    loop_trials: int = 100,
    horizon: int = 3,
    threshold: float = 0.98,
    max_steps: int = 600,
    seed: int = 0,
    jobs: int = 2,
    fit_options: Mapping[str, Any] | None = None,
    stage: Stage = quiet,
) -> Comparison:
    """Compare `models` (the first is the baseline), `learned`, refitted by fold, and the blind HMM.

    In the closed loop, teachers are drawn from `truth`, or from the model learned from all trials if
    it is empty: `truth_note` says so in reports. `decisions` and `loop_trials` may be 0. Nothing
    depends on `jobs`. Raises FitError for trials that cannot be fitted or split by people, ValueError
    for no models.
    """
    from learn import fit

    if not models:
        raise ValueError("compare_models: needs at least one model to hold the learned one against")
    trials = trials_given(trials, "a comparison")
    options = {"seed": seed} | dict(fit_options or {})
    count = min(folds, len({t.participant_id or t.trial_id for t in trials}))
    with stage("fitting by folds of people", count) as progress:
        scored = held_out(
            trials, models, folds=folds, seed=seed, blind=blind, fit_options=options, jobs=jobs,
            progress=progress,
        )  # fmt: skip
    fitted = fit(trials, world=trials[0].world, **options)
    robots = {**models, LEARNED: fitted.model}
    return Comparison(
        trials=len(trials),
        people=len(set(scored.people)),
        presses=int(scored.presses.sum()),
        sources=tuple(sorted({trial.source for trial in trials})),
        held_out=scored,
        fitted=fitted,
        robots=robots,
        disagreement=_disagreements(trials, scored, decisions, horizon, threshold, seed, jobs, stage),
        calibration=_on_logs(trials, scored, threshold),
        **_in_the_loop(
            trials, robots, tuple(truth) or (fitted.model,), truth_note, loop_trials, horizon, threshold,
            max_steps, seed, jobs, stage,
        ),
    )  # fmt: skip


def _disagreements(
    trials: Sequence[Trial],
    scored: HeldOut,
    sample: int,
    horizon: int,
    threshold: float,
    seed: int,
    jobs: int,
    stage: Stage,
) -> dict[str, Disagreement]:
    found = {}
    for arm in scored.models if sample else ():
        with stage(f"planning anew: {arm}", len(trials)) as progress:
            found[arm] = disagreement(
                trials,
                scored.people,
                lambda n, arm=arm: scored.model(arm, n),  # type: ignore[misc]
                lambda n: scored.model(LEARNED, n),
                horizon=horizon,
                sample=sample,
                threshold=threshold,
                seed=seed,
                jobs=jobs,
                progress=progress,
            )
    return found


def _on_logs(trials: Sequence[Trial], scored: HeldOut, threshold: float) -> dict[str, Calibration]:
    known = [n for n, trial in enumerate(trials) if trial.task is not None]
    people = [scored.people[n] for n in known]
    return {
        arm: calibration(
            [outcome_of(trials[n], scored.model(arm, n)) for n in known], people, threshold, goal=threshold,
            dt=trials[0].dt,
        )
        for arm in scored.arms
        if arm != BLIND and known
    }  # fmt: skip


def _in_the_loop(
    trials: Sequence[Trial],
    robots: Mapping[str, TeacherModel],
    truths: tuple[TeacherModel, ...],
    note: str,
    count: int,
    horizon: int,
    threshold: float,
    max_steps: int,
    seed: int,
    jobs: int,
    stage: Stage,
) -> dict[str, Any]:
    if not count:
        return {"loop": None, "loop_calibration": {}, "truth": note, "truths": truths}
    with stage("closed loop", count) as progress:
        loop = run_closed_loop(
            trials[0].world, robots, truths, count, horizon=horizon, seed=seed, jobs=jobs,
            threshold=threshold, max_steps=max_steps, progress=progress,
        )  # fmt: skip
    judged = {
        arm: calibration(
            loop.outcomes[arm], loop.groups, threshold, goal=threshold, ended_at=threshold, dt=loop.dt
        )
        for arm in loop.arms
    }
    return {"loop": loop, "loop_calibration": judged, "truth": note, "truths": truths}
