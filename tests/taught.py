"""Simulated operator trials, and small trials by hand, for the tests of learning."""

from collections.abc import Sequence
from functools import cache

import numpy as np

from taskcomm.operators import ScriptedOperator
from taskcomm.simulate import SimulatedTeacher, run_trial
from taskcomm.teacher import TableTop, TeacherModel
from taskcomm.trials import Step, Trial
from taskcomm.world import Action, BallWorld

WORLD = BallWorld()
CUES = {"that_mov": "mov_lit", "that_wrt": "wrt_lit_while_mov_held", "that_dist": "mov_at_dist"}


def teacher(
    peaks: Sequence[float] = (0.25, 0.20, 0.15),
    rises: Sequence[float] = (1.0, 1.5, 1.0),
    falls: Sequence[float] = (1.0, 1.0, 1.5),
    delays: Sequence[float] = (0.0, 0.0, 0.0),
    mistake: float = 0.01,
) -> TeacherModel:
    """By default the teacher of the project's closed-loop study."""
    values = zip(CUES.items(), peaks, rises, falls, delays, strict=True)
    tops = {state: TableTop(cue, peak, rise, fall, delay) for (state, cue), peak, rise, fall, delay in values}
    return TeacherModel(mistake=mistake, approvals=tops)


@cache
def operator_trials(count: int, model: TeacherModel, seed: int = 0) -> tuple[Trial, ...]:
    """Trials of the scripted operator with tasks drawn anew for each."""
    trials = []
    for number, rng in enumerate(np.random.default_rng(seed).spawn(count)):
        task = WORLD.tasks[int(rng.integers(len(WORLD.tasks)))]
        trials.append(
            run_trial(
                ScriptedOperator(WORLD), SimulatedTeacher(WORLD, model, task), rng, trial_id=f"t{number}"
            )
        )
    return tuple(trials)


def by_hand(actions: Sequence[str], presses: Sequence[int], task: int = 0, trial_id: str = "hand") -> Trial:
    """A trial in the default world: one action a step, presses by step."""
    steps = tuple(Step(Action.parse(action), number in presses) for number, action in enumerate(actions))
    return Trial(trial_id, WORLD, WORLD.tasks[task], steps)
