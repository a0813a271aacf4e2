"""The decision that other packages can express too: a task to be found out, without timing.

With rise and fall of one step, a level is 1 where its cue is on and 0 where not, whatever came before: a
press has a probability for each world and task, and nothing else is remembered.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.planner.situations import SEED, Situation, along

from taskcomm.planner import EntropyPlanner
from taskcomm.robot import Robot
from taskcomm.simulate import SimulatedTeacher, run_trial
from taskcomm.teacher import TeacherModel
from taskcomm.world import BallWorld

WORLD = BallWorld()


def static_model() -> TeacherModel:
    """The intuitive model without timing."""
    model = TeacherModel.intuitive()
    tops = {state: replace(top, rise=model.dt, fall=model.dt) for state, top in model.approvals.items()}
    return replace(model, approvals=tops)


def situations(count: int) -> list[Situation]:
    """The first decision of a trial, and others drawn from a trial."""
    model, rng = static_model(), np.random.default_rng(SEED)
    robot = Robot(WORLD, model, EntropyPlanner(WORLD, model, horizon=2))
    trial = run_trial(robot, SimulatedTeacher(WORLD, model, WORLD.tasks[9]), rng)
    found = along([trial], WORLD, model)
    drawn = np.sort(rng.choice(np.arange(1, len(found)), count - 1, replace=False))
    return [found[0], *(found[index] for index in drawn)]


def write(path: Path, found: list[Situation], horizon: int) -> None:
    """The worlds within `horizon` steps of all situations as arrays: see the peers for their use.

    successor[w, a] is where action a (canonical order) leads to, w itself where there are fewer;
    press[w, task] the probability of a press; node and belief the situations.
    """
    index: dict[Any, int] = {}
    states: list[Any] = []

    def number(state: Any) -> int:
        if state not in index:
            index[state] = len(states)
            states.append(state)
        return index[state]

    layer = list(dict.fromkeys(number(situation.state) for situation in found))
    after: dict[int, list[int]] = {}
    for _ in range(horizon):
        for at in layer:
            if at not in after:
                here = states[at]
                after[at] = [number(WORLD.step(here, action)) for action in WORLD.actions(here)]
        layer = list(dict.fromkeys(reached for at in layer for reached in after[at]))
    successor = np.tile(np.arange(len(states))[:, None], max(map(len, after.values())))
    for at, reached in after.items():
        successor[at, : len(reached)] = reached
    model = static_model()
    p = model.parameters(WORLD.cue_names)
    press = np.array([p.mistake + p.peak @ WORLD.cues(state)[p.cue] for state in states])
    np.savez(
        path,
        successor=successor,
        count=np.array([len(after.get(at, [])) for at in range(len(states))]),
        press=press,
        node=np.array([index[situation.state] for situation in found]),
        belief=np.array([situation.belief.marginal() for situation in found]),
        horizon=np.array(horizon),
    )
