"""`taskcomm simulate`: trials with simulated teachers, into a log."""

import hashlib
import json as json_module
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import typer

from taskcomm.branching import default_horizon
from taskcomm.commands.models import check_model, load_model, model_files, say_marks
from taskcomm.commands.output import result_file, run_record, write_record
from taskcomm.commands.terminal import Terminal
from taskcomm.logs import write_trials
from taskcomm.parallel import map_in_order
from taskcomm.robot import Controller, Robot
from taskcomm.simulate import SimulatedTeacher, run_trial
from taskcomm.teacher import ModelError, TeacherModel
from taskcomm.trials import Trial
from taskcomm.world import BallWorld

LOGS = (".jsonl", ".jsonl.gz")


@dataclass
class Simulation:
    """Trial n of a simulated study: its task, its draws and its person follow from the seed and n.

    `robot` is a model for the planner, or None for the scripted operator. There are `people` people,
    taking turns, or a new one in every trial where that is None. A person is named by the seed and the
    teacher model, and so is the same one in whatever way it is taught; a trial is named by the seed,
    the condition, a hash of all that shapes it, and the person.
    """

    world: BallWorld
    teacher: TeacherModel
    robot: TeacherModel | None
    people: int | None
    horizon: int
    threshold: float
    max_steps: int
    seed: int
    made: list[Controller] = field(default_factory=list)

    def _controller(self) -> Controller:
        if not self.made:
            self.made.append(self._make())
        return self.made[0]

    def _make(self) -> Controller:
        if self.robot is None:
            from taskcomm.operators import ScriptedOperator

            return ScriptedOperator(self.world, self.teacher.dt)
        from taskcomm.planner import EntropyPlanner

        planner = EntropyPlanner(self.world, self.robot, horizon=self.horizon)
        return Robot(self.world, self.robot, planner=planner, threshold=self.threshold)

    def warm_up(self) -> None:
        """Compile the search here, once, and not in every process; the operator needs none."""
        if self.robot is not None:
            from taskcomm.planner import EntropyPlanner

            EntropyPlanner(self.world, self.robot).warm_up()

    def _shape(self) -> str:
        """The condition, and a hash of the settings that trials of one seed may differ in."""
        settings: list[Any] = [self.world.num_balls, self.world.num_distances, self.teacher.sha256]
        settings += [self.people, self.max_steps]
        if self.robot is None:
            return f"operator-{_hash_of(settings)}"
        return f"pomdp-{_hash_of([*settings, self.robot.sha256, self.horizon, self.threshold])}"

    def __call__(self, index: int) -> Trial:
        tasks = self.world.tasks
        task = tasks[int(np.random.default_rng([self.seed, index, 1]).integers(len(tasks)))]
        visit, person = (0, index) if self.people is None else divmod(index, self.people)
        return run_trial(
            self._controller(),
            SimulatedTeacher(self.world, self.teacher, task),
            np.random.default_rng([self.seed, index, 2]),
            max_steps=self.max_steps,
            trial_id=f"s{self.seed}-{self._shape()}-p{person:03d}-{visit}",
            participant_id=f"s{self.seed}-{self.teacher.sha256[:4]}-p{person:03d}",
            trial_index=visit,
        )


def _hash_of(settings: list[Any]) -> str:
    return hashlib.sha256(json_module.dumps(settings).encode()).hexdigest()[:6]


def run(
    out: Path,
    trials: int,
    teacher: str,
    robot: str,
    people: int | None,
    horizon: int | None,
    threshold: float,
    max_steps: int,
    balls: int,
    distances: int,
    seed: int,
    jobs: int,
    json: bool,
) -> int:
    """Simulate, write the log and its record, print a summary."""
    settings: dict[str, Any] = {key: value for key, value in locals().items() if key not in ("json", "jobs")}
    terminal = Terminal(json)
    if not out.name.endswith(LOGS):
        raise typer.BadParameter(f"{out.name}: must end in {' or '.join(LOGS)}", param_hint="--out")
    world = BallWorld(balls, distances)
    model = load_model(teacher, "--teacher")
    robot_model = None if robot == "operator" else load_model(robot, "--robot")
    if robot_model is not None and robot_model.dt != model.dt:
        raise ModelError(f"dt: {model.dt:g} s in the teacher's model, {robot_model.dt:g} s in the robot's")
    check_model(model, teacher, world, {model.dt})
    if robot_model is not None:
        check_model(robot_model, robot, world, {robot_model.dt})
        say_marks(robot_model, robot, terminal)
    horizon = default_horizon(robot_model or model) if horizon is None else horizon
    settings["horizon"] = horizon
    simulation = Simulation(world, model, robot_model, people, horizon, threshold, max_steps, seed)
    record = run_record("simulate", settings, model_files([teacher, robot]))
    record["models"] = {"teacher": model.sha256} | ({"robot": robot_model.sha256} if robot_model else {})
    with result_file(out) as part, terminal.progress("simulating", trials) as progress:
        if jobs > 1:
            simulation.warm_up()
        simulated = map_in_order(simulation, range(trials), jobs, progress)
        write_trials(simulated, part)
    write_record(record, out)
    summary = _summary(simulated)
    terminal.document({"command": "simulate", "out": str(out), **summary})
    terminal.line(
        f"{out}: {trials} simulated trials, {summary['correct']} right, {summary['timeouts']} timeouts,"
        f" {summary['mean_time_s']:.1f} s and {summary['mean_presses']:.1f} presses on average"
    )
    return 0


def _summary(trials: list[Trial]) -> dict[str, Any]:
    return {
        "trials": len(trials),
        "correct": sum(bool(trial.correct) for trial in trials),
        "timeouts": sum(trial.reason == "timeout" for trial in trials),
        "mean_time_s": float(np.mean([trial.duration for trial in trials])),
        "mean_presses": float(np.mean([trial.presses.sum() for trial in trials])),
    }
