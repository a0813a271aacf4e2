"""The levels: those of continuous time, late cues and fractional delays included."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskcomm.belief import Belief
from taskcomm.levels import advance
from taskcomm.teacher import TableTop, TeacherModel
from taskcomm.world import BallWorld

PIECES = 64  # of a step; the delays drawn below are whole numbers of them
DT = 0.5


def in_continuous_time(top: TableTop, cues: list[bool], resets: list[bool]) -> list[tuple[float, float]]:
    """(level, seconds on) at the end of each step, in pieces of dt / 64 of constant late cue.

    A piece either runs straight or clips, and cue changes fall between pieces, so this is exact.
    """
    level, on_time, ends = 0.0, 0.0, []
    late = round(top.delay / DT * PIECES)
    for step, reset in enumerate(resets):
        for piece in range(step * PIECES, (step + 1) * PIECES):
            on = piece >= late and cues[(piece - late) // PIECES]
            slope = 1 / top.rise if on else -1 / top.fall
            level = min(1.0, max(0.0, level + slope * DT / PIECES))
            on_time = on_time + DT / PIECES if on else 0.0
        ends.append((level, on_time))
        if reset:
            level, on_time = 0.0, 0.0
    return ends


@given(
    st.floats(DT, 5.0),
    st.floats(DT, 5.0),
    st.integers(0, 5 * PIECES),
    st.lists(st.tuples(st.booleans(), st.booleans()), min_size=1, max_size=40),
)
def test_levels_are_those_of_continuous_time(
    rise: float, fall: float, late: int, steps: list[tuple[bool, bool]]
) -> None:
    top = TableTop("on", peak=0.1, rise=rise, fall=fall, delay=late / PIECES * DT)
    parameters = TeacherModel(0.005, {"yes": top}, dt=DT).parameters(["on"])
    cues, resets = [cue for cue, _ in steps], [reset for _, reset in steps]
    level, on_time = np.zeros(1), np.zeros(1)
    for step, (expected, seconds) in enumerate(in_continuous_time(top, cues, resets)):
        at = step - int(parameters.steps_late[0])
        newer, older = (np.array([t >= 0 and cues[t]]) for t in (at, at - 1))
        level, on_time = advance(level, on_time, older, newer, parameters)
        assert level[0] == pytest.approx(expected, abs=1e-12)
        assert on_time[0] == pytest.approx(seconds, abs=1e-12)
        if resets[step]:
            level, on_time = np.zeros(1), np.zeros(1)


def test_the_first_step_with_the_cue_on_has_already_risen() -> None:
    parameters = TeacherModel.intuitive().parameters(BallWorld.cue_names)
    on, off = np.ones(3, dtype=np.bool_), np.zeros(3, dtype=np.bool_)
    level, on_time = advance(np.zeros(3), np.zeros(3), off, on, parameters)
    np.testing.assert_array_equal(level, 0.25)
    for _ in range(9):
        level, on_time = advance(level, on_time, on, on, parameters)
    np.testing.assert_array_equal(level, 1.0)
    level, on_time = advance(level, on_time, on, off, parameters)
    np.testing.assert_array_equal(level, 0.75)
    np.testing.assert_array_equal(on_time, 0.0)


def test_a_plateau_decays_after_its_hold_and_a_rest_allows_mistakes_alone() -> None:
    top = TableTop("mov_lit", peak=0.2, rise=1.0, fall=1.0, decay=3.0, hold=2.0)
    model = TeacherModel(0.01, {"that_mov": top}, rest=1.0)
    world = BallWorld()
    state = world.step(world.start(), world.actions(world.start())[1])
    only_ball_1 = [float(task.mov == 1) / 8 for task in world.tasks]
    belief = Belief.initial(world, model, only_ball_1)
    seen = []
    for step in range(10):
        seen.append(belief.press_probability(state) - model.mistake)
        belief = belief.update(state, pressed=step == 9)
    seconds = 0.5 * np.arange(1, 11)
    expected = 0.2 * np.minimum(1, seconds) * np.exp(-np.maximum(0, seconds - 2) / 3)
    np.testing.assert_allclose(seen, expected, rtol=1e-12)
    for _ in range(2):
        assert belief.press_probability(state) == model.mistake
        belief = belief.update(state, pressed=False)
    never_reset = 0.01 / (0.01 + expected[-1])  # the press was a mistake
    lasting = never_reset * 0.2 * math.exp(-(13 * 0.5 - 2) / 3) + (1 - never_reset) * 0.2
    assert belief.press_probability(state) - model.mistake == pytest.approx(lasting, rel=1e-12)
