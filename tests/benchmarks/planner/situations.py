"""The decisions that the planner's benchmark times: where a robot had to plan, along logged trials."""

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taskcomm.belief import Belief
from taskcomm.logs import read_trials
from taskcomm.planner import EntropyPlanner
from taskcomm.robot import Robot
from taskcomm.simulate import SimulatedTeacher, run_trial
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial
from taskcomm.world import BallWorld

STUDY = Path(__file__).parents[3] / "datasets" / "simulated-study"
THRESHOLD = 0.98
SEED = 2012


@dataclass(frozen=True)
class Situation:
    """What the planner is asked: a belief and a world state; `before` are those of one step earlier."""

    belief: Belief
    state: Any
    before: tuple[Belief, Any]


@dataclass(frozen=True)
class Situations:
    """Decisions under one model in one world, in the order in which they came up."""

    name: str
    world: BallWorld
    model: TeacherModel
    found: tuple[Situation, ...]


def along(trials: Iterable[Trial], world: BallWorld, model: TeacherModel) -> tuple[Situation, ...]:
    """The steps at which a robot with this model does not yet know the task, and so has to plan."""
    found = []
    for trial in trials:
        belief = Belief.initial(world, model)
        state: Any = world.start()
        before = belief, state
        for step, reached in zip(trial.steps, trial.states, strict=True):
            if belief.marginal().max() <= THRESHOLD:
                found.append(Situation(belief, state, before))
            before, belief, state = (belief, state), belief.update(reached, step.pressed), reached
    return tuple(found)


def study() -> Situations:
    """All 44 trials of the simulated study, robot's and operator's, under the intuitive model."""
    world, model = BallWorld(), TeacherModel.intuitive()
    return Situations("study", world, model, along(read_trials(STUDY / "trials.jsonl"), world, model))


def learned() -> Situations:
    """A trial with each teacher of the study, the robot having the model fitted to the study's trials."""
    from learn import fit

    world = BallWorld()
    model = fit(read_trials(STUDY / "trials.jsonl"), world=world).model
    robot = Robot(world, model, EntropyPlanner(world, model, horizon=5))
    teachers = json.loads((STUDY / "teachers.json").read_text(encoding="utf-8"))
    trials = []
    for rng, teacher in zip(np.random.default_rng(SEED).spawn(len(teachers)), teachers.values(), strict=True):
        task = world.tasks[int(rng.integers(len(world.tasks)))]
        hers = TeacherModel.from_json(json.dumps(teacher))
        trials.append(run_trial(robot, SimulatedTeacher(world, hers, task), rng))
    return Situations("learned", world, model, along(trials, world, model))


def of_balls(num_balls: int, max_steps: int = 150) -> Situations:
    """Two trials with more balls, as far as `max_steps`; intuitive model, robot looking two steps ahead."""
    world, model = BallWorld(num_balls), TeacherModel.intuitive()
    robot = Robot(world, model, EntropyPlanner(world, model, horizon=2))
    trials = []
    for rng in np.random.default_rng([SEED, num_balls]).spawn(2):
        task = world.tasks[int(rng.integers(len(world.tasks)))]
        trials.append(run_trial(robot, SimulatedTeacher(world, model, task), rng, max_steps=max_steps))
    return Situations("balls", world, model, along(trials, world, model))
