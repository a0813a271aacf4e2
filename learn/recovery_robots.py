"""Robots with models learned from simulated studies, against the intuitive and the true model."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from learn.bootstrap import Interval
from learn.calibration import calibration
from learn.closed_loop import ClosedLoop, Design, Outcome, Runner, outcome_of
from learn.compare import Stage, quiet
from learn.kept_rows import KeptRows
from learn.recovery import REFERENCES
from taskcomm.parallel import map_in_order
from taskcomm.teacher import TeacherModel
from taskcomm.world import World

Row = Mapping[str, Any]
TRUE, INTUITIVE = REFERENCES
BATCH = 20  # trials that a robot runs before the next one's turn, where there is one model for all


@dataclass(frozen=True)
class RobotPlan:
    """The closed loop: `trials` trials of every robot, with the models learned from studies of one `source`.

    Trial n has the same task and the same luck for every robot. The robot that learned from `sizes` trials
    is another one from trial to trial: each study in turn lends its model, at most `models` of them.
    """

    source: str
    sizes: tuple[int, ...] = (22, 44, 200)
    trials: int = 200
    models: int = 20
    horizon: int = 3
    threshold: float = 0.98
    max_steps: int = 600
    seed: int = 0


@dataclass(frozen=True)
class _Drive:
    """Some trials of one robot: `study` is whose model it has, -1 for none's."""

    arm: str
    study: int
    model: TeacherModel
    trials: tuple[int, ...]


@dataclass
class _Driving:
    """Runs robots with the teachers of one truth, and keeps what their trials came to."""

    name: str
    world: World
    truth: TeacherModel
    plan: RobotPlan
    kept: KeptRows

    def __call__(self, drive: _Drive) -> None:
        plan = self.plan
        arms = {drive.arm: Design(drive.model, plan.horizon)}
        runner = Runner(self.world, arms, (self.truth,), plan.seed, plan.threshold, plan.max_steps)
        for index in drive.trials:
            outcome = outcome_of(runner.trial(drive.arm, index), drive.model)
            row = {"truth": self.name, "arm": drive.arm, "trial": index, "study": drive.study}
            row |= {"steps": outcome.steps, "correct": outcome.correct, "timeout": outcome.timeout}
            row |= {"presses": outcome.presses, "highest": [round(float(p), 4) for p in outcome.highest]}
            self.kept.append(row | {"right": "".join("01"[int(right)] for right in outcome.right)})


def learned(size: int) -> str:
    """The arm of the robots that learned from so many trials."""
    return f"learned from {size}"


def run_robots(
    folder: Path,
    world: World,
    truths: Mapping[str, TeacherModel],
    fits: Sequence[Row],
    plan: RobotPlan,
    *,
    jobs: int = 1,
    stage: Stage = quiet,
) -> list[dict[str, Any]]:
    """Run the robots of `plan` for every truth, learned models taken from `fits`; a row for each trial.

    Rows are kept in `folder` as they are done, as `recover` does. Raises ValueError for sizes that were not
    fitted, or a folder with another run.
    """
    kept = KeptRows(folder / "robots.jsonl")
    about = {name: value for name, value in asdict(plan).items() if name not in ("sizes", "trials")}
    kept.begin({"truths": {name: model.sha256 for name, model in truths.items()}, **about})
    drives = {name: _drives(name, fits, plan) for name in truths}
    for name, truth in truths.items():
        done = {(row["arm"], row["trial"]) for row in kept.rows() if row["truth"] == name}
        left = [_left(drive, done) for drive in drives[name]]
        driving = _Driving(name, world, truth, plan, kept)
        items = [drive for drive in left if drive.trials]
        with stage(f"{name}: robots", len(items)) as progress:
            map_in_order(driving, items, jobs, progress)
    rows = {(row["truth"], row["arm"], row["trial"]): row for row in kept.rows()}
    wanted = [(name, drive.arm, n) for name in truths for drive in drives[name] for n in drive.trials]
    return [rows[key] for key in wanted]


def _left(drive: _Drive, done: set[tuple[str, int]]) -> _Drive:
    trials = tuple(index for index in drive.trials if (drive.arm, index) not in done)
    return _Drive(drive.arm, drive.study, drive.model, trials)


def _drives(truth: str, fits: Sequence[Row], plan: RobotPlan) -> list[_Drive]:
    of_truth = [row for row in fits if row["truth"] == truth]
    every, found = range(plan.trials), []
    for source in (INTUITIVE, TRUE):
        (row,) = (row for row in of_truth if row["source"] == source)
        model = TeacherModel.from_dict(row["model"])
        batches = [tuple(every[at : at + BATCH]) for at in range(0, plan.trials, BATCH)]
        found += [_Drive(source, -1, model, batch) for batch in batches]
    for size in plan.sizes:
        rows = [row for row in of_truth if (row["source"], row["size"]) == (plan.source, size)]
        if not rows:
            raise ValueError(f"robots: no study of {size} trials, {plan.source}, was fitted for {truth}")
        rows = sorted(rows, key=lambda row: row["repeat"])[: plan.models]
        for place, row in enumerate(rows):
            model = TeacherModel.from_dict(row["model"])
            found.append(_Drive(learned(size), row["repeat"], model, tuple(every[place :: len(rows)])))
    return found


def loop_of(rows: Sequence[Row], truth: str, arm: str, dt: float) -> ClosedLoop:
    """One arm beside the intuitive and the true model; the trials of one learned model are one group."""
    arms = dict.fromkeys((INTUITIVE, TRUE, arm))
    of_arm = {
        name: {row["trial"]: row for row in rows if (row["truth"], row["arm"]) == (truth, name)}
        for name in arms
    }
    trials = sorted(of_arm[arm])
    groups = tuple(n if of_arm[arm][n]["study"] < 0 else of_arm[arm][n]["study"] for n in trials)
    outcomes = {name: tuple(_outcome(of_arm[name][n]) for n in trials) for name in arms}
    return ClosedLoop(outcomes, groups, dt)


def _outcome(row: Row) -> Outcome:
    right = np.array([mark == "1" for mark in row["right"]], dtype=np.bool_)
    highest = np.array(row["highest"], dtype=np.float64)
    ended = row["steps"], row["correct"], row["timeout"], row["presses"]
    return Outcome(*ended, np.zeros(0), highest, right)


def robot_rows(rows: Sequence[Row], dt: float, threshold: float) -> list[dict[str, Any]]:
    """One flat row for each truth and arm: time to Final (s), share right, timeouts, presses.

    `time_ratio` and `correct_gain` are against the intuitive model, `time_to_true` is time over that of the
    robot that knows the true model, trial by trial. Of the trials whose belief passed `threshold`, `said`
    is the mean probability then said, `right` the share in which it was so. Intervals resample the studies
    that were learned from, with their trials, or the trials alone, whichever is the wider: a few studies say
    little of how studies differ.
    """
    found = []
    for truth, arm in dict.fromkeys((row["truth"], row["arm"]) for row in rows):
        of_studies = loop_of(rows, truth, arm, dt)
        models = {row["study"] for row in rows if (row["truth"], row["arm"]) == (truth, arm)}
        flat: dict[str, Any] = {
            "truth": truth,
            "arm": arm,
            "models": len(models),
            "trials": of_studies.trials,
        }
        told = calibration(of_studies.outcomes[arm], None, threshold, ended_at=threshold)
        flat |= {"passed": told.sure, "said": told.said}
        loops = of_studies, replace(of_studies, groups=tuple(range(of_studies.trials)))
        both = [_intervals(loop, arm, threshold) for loop in loops]
        for name in both[0]:
            wider = max((intervals[name] for intervals in both), key=lambda one: one.high - one.low)
            flat |= _spread(name, wider)
        found.append(flat)
    return found


def _intervals(loop: ClosedLoop, arm: str, threshold: float) -> dict[str, Interval]:
    means = {what: loop.mean(arm, what) for what in ("time", "correct", "timeout", "presses")}
    return means | {
        "time_ratio": loop.time_ratio(arm, INTUITIVE),
        "time_to_true": loop.time_ratio(arm, TRUE),
        "correct_gain": loop.difference(arm, INTUITIVE, "correct"),
        "right": calibration(loop.outcomes[arm], loop.groups, threshold, ended_at=threshold).right,
    }


def _spread(name: str, interval: Interval) -> dict[str, float]:
    return {name: interval.estimate, f"{name}_low": interval.low, f"{name}_high": interval.high}
