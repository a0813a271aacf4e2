"""The paper's mistake: a press on the wrong ball at 3 s is seen through, and the robot ends right."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from taskcomm.belief import Belief
from taskcomm.smoother import smooth
from taskcomm.studies import mistake_trial
from taskcomm.tasks import Task
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial
from taskcomm.world import Action

MODEL, PRESS = TeacherModel.intuitive(), 5
CASES = [(seed, task) for seed in (0, 2, 4) for task in (Task(3, 2, 2), Task(2, 3, 1), Task(3, 2, 4))]


@pytest.fixture(scope="module", params=CASES, ids=str)
def trial(request: pytest.FixtureRequest) -> Trial:
    return mistake_trial(*request.param)


def so_far(trial: Trial, steps: int) -> Trial:
    """What the robot has seen: not the card."""
    return replace(trial, steps=trial.steps[:steps], task=None, reason=None, displayed=None)


def mistaken(trial: Trial, steps: int) -> float:
    smoothed = smooth(so_far(trial, steps), MODEL)
    return smoothed.of_press(list(smoothed.steps).index(PRESS))["mistake"]


def test_the_press_comes_at_3_s_while_ball_1_is_lit_and_moves_the_belief_there(trial: Trial) -> None:
    assert trial.reasons[PRESS] == "mistake"
    assert (PRESS + 1) * trial.dt == 3.0
    state: Any = trial.states[PRESS]
    assert state.lit == {1}
    belief, over_time = Belief.initial(trial.world, MODEL), []
    for at, pressed in zip(trial.states[: PRESS + 1], trial.presses, strict=False):
        belief = belief.update(at, bool(pressed))
        over_time.append(belief.marginal_of("mov")[1])
    assert over_time[PRESS] > 2 * over_time[PRESS - 1]


def test_its_smoothed_probability_of_mistake_rises_over_the_trial(trial: Trial) -> None:
    length = trial.num_steps
    at_once, *later = (mistaken(trial, n) for n in np.linspace(PRESS + 1, length, 5).astype(int))
    assert at_once < 0.2
    assert later[-1] > 0.9
    assert later[-1] > max(at_once, later[0])


def test_with_the_card_known_it_is_a_mistake_at_once(trial: Trial) -> None:
    smoothed = smooth(replace(trial, steps=trial.steps[: PRESS + 1], reason=None), MODEL)
    assert smoothed.of_press(list(smoothed.steps).index(PRESS))["mistake"] == pytest.approx(1, abs=1e-12)


def test_the_robot_puts_the_ball_down_again_and_is_right_in_the_end(trial: Trial) -> None:
    picked = [t for t, action in enumerate(trial.actions) if action == Action("pick_up", 1)]
    released = [t for t, action in enumerate(trial.actions) if action == Action("release", 1)]
    assert picked
    assert released
    assert max(released) > max(PRESS, *picked)
    assert trial.correct
