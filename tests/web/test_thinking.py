"""Thinking off the event loop: the answer depends on the history alone; a process that dies is replaced."""

import os
import signal
from collections.abc import Iterator
from concurrent.futures.process import BrokenProcessPool

import pytest

from taskcomm.robot import Final, Robot
from taskcomm.teacher import TeacherModel
from taskcomm.web.thinking import History, Minds, RobotPlan, Thinker
from taskcomm.world import Action, BallWorld

WORLD, MODEL = BallWorld(), TeacherModel.intuitive()
PLAN = RobotPlan(WORLD, MODEL, horizon=2)


@pytest.fixture(scope="module")
def minds() -> Iterator[Minds]:
    minds = Minds([PLAN])
    minds.warm_up()
    yield minds
    minds.close()


def history_of(robot: Robot, presses: set[int], steps: int) -> tuple[History, list[Action | Final]]:
    """What a robot that keeps its own belief does, by the history before each of its actions."""
    done: list[tuple[str, bool | None]] = []
    chosen = [robot.act(None)]
    for t in range(steps):
        done.append((str(chosen[-1]), t in presses))
        chosen.append(robot.act(t in presses))
    return tuple(done), chosen


def test_a_thinker_does_after_a_history_what_a_robot_does_that_lived_it() -> None:
    history, wanted = history_of(PLAN.robot(), {3, 9, 21}, 40)
    forgetful = Thinker(PLAN, remembered=1)
    for length in (40, 3, 17, 0, 39):
        assert Thinker(PLAN).think(history[:length]).action == wanted[length]
        assert forgetful.think(history[:length]).action == wanted[length]


def test_a_thinker_goes_on_from_what_was_really_done() -> None:
    """A default action is not what it chose; a key may have gone unrecorded."""
    history: History = (("noa", False), ("light_on(2)", None), ("pick_up(3)", True), ("noa", None))
    world, belief = WORLD, PLAN.robot().belief
    state = world.start()
    for action, pressed in history:
        state = world.step(state, Action.parse(action))
        belief = belief.update(state, pressed)
    assert Thinker(PLAN).think(history).action == PLAN.robot().choose(belief, state)


def test_it_remembers_no_more_beliefs_than_it_may() -> None:
    history, _ = history_of(PLAN.robot(), set(), 30)
    thinker = Thinker(PLAN, remembered=5)
    for length in range(31):
        thinker.think(history[:length])
    assert len(thinker._known) == 5
    assert () in thinker._known


def test_another_process_gives_the_same_answer(minds: Minds) -> None:
    history, wanted = history_of(PLAN.robot(), {3}, 12)
    assert minds.think(0, PLAN, history).result().action == wanted[12]


def test_a_process_that_dies_is_replaced(minds: Minds) -> None:
    [process] = minds.processes()
    os.kill(process, signal.SIGKILL)
    with pytest.raises(BrokenProcessPool):
        [minds.think(0, PLAN, ()).result() for _ in range(200)]
    assert isinstance(minds.think(0, PLAN, ()).result().action, Action)
    assert minds.processes() != [process]
