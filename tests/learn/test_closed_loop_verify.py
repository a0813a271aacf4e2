"""From logged trials to a better robot, at full size: what the learned model is worth in the closed loop."""

import numpy as np
import pytest

from learn import fit
from learn.closed_loop import ClosedLoop, run_closed_loop
from taskcomm.operators import ScriptedOperator
from taskcomm.simulate import SimulatedTeacher, run_trial
from taskcomm.teacher import TableTop, TeacherModel
from taskcomm.trials import Trial
from taskcomm.world import BallWorld

WORLD = BallWorld()
TRUE = TeacherModel(
    mistake=0.01,
    approvals={
        "that_mov": TableTop("mov_lit", peak=0.25, rise=1.0, fall=1.0),
        "that_wrt": TableTop("wrt_lit_while_mov_held", peak=0.20, rise=1.5, fall=1.0),
        "that_dist": TableTop("mov_at_dist", peak=0.15, rise=1.0, fall=1.5),
    },
)


def operator_trial(number: int) -> Trial:
    task = WORLD.tasks[int(np.random.default_rng([number, 1]).integers(len(WORLD.tasks)))]
    rng = np.random.default_rng([number, 2])
    return run_trial(ScriptedOperator(WORLD), SimulatedTeacher(WORLD, TRUE, task), rng, trial_id=f"o{number}")


def told(loop: ClosedLoop) -> str:
    lines = [
        f"{arm}: {loop.mean(arm, 'time')} s, right {loop.mean(arm, 'correct')},"
        f" presses {loop.mean(arm, 'presses')}, timeouts {int(loop.timeout(arm).sum())}"
        for arm in loop.arms
    ]
    lines += [f"time of learned / {arm}: {loop.time_ratio('learned', arm)}" for arm in ("intuitive", "true")]
    lines.append(f"right, learned minus intuitive: {loop.difference('learned', 'intuitive', 'correct')}")
    return "\n".join(lines)


@pytest.mark.verify
def test_a_robot_with_the_learned_model_is_sooner_and_more_often_right() -> None:
    trials = [operator_trial(number) for number in range(200)]
    result = fit(trials, world=WORLD, initial=TeacherModel.intuitive())
    arms = {"intuitive": TeacherModel.intuitive(), "learned": result.model, "true": TRUE}
    loop = run_closed_loop(WORLD, arms, TRUE, 400, horizon=3, seed=0, jobs=2)
    print(f"\n{told(loop)}")
    assert result.converged
    # The whole 95% intervals lie where they should, not the estimates alone.
    assert loop.difference("learned", "intuitive", "correct").low > 0
    assert loop.time_ratio("learned", "intuitive").high <= 0.85
    assert loop.time_ratio("learned", "true").high <= 1.10
