import asyncio
from concurrent.futures import Future
from typing import Any

from taskcomm.teacher import TeacherModel
from taskcomm.web.pilots import DEFAULT, PlannerPilot
from taskcomm.web.thinking import History, RobotPlan, Thought
from taskcomm.world import NOA, Action, BallWorld

WORLD = BallWorld()
ROBOT = RobotPlan(WORLD, TeacherModel.intuitive(), 2)
LIT = Action("light_on", 1)


class Asked:
    """Planners that answer when they are told to; what they were asked, in order."""

    def __init__(self) -> None:
        self.questions: list[tuple[History, Future[Thought]]] = []

    def mind(self) -> int:
        return 0

    def think(self, mind: int, robot: RobotPlan, history: History) -> "Future[Thought]":
        self.questions.append((history, Future()))
        return self.questions[-1][1]

    @property
    def last_keys(self) -> list[bool | None]:
        return [history[-1][1] for history, _ in self.questions]


def looking(pilots: int) -> tuple[Any, list[PlannerPilot]]:
    asked: Any = Asked()
    many = [PlannerPilot(asked, ROBOT) for _ in range(pilots)]
    for pilot in many:
        pilot.look([], LIT, WORLD.step(WORLD.start(), LIT))
    return asked, many


def test_every_trial_gets_its_likelier_thought_before_any_gets_the_other() -> None:
    async def run() -> None:
        asked, pilots = looking(3)
        assert asked.last_keys == [False, False, False]
        for _, future in list(asked.questions):
            future.set_result(Thought(NOA, 1.0))
        await asyncio.sleep(0.01)
        assert asked.last_keys == [False, False, False, True, True, True]
        assert [pilot.take(False).source for pilot in pilots] == ["planner"] * 3
        assert [pilot.take(True) for pilot in pilots] == [DEFAULT] * 3

    asyncio.run(run())


def test_a_step_that_is_over_asks_nothing_more() -> None:
    async def run() -> None:
        asked, [pilot] = looking(1)
        pilot.look([], NOA, WORLD.start())
        assert asked.questions[0][1].cancelled()
        await asyncio.sleep(0.01)
        assert asked.last_keys == [False, False]
        asked.questions[1][1].set_result(Thought(NOA, 1.0))
        await asyncio.sleep(0.01)
        assert [history[-1] for history, _ in asked.questions[1:]] == [("noa", False), ("noa", True)]

    asyncio.run(run())


def test_settled_is_when_everything_is_thought() -> None:
    async def run() -> None:
        asked, [pilot] = looking(1)
        waiting = asyncio.create_task(pilot.settled())
        for number in range(2):
            await asyncio.sleep(0.01)
            assert not waiting.done()
            asked.questions[number][1].set_result(Thought(NOA, 1.0))
        await asyncio.wait_for(waiting, 1)
        assert {pilot.take(pressed).source for pressed in (False, True)} == {"planner"}

    asyncio.run(run())
