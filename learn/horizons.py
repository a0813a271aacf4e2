"""Does looking further help? The same teaching trials with robots that look 1, 2, 3, ... steps ahead.

    python -m learn.horizons --trials 200 --horizons 1,2,3,5,7,0.1s --out horizons-results

Robots have the intuitive model or the one fitted to a simulated data set; teachers have that set's true
model. Every trial is kept as soon as it is done: the same command goes on where it was stopped, and reports
whatever there is.
"""

import argparse
import json
import math
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from learn.closed_loop import Design, Runner
from learn.horizon_summary import Arm, summary, table, trial_rows
from learn.kept_rows import KeptRows
from taskcomm.logs import LogError, read_trials
from taskcomm.parallel import map_in_order
from taskcomm.robot import FAR
from taskcomm.teacher import ModelError, TeacherModel
from taskcomm.world import BallWorld, World

DATA = Path("datasets") / "simulated-large"
LEARNED = "learned"


@dataclass
class Study:
    """One trial of one arm at a time, kept in a file.

    Called with (arm, n) it runs trial n of that arm, unless the time of day (time.time()) is past `until`. A
    row holds what the trial came to, and for every decision its wall time as a share of the time step,
    and how many steps it looked ahead. A decision that was remembered from another trial of the
    arm counts with the time it took there.
    """

    runner: Runner
    kept: KeptRows
    until: float = math.inf

    def __call__(self, item: tuple[Arm, int]) -> None:
        arm, index = item
        if time.time() >= self.until:
            return
        if not self.runner.robots:  # the search is loaded now, and not within a decision
            self.runner.warm_up()
        started = time.perf_counter()
        trial = self.runner.trial(arm.name, index)
        memory = self.runner.memory(arm.name)
        row = {
            "trial": index,
            "teacher": self.runner.group(index),
            "model": arm.model,
            "mode": arm.mode,
            "task": str(trial.task),
            "steps": trial.num_steps,
            "correct": bool(trial.correct),
            "timeout": trial.reason == "timeout",
            "presses": int(trial.presses.sum()),
            "share": [float(f"{made.seconds / self.runner.dt:.3g}") for made in memory.made],
            "reached": [made.horizon for made in memory.made],
            "anew": memory.anew,
            "seconds": round(time.perf_counter() - started, 3),
        }
        self.kept.append(row)

    def run(self, arms: Sequence[Arm], trials: int, jobs: int = 1) -> list[dict[str, Any]]:
        """Run what is not kept yet of `trials` trials of `arms`, trial by trial; gives all rows of them."""
        done = {(row["model"], row["mode"], row["trial"]) for row in self.kept.rows()}
        items = [(arm, n) for n in range(trials) for arm in arms if (arm.model, arm.mode, n) not in done]
        if items and time.time() < self.until:
            self.runner.warm_up()
            map_in_order(self, items, jobs, _progress(len(items)) if sys.stderr.isatty() else None)
        found = {(row["model"], row["mode"], row["trial"]): row for row in self.kept.rows()}
        wanted = {(arm.model, arm.mode) for arm in arms}
        return [row for key, row in sorted(found.items()) if key[:2] in wanted and key[2] < trials]


def _progress(total: int) -> Any:
    def told(done: int) -> None:
        print(f"\r{done} of {total} trials", end="" if done < total else "\n", file=sys.stderr)

    return told


def study(
    folder: Path,
    world: World,
    models: Mapping[str, TeacherModel],
    truths: Sequence[TeacherModel],
    modes: Sequence[str],
    *,
    seed: int = 0,
    threshold: float = 0.98,
    max_steps: int = 600,
    until: float = math.inf,
) -> tuple[Study, list[Arm]]:
    """The study in `folder`, begun or gone on with, and its arms: every model in every mode.

    A mode is a number of steps, such as "5", or a deadline for each decision, such as "0.4s". Raises
    ValueError for a mode that is neither, or a folder with another study, ModelError for models with
    different dt.
    """
    arms = [Arm(model, mode) for model in models for mode in modes]
    designs = {arm.name: Design(models[arm.model], arm.horizon or FAR, arm.deadline) for arm in arms}
    runner = Runner(world, designs, tuple(truths), seed, threshold, max_steps)
    about = {
        "world": repr(world),
        "models": {name: model.sha256 for name, model in models.items()},
        "truths": [model.sha256 for model in truths],
        "seed": seed,
        "threshold": threshold,
        "max_steps": max_steps,
        "furthest": FAR,
    }
    folder.mkdir(parents=True, exist_ok=True)
    kept = KeptRows(folder / "trials.jsonl")
    kept.begin(about)
    return Study(runner, kept, until), arms


def true_teachers(data: Path) -> list[TeacherModel]:
    """The true model of every teacher of a simulated data set; one, where all are alike."""
    if (data / "teacher.json").exists():
        return [TeacherModel.load(data / "teacher.json")]
    teachers = json.loads((data / "teachers.json").read_text(encoding="utf-8"))
    return [TeacherModel.from_dict(model) for model in teachers.values()]


def learned_model(data: Path, file: Path) -> TeacherModel:
    """The model fitted to all trials of a data set; taken from `file` if it is there, else put there."""
    if file.exists():
        return TeacherModel.load(file)
    from learn import fit

    trials = read_trials(data)
    model = fit(trials, world=trials[0].world).model
    file.parent.mkdir(parents=True, exist_ok=True)
    model.save(file)
    return model


def main(arguments: Sequence[str] | None = None) -> int:
    """Run, report and draw."""
    parser = argparse.ArgumentParser(
        prog="python -m learn.horizons", description="Does looking further help?"
    )
    parser.add_argument("--trials", type=int, default=200, help="trials of every robot; default 200")
    parser.add_argument(
        "--horizons",
        default="1,2,3,5,7,0.1s",
        help="steps looked ahead; or, with an s, a deadline in seconds",
    )
    parser.add_argument("--models", default=f"intuitive,{LEARNED}", help="which of intuitive, learned")
    parser.add_argument("--data", type=Path, default=DATA, help="a simulated set; its fit, its true teachers")
    parser.add_argument("--out", type=Path, default=Path("horizons-results"), help="folder of the rows")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1, help="processes; more than cores spoil the times")
    parser.add_argument("--minutes", type=float, default=math.inf, help="begin no trial after so many")
    chosen = parser.parse_args(arguments)
    try:
        return _run(chosen)
    except (LogError, ModelError, OSError, ValueError) as error:
        print(error, file=sys.stderr)
        return 1


def _run(chosen: argparse.Namespace) -> int:
    from learn.horizon_figure import horizon_figure
    from learn.plots import csv_text, save

    world, out, names = BallWorld(), chosen.out, chosen.models.split(",")
    for name in names:
        if name not in ("intuitive", LEARNED):
            raise ValueError(f"models: {name!r} is neither intuitive nor {LEARNED}")
    if chosen.trials < 1:
        raise ValueError(f"trials: at least 1, not {chosen.trials}")
    models = {
        "intuitive": TeacherModel.intuitive(),
        LEARNED: learned_model(chosen.data, out / "learned.json"),
    }
    begun, arms = study(
        out, world, models, true_teachers(chosen.data), chosen.horizons.split(","),
        seed=chosen.seed, until=time.time() + 60 * chosen.minutes,
    )  # fmt: skip
    wanted = [arm for arm in arms if arm.model in names]
    rows = begun.run(wanted, chosen.trials, chosen.jobs)
    found = summary(rows, begun.runner.dt)
    if not found:
        print(f"{out}: no trial is done yet", file=sys.stderr)
        return 1
    text = table(found, begun.runner.dt, FAR)
    (out / "table.txt").write_text(text, encoding="utf-8")
    (out / "summary.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    (out / "trials.csv").write_text(csv_text(trial_rows(rows, begun.runner.dt)), encoding="utf-8")
    save(horizon_figure(found), out / "horizons.png", found)
    print(text)
    print(f"in {out}: table.txt, horizons.png and .csv, summary.json, trials.csv")
    return 0


if __name__ == "__main__":
    sys.exit(main())
