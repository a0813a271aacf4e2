"""What a gaze is worth: simulated teachers who look, met by robots that see it and robots that do not."""

import numpy as np
import pytest
from signalled import gazing

from taskcomm.levels import Floats
from taskcomm.planner import EntropyPlanner
from taskcomm.robot import Robot
from taskcomm.simulate import SimulatedTeacher, run_trial
from taskcomm.teacher import TeacherModel
from taskcomm.world import BallWorld

WORLD, TEACHER = BallWorld(3, 1), gazing()


def _trials(robot: Robot, number: int) -> tuple[Floats, float]:
    """Lengths in steps, and the share of right ends; teacher n has the same luck whoever is taught."""
    lengths, right = [], 0
    for n in range(number):
        teacher = SimulatedTeacher(WORLD, TEACHER, WORLD.tasks[n % len(WORLD.tasks)])
        trial = run_trial(robot, teacher, np.random.default_rng([7, n]), max_steps=300)
        lengths.append(trial.num_steps)
        right += bool(trial.correct)
    return np.array(lengths, dtype=np.float64), right / number


def _compare(seeing: EntropyPlanner, number: int) -> None:
    """A robot that sees the gaze ends sooner: the mean paired difference is two standard errors from 0."""
    deaf = TeacherModel.intuitive()
    without, _ = _trials(Robot(WORLD, deaf, EntropyPlanner(WORLD, deaf, 3)), number)
    with_gaze, right = _trials(Robot(WORLD, TEACHER, seeing), number)
    sooner = without - with_gaze
    assert sooner.mean() > 2 * sooner.std(ddof=1) / np.sqrt(number)
    assert right > 0.9


def test_a_robot_that_sees_where_the_teacher_looks_knows_the_task_in_fewer_steps() -> None:
    """Both plan over the key alone, equally far; only the belief of one knows the looks."""
    _compare(EntropyPlanner(WORLD, TEACHER, 3, signals=False), 40)


@pytest.mark.verify
def test_so_does_one_that_plans_over_the_looks_too() -> None:
    _compare(EntropyPlanner(WORLD, TEACHER, 3), 40)
