"""Courses: what memories share is what each of them would have by itself."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from taskcomm import courses
from taskcomm.courses import courses_of
from taskcomm.lattice import Bools, Extent, Lattice, build_unit, join
from taskcomm.levels import advance, approval_probability
from taskcomm.smoother import Chain
from taskcomm.teacher import Parameters, TableTop, TeacherModel

CUES = ("a", "b")
FLAGS = st.lists(st.lists(st.booleans(), min_size=3, max_size=3), min_size=1, max_size=14)
PLAIN = {"a": TableTop("a", 0.2, 1.0, 1.5), "b": TableTop("b", 0.1, 2.0, 0.5)}
MODELS = (
    TeacherModel(mistake=0.02, approvals=PLAIN),
    TeacherModel(mistake=0.02, approvals=PLAIN | {"a": TableTop("a", 0.2, 1.0, 1.5, delay=0.7)}),
    TeacherModel(mistake=0.02, rest=1.0, approvals=PLAIN),
    TeacherModel(mistake=0.02, approvals=PLAIN | {"a": TableTop("a", 0.2, 1.0, 1.5, decay=3.0, hold=0.5)}),
)


def lattice_of(shown: list[Any], parameters: Parameters) -> Lattice:
    tables = [np.array(rows, dtype=np.bool_) for rows in shown]
    extent = Extent.of(parameters)
    return join([build_unit(table[:, :2], table[:, 2], extent, parameters.dt) for table in tables])


def shares_alone(cues: Bools, presses: Bools, m: int, first: int, last: int, p: Parameters) -> list[float]:
    """P(M = m) / peak in steps `first` to `last`, level 0 before, step by step by the plain recursion."""
    level, on_time, found = np.zeros(2), np.zeros(2), []
    for t in range(first, last):
        late = t - p.steps_late[m]
        newer, older = (np.array([c >= 0 and cues[c, k] for k in range(2)]) for c in (late, late - 1))
        level, on_time = advance(level, on_time, older, newer, p)
        resting = any(presses[max(0, t - p.rest_steps) : t])
        found.append(float(approval_probability(level, on_time, resting, p)[m] / p.peak[m]))
    return found


@pytest.mark.parametrize("model", MODELS)
@given(shown=st.lists(FLAGS, min_size=1, max_size=4))
@settings(max_examples=25, deadline=None)
def test_every_memory_finds_the_levels_since_its_own_resets(model: TeacherModel, shown: list[Any]) -> None:
    p = model.parameters(CUES)
    lattice = lattice_of(shown, p)
    chain = Chain(lattice)
    chain.trace(p)
    for u, rows in enumerate(shown):
        table = np.array(rows, dtype=np.bool_)
        for layer in range(*lattice.unit_layers[u : u + 2]):
            end = min(int(lattice.layer_press[layer]) + 1, len(table))
            steps = np.arange(lattice.layer_first[layer], end)
            for s in range(*lattice.layer_memories[layer : layer + 2]):
                cells = chain.courses.memory_cell[s] + steps
                for m in range(2):
                    first = int(lattice.track_first[lattice.memory_track[s, m]])
                    alone = shares_alone(table[:, :2], table[:, 2], m, first, end, p)
                    found = chain.share[chain.courses.cell_level[cells, m]]
                    np.testing.assert_allclose(found, alone[end - first - len(steps) :], atol=1e-12)
                waiting = 1 - p.mistake - chain.share[chain.courses.cell_level[cells]] @ p.peak
                np.testing.assert_allclose(chain.waiting[cells], waiting, atol=1e-12)


@given(shown=st.lists(FLAGS, min_size=2, max_size=6))
@settings(max_examples=25, deadline=None)
def test_ranges_of_units_share_nothing_and_change_nothing(shown: list[Any]) -> None:
    p = MODELS[0].parameters(CUES)
    lattice = lattice_of(shown, p)
    together = Chain(lattice)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(courses, "WORTHWHILE", 20)
        apart = Chain(lattice)
    assert len(together.ranges) == 1
    np.testing.assert_allclose(apart.run(p), together.run(p), rtol=1e-13, atol=0)
    for chain in (together, apart):
        chain.smooth(np.ones(len(shown)))
    np.testing.assert_allclose(apart.press, together.press, atol=1e-13)
    assert [first for first, _ in apart.ranges] == [0, *(last for _, last in apart.ranges[:-1])]
    assert apart.ranges[-1][1] == len(shown)


def test_trials_that_show_the_same_have_their_levels_once() -> None:
    rows = [[True, False, t % 7 == 6] for t in range(40)]
    p = MODELS[0].parameters(CUES)
    one, many = (courses_of(lattice_of([rows] * count, p))[0] for count in (1, 50))
    assert many.line_at[-1] == one.line_at[-1]
    assert len(many.cell_level) == len(one.cell_level)
    assert len(many.memory_cell) == 50 * len(one.memory_cell)


def test_a_long_stretch_without_presses_is_no_underflow() -> None:
    quiet = TeacherModel(0.4, {"a": TableTop("a", 0.5, 1.0, 1.5), "b": TableTop("b", 0.05, 2.0, 0.5)})
    p = quiet.parameters(CUES)
    rows = [[True, False, t == 1500] for t in range(3000)]
    found = float(Chain(lattice_of([rows], p)).run(p)[0])
    # level 1 from the second step on, but for two steps after a reset at the press
    steady, rising = np.log(1 - 0.4 - 0.5), np.log(1 - 0.4 - 0.25)
    mistaken = np.log(0.4) + 1499 * steady
    approved = np.log(0.5) + rising + 1498 * steady
    assert found == pytest.approx(rising + 1499 * steady + np.logaddexp(mistaken, approved), rel=1e-12)
