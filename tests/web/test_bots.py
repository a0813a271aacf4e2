import asyncio
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from web.fakeserver import WORLD, OperatorSide, TeacherSide, served

from taskcomm.tasks import Task
from taskcomm.teacher import TeacherModel
from taskcomm.web.bots import Line, LineError, OperatorBot, TeacherBot
from taskcomm.web.bots.answers import answers
from taskcomm.web.bots.latency import latency
from taskcomm.web.bots.lessons import FrameError, Lesson
from taskcomm.web.bots.mirror import state_of
from taskcomm.web.frames import frame
from taskcomm.world import Action, BallState

MODEL = TeacherModel.intuitive()
CARD = Task(1, 2, 4)


def walk(seed: int, steps: int) -> list[tuple[Action, BallState]]:
    """A random walk through the world of frames."""
    rng, state, way = np.random.default_rng(seed), WORLD.start(), []
    for _ in range(steps):
        valid = WORLD.actions(state)
        action = valid[int(rng.integers(len(valid)))]
        state = WORLD.step(state, action)
        way.append((action, state))
    return way


@given(st.integers(0, 10**6))
def test_frames_show_the_world_state_whole(seed: int) -> None:
    before = WORLD.start()
    for t, (action, state) in enumerate(walk(seed, 40)):
        assert state_of(frame(WORLD, state, t, action), before) == state
        before = state


def test_a_frame_that_is_not_what_its_action_does_is_refused() -> None:
    lesson = Lesson(0, CARD, MODEL, [1])
    other = WORLD.step(WORLD.start(), Action("pick_up", 2))
    with pytest.raises(FrameError, match="step 0: after"):
        lesson.see(frame(WORLD, other, 0, Action("light_on", 2)))


@given(st.integers(0, 10**6), st.lists(st.integers(0, 29), max_size=4))
def test_steps_shown_again_are_lived_again_with_the_same_luck(seed: int, again: list[int]) -> None:
    way = [frame(WORLD, state, t, action) for t, (action, state) in enumerate(walk(seed, 30))]
    straight, broken = Lesson(0, CARD, MODEL, [seed]), Lesson(0, CARD, MODEL, [seed])
    for shown in way:
        straight.see(shown)
        broken.see(shown)
        if shown.t in again:
            broken.see(shown)
    for back in again:
        for shown in way[back:]:
            broken.see(shown)
    assert [(m.pressed, m.mental_state) for m in broken.moments] == [
        (m.pressed, m.mental_state) for m in straight.moments
    ]


def test_presses_follow_the_teacher_model() -> None:
    """In the limit of a table-top, the share of presses is peak + mistake."""
    lit = WORLD.step(WORLD.start(), Action("light_on", 1))
    lessons = [Lesson(0, CARD, MODEL, [seed]) for seed in range(3000)]
    for lesson in lessons:
        lesson.see(frame(WORLD, lit, 0, Action("light_on", 1)))
    expected = MODEL.mistake + MODEL.approvals["that_mov"].peak * 0.25
    pressed = sum(lesson.moments[0].pressed for lesson in lessons)
    spread = np.sqrt(len(lessons) * expected * (1 - expected))
    assert abs(pressed - len(lessons) * expected) < 4 * spread


def test_a_teacher_answers_pages_presses_when_it_means_to_and_comes_back_after_breaks() -> None:
    actions = [action for action, _ in walk(5, 60)]
    straight, broken = TeacherSide(actions), TeacherSide(actions, breaks={0, 17, 59})
    bots = [asyncio.run(taught(side)) for side in (straight, broken)]
    moments = bots[0].lessons[0].moments
    assert straight.presses == {t: int(moment.pressed) for t, moment in enumerate(moments)}
    assert sum(straight.presses.values()) > 0
    assert broken.presses == straight.presses
    assert [bot.line.connections for bot in bots] == [1, 4]


async def taught(side: TeacherSide) -> TeacherBot:
    async with served(side) as address:
        bot = TeacherBot(Line(address, "token", patience=5), MODEL, [7])
        await bot.run()
    return bot


@pytest.mark.parametrize("deaf", [set(), set(range(3, 400, 4))])
def test_an_operator_reaches_the_task_that_a_patient_teacher_approves(deaf: set[int]) -> None:
    side = OperatorSide(approves, deaf)
    asyncio.run(operated(side))
    assert side.final is not None
    assert WORLD.is_goal(side.final, CARD)


def approves(actions: Sequence[Action]) -> bool:
    """A press two steps after the right ball was lit, or the right distance reached."""
    if len(actions) < 3:
        return False
    before, state = WORLD.start(), WORLD.start()
    for action in actions[:-2]:
        before, state = state, WORLD.step(state, action)
    wanted = CARD.wrt if state.held == CARD.mov else CARD.mov
    lit = wanted in state.lit and wanted not in before.lit and state.held in (None, CARD.mov)
    return lit or (WORLD.is_goal(state, CARD) and len(actions) % 6 == 0)


async def operated(side: OperatorSide) -> None:
    async with served(side) as address:
        bot = OperatorBot(Line(address, "token"), 0.5, [7])
        run = asyncio.create_task(bot.run())
        while side.final is None and len(side.actions) < 400 and not run.done():
            await asyncio.sleep(0.01)
        run.cancel()
        await asyncio.gather(run, return_exceptions=True)


def test_a_line_that_nobody_answers_is_given_up_in_one_sentence() -> None:
    with pytest.raises(LineError, match=r"nobody answered for 0\.2 s"):
        asyncio.run(TeacherBot(Line("http://127.0.0.1:1", "token", patience=0.2), MODEL, [1]).run())


@given(st.integers(0, 10**6), st.booleans() | st.none(), st.integers(0, 600))
def test_answers_are_within_what_is_asked(seed: int, right: bool | None, steps: int) -> None:
    items: list[dict[str, Any]] = [
        {"item": "age", "kind": "integer", "low": 18, "high": 99},
        {"item": "familiarity", "kind": "scale", "low": 1, "high": 7},
        {"item": "right", "kind": "choice", "choices": [{"value": "yes"}, {"value": "no"}]},
        {"item": "remarks", "kind": "text"},
    ]
    given = answers(items, right, steps, np.random.default_rng(seed))
    assert 18 <= int(str(given["age"])) <= 60
    assert 1 <= int(str(given["familiarity"])) <= 7
    assert given["right"] in (["yes", "no"] if right is None else ["yes" if right else "no"])
    assert given["remarks"] == "simulated"


def test_people_act_within_the_step() -> None:
    rng = np.random.default_rng(1)
    drawn = [latency(0.5, rng) for _ in range(2000)]
    assert 0.025 <= min(drawn) < max(drawn) <= 0.4
    assert abs(float(np.median(drawn)) - 0.175) < 0.01
