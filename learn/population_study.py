"""Does it help to know that teachers differ, and does it hurt where they do not? On simulated studies.

    python -m learn.population_study --out notebooks/results

Teachers' coordinates (log odds of mistake and peaks, log rises, log falls) are drawn about one median
teacher with a spread of 0, 0.3 or 0.6; each teaches six trials, by turns with a planning robot that has
the intuitive model and with the scripted operator. Every teacher is left out of the fits in turn and then
met trial by trial (`held_out_teachers`). With --shipped also the study of 22 teachers with two trials each in
`datasets`. Nobody took part: every teacher and operator is a program.
"""

import argparse
import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from learn.held_out_teachers import HeldOutTeachers, held_out_teachers
from learn.settings import Settings
from learn.teacher_space import TeacherSpace
from taskcomm.logs import read_trials
from taskcomm.operators import ScriptedOperator
from taskcomm.planner import EntropyPlanner
from taskcomm.robot import Controller, Robot
from taskcomm.simulate import SimulatedTeacher, run_trial
from taskcomm.studies import MEDIAN_MISTAKE, MEDIANS
from taskcomm.teacher import TableTop, TeacherModel
from taskcomm.trials import Trial
from taskcomm.wholefile import write_whole
from taskcomm.world import BallWorld

WORLD = BallWorld()
SPREADS = (0.6, 0.0, 0.3)
TEACHERS, TRIALS, FOLDS, DRAWS = 20, 6, 4, 100
SHIPPED = Path("datasets/simulated-study/trials.jsonl")


def median_teacher() -> TeacherModel:
    """The teacher in the middle of the simulated ones, as in the shipped study."""
    cues = {state: top.cue for state, top in TeacherModel.intuitive().approvals.items()}
    tops = {state: TableTop(cues[state], *values) for state, values in MEDIANS.items()}
    return TeacherModel(mistake=MEDIAN_MISTAKE, approvals=tops)


def simulated_space() -> TeacherSpace:
    """The coordinates in which simulated teachers differ: all but delay, decay and hold."""
    model = median_teacher()
    free = np.arange(1 + 6 * len(model.approvals)) < 1 + 3 * len(model.approvals)
    return TeacherSpace(model, free, Settings())


def drawn_teachers(count: int, spread: float, rng: np.random.Generator) -> list[TeacherModel]:
    """Teachers normal about the median one, each coordinate by itself; rise and fall at least a step."""
    space = simulated_space()
    middle = space.point(space.model)
    points = middle + spread * rng.standard_normal((count, len(middle)))
    return [space.model_at(point, {"simulated": True, "spread": spread}) for point in points]


def study(teachers: Sequence[TeacherModel], trials: int, seed: int, horizon: int = 2) -> list[Trial]:
    """Trials of each teacher, by turns with the robot and with the operator; tasks drawn anew."""
    model = TeacherModel.intuitive()
    robot = Robot(WORLD, model, EntropyPlanner(WORLD, model, horizon=horizon))
    taught = []
    for number, teacher in enumerate(teachers):
        for index in range(trials):
            rng = np.random.default_rng([seed, number, index])
            task = WORLD.tasks[int(rng.integers(len(WORLD.tasks)))]
            controller: Controller = robot if (number + index) % 2 == 0 else ScriptedOperator(WORLD)
            trial = run_trial(
                controller,
                SimulatedTeacher(WORLD, teacher, task),
                rng,
                trial_id=f"teacher-{number:03d}-{index + 1}",
                participant_id=f"teacher-{number:03d}",
                trial_index=index,
            )
            taught.append(trial)
    return taught


def summary(found: HeldOutTeachers, about: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Gains over the pooled model, by arm and by how many trials were known (blank: all trials)."""
    rows = []
    for arm in found.arms[1:]:
        for met in (*sorted(set(found.met.tolist())), None):
            gain = found.gain(arm, met)
            counts = {"trials": int((found.met == met).sum()) if met is not None else len(found.met)}
            rows.append(
                {**about, "arm": arm, "known": "" if met is None else met, **counts, "teachers": gain.groups}
                | {name: f"{getattr(gain, name):.4f}" for name in ("estimate", "low", "high")}
            )
    return rows


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the studies asked for and keep rows and summaries, a file of each for every study."""
    parser = argparse.ArgumentParser(prog="python -m learn.population_study", description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--spreads", type=float, nargs="*", default=list(SPREADS))
    parser.add_argument("--shipped", action="store_true", help="the shipped study too")
    parser.add_argument("--teachers", type=int, default=TEACHERS)
    parser.add_argument("--trials", type=int, default=TRIALS)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    given = parser.parse_args(arguments)
    names = [*["shipped"] * given.shipped, *(f"spread-{spread:g}" for spread in given.spreads)]
    for name in names:
        trials = _trials(name, given.teachers, given.trials, given.seed)
        found = held_out_teachers(
            trials, folds=FOLDS, seed=given.seed, jobs=given.jobs, population={"draws": DRAWS}, starts=2
        )
        rows = summary(found, {"study": name, "seed": given.seed})
        write_rows(rows, given.out / f"population-{name}.csv")
        write_rows(found.rows(), given.out / f"population-{name}-trials.csv")
        print(f"{name}: {len(trials)} trials", flush=True)
    return 0


def _trials(name: str, teachers: int, trials: int, seed: int) -> list[Trial]:
    if name == "shipped":
        return sorted(read_trials(SHIPPED), key=lambda trial: trial.trial_index)
    spread = float(name.removeprefix("spread-"))
    return study(drawn_teachers(teachers, spread, np.random.default_rng([seed, 1])), trials, seed)


def write_rows(rows: Sequence[Mapping[str, Any]], path: Path) -> None:
    """A table as CSV, written whole."""
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_whole(path, text.getvalue().encode())


if __name__ == "__main__":
    raise SystemExit(main())
