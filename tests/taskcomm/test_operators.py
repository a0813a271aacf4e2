"""The scripted operator questions one thing after the other, and sees only presses."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tinyworld import menu

from taskcomm.operators import ScriptedOperator
from taskcomm.robot import Final
from taskcomm.simulate import SimulatedTeacher, run_trial
from taskcomm.tasks import Task
from taskcomm.teacher import TableTop, TeacherModel
from taskcomm.trials import Trial
from taskcomm.world import NOA, Action, BallState, BallWorld

WORLD, MODEL = BallWorld(), TeacherModel.intuitive()


def attentive(mistake: float = 1e-9) -> TeacherModel:
    """A teacher who answers at once, and nearly always."""
    cues = {state: top.cue for state, top in MODEL.approvals.items()}
    return TeacherModel(
        mistake=mistake, approvals={state: TableTop(cue, 0.33, 0.5, 0.5) for state, cue in cues.items()}
    )


def play(operator: ScriptedOperator, press: Callable[[BallState, int], bool], steps: int) -> Iterator[Any]:
    """What the operator does for so many steps, if `press(state, t)` is all it sees."""
    operator.reset(np.random.default_rng(1))
    pressed: bool | None = None
    for t in range(steps):
        action = operator.act(pressed)
        yield action
        if isinstance(action, Final):
            return
        pressed = press(operator.state, t)


@settings(max_examples=40)
@given(st.integers(2, 5), st.integers(1, 5), st.integers(0, 10**6), st.floats(0, 0.5))
def test_every_action_is_valid_in_every_world_whatever_is_pressed(
    num_balls: int, num_distances: int, seed: int, rate: float
) -> None:
    world, rng = BallWorld(num_balls, num_distances), np.random.default_rng(seed)
    operator, state, pressed = ScriptedOperator(world), world.start(), None
    operator.reset(np.random.default_rng(seed))
    for _ in range(400):
        action = operator.act(pressed)
        if isinstance(action, Final):
            assert world.is_goal(state, action.task)
            return
        assert operator.source == ("default" if action == NOA else "operator")
        state = world.step(state, action)
        assert operator.state == state
        pressed = bool(rng.random() < rate)


def trials_with(model: TeacherModel, seeds: range) -> list[Trial]:
    return [
        run_trial(
            ScriptedOperator(WORLD),
            SimulatedTeacher(WORLD, model, WORLD.tasks[seed % len(WORLD.tasks)]),
            np.random.default_rng(seed),
        )
        for seed in seeds
    ]


def test_finds_every_task_of_an_attentive_teacher() -> None:
    trials = trials_with(attentive(), range(72))
    assert np.mean([bool(trial.correct) for trial in trials]) >= 0.95
    assert {trial.condition for trial in trials} == {"operator"}


def test_is_usually_right_within_a_minute_or_so_with_an_ordinary_teacher() -> None:
    ordinary = {state: TableTop(top.cue, 0.18, 1.2, 1.0) for state, top in MODEL.approvals.items()}
    trials = trials_with(TeacherModel(mistake=0.005, approvals=ordinary), range(96))
    assert np.mean([bool(trial.correct) for trial in trials]) >= 0.8
    assert 20 <= np.median([trial.duration for trial in trials]) <= 90


def test_works_with_two_balls_and_one_distance() -> None:
    world = BallWorld(num_balls=2, num_distances=1)
    for seed in range(10):
        teacher = SimulatedTeacher(world, attentive(), world.tasks[seed % 2])
        assert run_trial(ScriptedOperator(world), teacher, np.random.default_rng(seed)).correct


def test_without_approval_it_never_stops_asking_and_never_shows_final() -> None:
    actions = list(play(ScriptedOperator(WORLD), lambda state, t: False, 600))
    assert len(actions) == 600
    for ball in (1, 2, 3):
        assert sum(action == Action("light_on", ball) for action in actions) > 10


def test_goes_stage_by_stage() -> None:
    task = Task(2, 3, 1)

    def press(state: BallState, t: int) -> bool:
        if state.held != task.mov:
            return task.mov in state.lit
        return task.wrt in state.lit or WORLD.is_goal(state, task)

    *actions, final = play(ScriptedOperator(WORLD), press, 600)
    names = [action.name for action in actions if action != NOA]
    first = {name: names.index(name) for name in names}
    assert final == Final(task)
    assert first["light_on"] < first["pick_up"] < first["slide"]
    assert "light_on" in names[first["pick_up"] : first["slide"]]
    assert "release" not in names


def test_goes_back_when_a_ball_leads_nowhere() -> None:
    wrong = Action("pick_up", 1)
    pressed: list[bool] = []

    def press(state: BallState, t: int) -> bool:
        pressed.append(not any(pressed) and 1 in state.lit)
        return pressed[-1]

    actions = list(play(ScriptedOperator(WORLD), press, 400))
    assert wrong in actions
    after = actions[actions.index(wrong) :]
    back = after[after.index(Action("release", 1)) :]
    lights = [action.ball for action in back if action.name == "light_on"]
    assert sorted(lights[:2]) == [2, 3]  # the ball that led nowhere is questioned last
    assert lights[2] == 1


def test_goes_back_when_no_distance_is_approved() -> None:
    def press(state: BallState, t: int) -> bool:
        return bool(state.lit) and all(placed is None for placed in state.placements)

    names = [action.name for action in play(ScriptedOperator(WORLD), press, 500)]
    lights_after_slides = names[names.index("slide") :].count("light_on")
    assert lights_after_slides >= 3
    assert "release" in names


def test_dwell_times_vary_by_seed_and_a_seed_repeats_them() -> None:
    def actions(seed: int) -> tuple[Any, ...]:
        teacher = SimulatedTeacher(WORLD, attentive(), WORLD.tasks[3])
        return run_trial(ScriptedOperator(WORLD), teacher, np.random.default_rng(seed)).actions

    assert actions(1) == actions(1)
    pauses = {len(list(play_until_off(seed))) for seed in range(8)}
    assert len(pauses) > 3


def play_until_off(seed: int) -> Iterator[Any]:
    operator = ScriptedOperator(WORLD)
    operator.reset(np.random.default_rng(seed))
    action = operator.act(None)
    while action.name != "light_off":
        yield action
        action = operator.act(False)


def test_refuses_other_worlds_times_and_turns() -> None:
    with pytest.raises(ValueError, match="plays in a BallWorld only"):
        ScriptedOperator(menu()[0])  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="dwell: must be above 0 s, not 0"):
        ScriptedOperator(WORLD, dwell=0)
    with pytest.raises(ValueError, match="dt: must be above 0 s, not nan"):
        ScriptedOperator(WORLD, dt=float("nan"))
    operator = ScriptedOperator(WORLD)
    with pytest.raises(ValueError, match=r"begins with act\(None\)"):
        operator.act(False)
    operator.act(None)
    with pytest.raises(ValueError, match=r"begins with act\(None\)"):
        operator.act(None)
