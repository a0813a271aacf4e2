"""A small study in the world without balls, and its comparison, made once for all tests that look at it."""

from dataclasses import replace
from functools import cache

import numpy as np
from tinyworld import menu

from learn import Comparison, compare_models, fit
from taskcomm.planner import EntropyPlanner
from taskcomm.robot import Robot
from taskcomm.simulate import SimulatedTeacher, run_trial
from taskcomm.teacher import TableTop
from taskcomm.trials import Trial

WORLD, TRUE = menu()
(APPROVES,) = TRUE.approvals
START = replace(TRUE, mistake=0.005, approvals={APPROVES: TableTop("pointed_at", 0.1, 2.0, 2.0)})
FAST = {"starts": 1, "initial": START}


@cache
def study() -> tuple[Trial, ...]:
    robot = Robot(WORLD, START, EntropyPlanner(WORLD, START, horizon=2), threshold=0.999)
    return tuple(
        run_trial(
            robot,
            SimulatedTeacher(WORLD, TRUE, WORLD.tasks[n % 4]),
            np.random.default_rng([n, 7]),
            max_steps=120,
            trial_id=f"t{n}",
            participant_id=f"p{n % 7}",
        )
        for n in range(14)
    )


@cache
def comparison() -> Comparison:
    seen = fit(study()[:4], world=WORLD, initial=START, starts=1).model
    return compare_models(
        study(),
        {"intuitive": START, "seen": seen},
        folds=3,
        decisions=25,
        loop_trials=6,
        horizon=2,
        jobs=1,
        fit_options=FAST,
    )
