"""The simulated data sets of `datasets/`, made again to the byte.

    python -m taskcomm.studies study datasets/simulated-study
    python -m taskcomm.studies large datasets/simulated-large

Nobody took part: every teacher and every operator here is a program.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taskcomm.logs import LogError, write_trials
from taskcomm.operators import ScriptedOperator
from taskcomm.planner import EntropyPlanner
from taskcomm.robot import Controller, Robot
from taskcomm.simulate import SimulatedTeacher, run_trial
from taskcomm.tasks import Task
from taskcomm.teacher import TableTop, TeacherModel
from taskcomm.trials import Trial
from taskcomm.world import BallWorld

SEED = 2012
MISTAKEN = Task(3, 2, 2)
WORLD = BallWorld()
# Medians over teachers, by approval state: peak, rise (s), fall (s); then the spread of their logarithms.
MEDIANS = {"that_mov": (0.22, 1.0, 1.0), "that_wrt": (0.18, 1.4, 1.0), "that_dist": (0.15, 1.0, 1.4)}
MEDIAN_MISTAKE = 0.008
SPREAD, MISTAKE_SPREAD = 0.25, 0.4
POPULATION = {"that_mov": (0.25, 1.0, 1.0), "that_wrt": (0.20, 1.5, 1.0), "that_dist": (0.15, 1.0, 1.5)}


@dataclass(frozen=True)
class Session:
    """One trial of a data set before it is run: who, what, which robot, which seed."""

    trial_id: str
    participant_id: str
    trial_index: int
    condition: str
    teacher: TeacherModel
    task: Task
    horizon: int
    seed: tuple[int, ...]

    def run(self) -> Trial:
        """The trial; always the same."""
        operator = self.condition == "operator"
        return run_trial(
            _operator() if operator else _robot(self.horizon),
            SimulatedTeacher(WORLD, self.teacher, self.task),
            np.random.default_rng(self.seed),
            trial_id=self.trial_id,
            participant_id=self.participant_id,
            operator_id="scripted" if operator else None,
            trial_index=self.trial_index,
        )


_ROBOTS: dict[int, Robot] = {}


def _robot(horizon: int) -> Controller:
    if horizon not in _ROBOTS:
        model = TeacherModel.intuitive()
        _ROBOTS[horizon] = Robot(WORLD, model, EntropyPlanner(WORLD, model, horizon=horizon))
    return _ROBOTS[horizon]


def _operator() -> Controller:
    return ScriptedOperator(WORLD)


def drawn_teacher(rng: np.random.Generator) -> TeacherModel:
    """A teacher whose every parameter is log-normal about its median, to four digits."""

    def draw(median: float, spread: float, least: float = 0.0) -> float:
        return max(least, float(f"{median * np.exp(spread * rng.standard_normal()):.4g}"))

    mistake = draw(MEDIAN_MISTAKE, MISTAKE_SPREAD)
    cues = {state: top.cue for state, top in TeacherModel.intuitive().approvals.items()}
    approvals = {
        state: TableTop(cues[state], draw(peak, SPREAD), draw(rise, SPREAD, 0.5), draw(fall, SPREAD, 0.5))
        for state, (peak, rise, fall) in MEDIANS.items()
    }
    return TeacherModel(mistake=mistake, approvals=approvals)


def population_teacher() -> TeacherModel:
    """The one teacher of the large set."""
    cues = {state: top.cue for state, top in TeacherModel.intuitive().approvals.items()}
    approvals = {state: TableTop(cues[state], *values) for state, values in POPULATION.items()}
    return TeacherModel(mistake=0.01, approvals=approvals, provenance={"name": "simulated-large"})


def _pair(prefix: str, number: int, teacher: TeacherModel, horizon: int, rng: np.random.Generator) -> Any:
    """The two sessions of one teacher, robot and operator in random order, each with a task drawn."""
    conditions = [str(name) for name in rng.permutation(["pomdp", "operator"])]
    return [
        Session(
            trial_id=f"{prefix}-{number:03d}-{index + 1}",
            participant_id=f"{prefix}-{number:03d}",
            trial_index=index,
            condition=condition,
            teacher=teacher,
            task=WORLD.tasks[int(rng.integers(len(WORLD.tasks)))],
            horizon=horizon,
            seed=(SEED, horizon, number, index),
        )
        for index, condition in enumerate(conditions)
    ]


def study_sessions() -> list[Session]:
    """22 teachers of their own, two trials each: the robot with the intuitive model, the operator."""
    sessions: list[Session] = []
    for number in range(1, 23):
        rng = np.random.default_rng((SEED, number))
        sessions += _pair("study", number, drawn_teacher(rng), 5, rng)
    return sessions


def large_sessions() -> list[Session]:
    """100 teachers alike, two trials each, the robot looking ahead 3 steps."""
    teacher, sessions = population_teacher(), []
    for number in range(1, 101):
        sessions += _pair("large", number, teacher, 3, np.random.default_rng((SEED, 1000 + number)))
    return sessions


def mistake_trial(seed: int = 0, task: Task = MISTAKEN, horizon: int = 3) -> Trial:
    """The paper's mistake: a press forced in the step that ends at 3 s, while ball 1 is lit.

    The task has nothing to do with ball 1. Robot and teacher both have the intuitive model.
    """
    model = TeacherModel.intuitive()
    teacher = SimulatedTeacher(WORLD, model, task, forced={5: "mistake"})
    robot = Robot(WORLD, model, EntropyPlanner(WORLD, model, horizon=horizon))
    return run_trial(robot, teacher, np.random.default_rng(seed), trial_id=f"mistake-{seed}")


def write_study(folder: Path) -> None:
    """trials.jsonl and teachers.json: the true parameters by participant_id."""
    sessions = study_sessions()
    teachers = {s.participant_id: s.teacher.to_dict() for s in sessions}
    write_trials((session.run() for session in sessions), folder / "trials.jsonl")
    text = json.dumps(teachers, indent=1) + "\n"
    (folder / "teachers.json").write_text(text, encoding="utf-8")


def write_large(folder: Path) -> None:
    """trials.jsonl.gz and teacher.json: the true model."""
    write_trials((session.run() for session in large_sessions()), folder / "trials.jsonl.gz")
    population_teacher().save(folder / "teacher.json")


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the set named first into the folder named second."""
    parser = argparse.ArgumentParser(prog="python -m taskcomm.studies", description="Make a simulated set.")
    parser.add_argument("name", choices=("study", "large"))
    parser.add_argument("folder", type=Path)
    chosen = parser.parse_args(arguments)
    try:
        chosen.folder.mkdir(parents=True, exist_ok=True)
        (write_study if chosen.name == "study" else write_large)(chosen.folder)
    except (LogError, OSError) as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
