"""Simulated trials with signals: a gaze, a face, a pupil, and a key that may miss."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from taught import WORLD, teacher

from learn.coordinates import Bounds
from taskcomm.channels import NormalChannel, ObservationModel, PlainChannel, TargetChannel
from taskcomm.operators import ScriptedOperator
from taskcomm.simulate import SimulatedTeacher, run_trial
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial

TRUTH = teacher()
STATES = TRUTH.mental_states
LOOK = {
    "waiting": (0.3, 0.2, 0.3, 0.2),
    "mistake": (0.2, 0.2, 0.4, 0.2),
    "that_mov": (0.8, 0.1, 0.05, 0.05),
    "that_wrt": (0.15, 0.75, 0.05, 0.05),
    "that_dist": (0.45, 0.45, 0.05, 0.05),
}
ROLES = ("mov", "wrt", "other", "none")
GAZE = TargetChannel({state: dict(zip(ROLES, row, strict=True)) for state, row in LOOK.items()})
FACE = PlainChannel(
    {s: {"smile": p, "plain": 1 - p} for s, p in zip(STATES, (0.1, 0.3, 0.6, 0.7, 0.9), strict=True)}
)
PUPIL = NormalChannel({s: float(k) for k, s in enumerate(STATES)}, dict.fromkeys(STATES, 0.5))
SHORT = Bounds(rise=3.0, fall=3.0)


def seeing(**parts: Any) -> TeacherModel:
    return replace(TRUTH, observation=ObservationModel(**parts))


@cache
def watched(count: int, miss: float = 0.0, seed: int = 0) -> tuple[Trial, ...]:
    model = seeing(miss=miss, channels={"gaze": GAZE, "face": FACE, "pupil": PUPIL})
    trials = []
    for number, rng in enumerate(np.random.default_rng(seed).spawn(count)):
        task = WORLD.tasks[int(rng.integers(len(WORLD.tasks)))]
        operator, simulated = ScriptedOperator(WORLD), SimulatedTeacher(WORLD, model, task)
        trials.append(run_trial(operator, simulated, rng, trial_id=f"t{number}"))
    return tuple(trials)
