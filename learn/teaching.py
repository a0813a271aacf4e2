"""Simulated teachers with a known model, trial by trial: what a study of recovery is made of."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from learn.remembering import Remembering
from taskcomm.operators import ScriptedOperator
from taskcomm.planner import EntropyPlanner
from taskcomm.robot import Controller, Robot
from taskcomm.simulate import SimulatedTeacher, run_trial
from taskcomm.teacher import TableTop, TeacherModel
from taskcomm.trials import Trial
from taskcomm.world import World

PEAKS = 0.3  # what the peaks of an intuitive model sum to where there are more than three of them


@dataclass
class Teaching:
    """Trials with simulated teachers who all have the model `truth`.

    The task of a trial and its teacher's luck follow from `seed`, `stream` and the trial's index alone,
    whoever moves the robot: the scripted operator, or a planner of this `horizon` with some model, that
    shows Final above `threshold`. Robots are made on first use, so that each process has its own; only the
    last is kept. Raises ValueError for an operator in a World that is no BallWorld.
    """

    world: World
    truth: TeacherModel
    seed: int
    stream: int = 0
    horizon: int = 3
    threshold: float = 0.98
    max_steps: int = 600
    _robot: tuple[TeacherModel, Robot] | None = field(default=None, repr=False)
    _operator: Controller | None = field(default=None, repr=False)

    def by_operator(self, index: int) -> Trial:
        """Trial `index`, the robot moved by the scripted operator."""
        if self._operator is None:
            self._operator = ScriptedOperator(self.world, self.truth.dt)  # type: ignore[arg-type]
        return self._run(self._operator, "operator", index)

    def by_planner(self, index: int, model: TeacherModel) -> Trial:
        """Trial `index`, with a planner that takes the teacher for `model`."""
        if self._robot is None or self._robot[0] != model:
            planner = Remembering(EntropyPlanner(self.world, model, horizon=self.horizon))
            self._robot = model, Robot(self.world, model, planner, self.threshold)
        return self._run(self._robot[1], "planner", index)

    def _run(self, controller: Controller, name: str, index: int) -> Trial:
        tasks = self.world.tasks
        task = tasks[int(np.random.default_rng([self.seed, self.stream, index, 1]).integers(len(tasks)))]
        return run_trial(
            controller,
            SimulatedTeacher(self.world, self.truth, task),
            np.random.default_rng([self.seed, self.stream, index, 2]),
            max_steps=self.max_steps,
            trial_id=f"{name}-{self.seed}-{self.stream}-{index}",
        )


def intuitive_for(truth: TeacherModel) -> TeacherModel:
    """The numbers of the intuitive model in the structure of `truth`: its cues, its rest, its time step.

    It is where fits start, and what they are held against. With more than three approval states the
    peaks are smaller, so that they sum to PEAKS; there is no delay and no decay.

    >>> intuitive_for(TeacherModel.intuitive()) == TeacherModel.intuitive()
    True
    """
    plain = TeacherModel.intuitive()
    some = next(iter(plain.approvals.values()))
    states = len(truth.approvals)
    peak = some.peak if states <= 3 else PEAKS / states
    tops = {state: TableTop(top.cue, peak, some.rise, some.fall) for state, top in truth.approvals.items()}
    model = replace(plain, approvals=tops, rest=truth.rest)
    return model if truth.dt == model.dt else model.with_dt(truth.dt)


def _made(mistake: float, tops: Mapping[str, tuple[float, float, float]], name: str) -> TeacherModel:
    cues = {state: top.cue for state, top in TeacherModel.intuitive().approvals.items()}
    approvals = {state: TableTop(cues[state], *values) for state, values in tops.items()}
    return TeacherModel(mistake, approvals, provenance={"name": name})


TRUTHS = {
    # presses sooner and more surely than the intuitive model; the teacher of datasets/simulated-large
    "prompt": _made(
        0.01,
        {"that_mov": (0.25, 1.0, 1.0), "that_wrt": (0.20, 1.5, 1.0), "that_dist": (0.15, 1.0, 1.5)},
        "prompt",
    ),
    # takes time, and errs more often
    "hesitant": _made(
        0.015,
        {"that_mov": (0.10, 3.0, 1.5), "that_wrt": (0.07, 4.0, 1.5), "that_dist": (0.08, 3.0, 2.0)},
        "hesitant",
    ),
    # what the intuitive model says: learning has nothing to win
    "intuitive": TeacherModel.intuitive(),
}
"""Teachers to recover, by name."""
