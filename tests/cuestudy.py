"""Simulated cue tables: cues that come on and go off by themselves, and a teacher who presses."""

from dataclasses import replace
from functools import cache

import numpy as np

from taskcomm.cueworld import CueWorld
from taskcomm.simulate import SimulatedTeacher
from taskcomm.teacher import TableTop, TeacherModel
from taskcomm.trials import Step, Trial

WORLD = CueWorld(("light", "tone"))
TRUE = TeacherModel(
    0.01,
    {
        "that_light": TableTop("light", peak=0.25, rise=1.5, fall=1.0),
        "that_tone": TableTop("tone", peak=0.15, rise=1.0, fall=2.0),
    },
)


def slower(model: TeacherModel, factor: float) -> TeacherModel:
    """The same teacher with every time, the step's too, `factor` times as long."""
    tops = {
        state: replace(top, **{name: getattr(top, name) * factor for name in ("rise", "fall", "delay")})
        for state, top in model.approvals.items()
    }
    return TeacherModel(model.mistake, tops, dt=model.dt * factor)


@cache
def cue_trials(count: int = 10, steps: int = 60, people: int = 6, seed: int = 0) -> tuple[Trial, ...]:
    """Trials of TRUE in which each cue changes now and then."""
    trials = []
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        teacher = SimulatedTeacher(WORLD, TRUE, WORLD.tasks[0])
        on, taken = frozenset[str](), []
        for _ in range(steps):
            on = on ^ {name for name in WORLD.cue_names if rng.random() < 0.1}
            pressed = teacher.observe(on, rng)
            taken.append(Step(WORLD.show(on), pressed, "operator", teacher.mental_state))
        trials.append(
            Trial(f"t{number}", WORLD, WORLD.tasks[0], tuple(taken), participant_id=f"p{number % people}")
        )
    return tuple(trials)
