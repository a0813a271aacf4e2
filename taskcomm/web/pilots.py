"""Who controls the robot in a trial of the browser: the planner, or an operator with a mouse."""

import asyncio
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol

from taskcomm.robot import Final
from taskcomm.trials import Step
from taskcomm.web.frames import last_slid
from taskcomm.web.thinking import History, Minds, RobotPlan, Thought
from taskcomm.world import NOA, Action, BallState, BallWorld


@dataclass(frozen=True)
class Choice:
    """The robot's next action, who chose it (`planner`, `operator`, `default`) and the planner's ms."""

    action: Action | Final
    source: str
    plan_ms: float | None = None


DEFAULT = Choice(NOA, "default")


class Pilot(Protocol):
    """Chooses one action a step.

    `look` is called when a step begins: `steps` are over, `action` has been applied and led to `state`.
    `take`, at its end, gives the choice for the next step at once, whatever has been thought by then.
    `settled` waits until there is nothing more to wait for (lockstep, and the first action of a trial).
    """

    def look(self, steps: Sequence[Step], action: Action | None, state: BallState) -> None: ...
    def take(self, pressed: bool | None) -> Choice: ...
    async def settled(self) -> None: ...


class PlannerPilot:
    """The robot's planner, which thinks during each step for everything that may be observed in it.

    Pressed is what happens seldom: it is thought about when the thought for no press is there, so that a
    machine with too much to do gives every trial the likelier of the two in time. What is not thought by the
    end of the step is not waited for: the choice is then `noa`, `default`. `failed` keeps what went wrong in
    thinking, for the log.
    """

    def __init__(self, minds: Minds, robot: RobotPlan) -> None:
        self._minds, self._robot = minds, robot
        self._mind = minds.mind()
        self._thoughts: dict[bool | None, Future[Thought]] = {}
        self._rest: dict[bool | None, History] = {}
        self.failed: str | None = None

    def look(self, steps: Sequence[Step], action: Action | None, state: BallState) -> None:
        """Have it thought about what comes after this step."""
        for late in self._thoughts.values():
            late.cancel()
        past: History = tuple((str(step.action), step.pressed) for step in steps)
        if action is None:  # before the first step, or after a crash: all that was observed is known
            self._thoughts, self._rest = dict.fromkeys((False, True, None), self._asked(past)), {}
            return
        unseen = (None,) if steps and steps[-1].pressed is None else ()
        rest = {pressed: (*past, (str(action), pressed)) for pressed in (True, *unseen)}
        first = self._asked((*past, (str(action), False)))
        self._thoughts, self._rest = {False: first}, rest
        _then(first, lambda: self._ask_rest(rest))

    def _ask_rest(self, rest: dict[bool | None, History]) -> None:
        """The questions of a step, unless the next step has others."""
        if rest is self._rest:
            self._rest = {}
            with suppress(RuntimeError):  # the server is closing
                self._thoughts |= {pressed: self._asked(history) for pressed, history in rest.items()}

    def _asked(self, history: History) -> "Future[Thought]":
        return self._minds.think(self._mind, self._robot, history)

    def take(self, pressed: bool | None) -> Choice:
        """What was thought for this observation, if it was."""
        future = self._thoughts.get(pressed)
        if future is None or not future.done() or future.cancelled():
            return DEFAULT
        error = future.exception()
        if error is not None:
            self.failed = f"{type(error).__name__}: {error}"
            return DEFAULT
        thought = future.result()
        return Choice(thought.action, "planner", thought.plan_ms)

    async def settled(self) -> None:
        """Until everything is thought."""
        while self._rest:
            await _done(self._thoughts[False])
            self._ask_rest(self._rest)
        for future in {*self._thoughts.values()}:
            await _done(future)


class OperatorPilot:
    """A person: the last valid action chosen in a step is the next one; without any, `noa`, `default`."""

    def __init__(self, world: BallWorld) -> None:
        self._world = world
        self._chosen: Action | Final | None = None
        self._offered: dict[str, Action | Final] = {}

    def look(self, steps: Sequence[Step], action: Action | None, state: BallState) -> None:
        """A new step: other actions are valid, none is chosen."""
        self._chosen = None
        self._offered = {str(valid): valid for valid in self._world.actions(state)}
        done = [*(step.action for step in steps), *([] if action is None else [action])]
        shown = last_slid(done)
        if shown is not None:
            self._offered["final"] = Final(shown)

    @property
    def offered(self) -> list[str]:
        """What can be chosen, as it prints."""
        return list(self._offered)

    @property
    def chosen(self) -> str:
        """What is chosen so far, or ""."""
        if self._chosen is None:
            return ""
        return "final" if isinstance(self._chosen, Final) else str(self._chosen)

    def choose(self, action: str) -> bool:
        """Choose; False where that is not valid now."""
        if action not in self._offered:
            return False
        self._chosen = self._offered[action]
        return True

    def take(self, pressed: bool | None) -> Choice:
        """The choice for the next step."""
        return DEFAULT if self._chosen is None else Choice(self._chosen, "operator")

    async def settled(self) -> None:
        """There is nothing to wait for."""


async def _done(future: "Future[Thought]") -> None:
    """Until `future` is done, with whatever result."""
    done = asyncio.Event()
    _then(future, done.set)
    await done.wait()


def _then(future: "Future[Thought]", call: Callable[[], object]) -> None:
    """When `future` is done, with whatever result, `call` on the event loop."""
    loop = asyncio.get_running_loop()

    def tell(_: object) -> None:
        with suppress(RuntimeError):  # the loop is closed
            loop.call_soon_threadsafe(call)

    future.add_done_callback(tell)
