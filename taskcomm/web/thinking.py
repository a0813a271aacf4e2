"""The planner, off the event loop: processes that answer what a robot would do after a history.

A question holds all that the answer depends on, so any process can answer it, one that was just started too;
what makes it quick is that each remembers the beliefs it has met.
"""

import logging
import os
import threading
import time
from collections import OrderedDict
from collections.abc import Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import connection, get_context, parent_process
from typing import Any

from taskcomm.belief import Belief
from taskcomm.planner import EntropyPlanner
from taskcomm.robot import Final, Robot
from taskcomm.teacher import TeacherModel
from taskcomm.world import Action, BallState, BallWorld

log = logging.getLogger("taskcomm")

History = tuple[tuple[str, bool | None], ...]  # of the steps so far: the action as it prints, pressed
_REMEMBERED = 256


@dataclass(frozen=True)
class RobotPlan:
    """A robot that a study names: its world, model, horizon in steps, threshold of Final."""

    world: BallWorld
    model: TeacherModel
    horizon: int = 5
    threshold: float = 0.98

    def robot(self) -> Robot:
        """The robot, planner included."""
        planner = EntropyPlanner(self.world, self.model, horizon=self.horizon)
        return Robot(self.world, self.model, planner, self.threshold)


@dataclass(frozen=True)
class Thought:
    """What the robot does next, and how long it took to find out (ms of processor time)."""

    action: Action | Final
    plan_ms: float


class Thinker:
    """One robot's answers, with a memory of beliefs by history; a history it has not met is gone through."""

    def __init__(self, plan: RobotPlan, remembered: int = _REMEMBERED) -> None:
        self.plan, self._robot, self._remembered = plan, plan.robot(), remembered
        self._known: OrderedDict[History, tuple[Belief, BallState]] = OrderedDict()
        self._known[()] = self._robot.belief, plan.world.start()

    def think(self, history: History) -> Thought:
        """The action after these steps. Raises ImpossibleObservation as the belief does."""
        began = time.process_time()
        belief, state = self._situation(history)
        action = self._robot.choose(belief, state)
        return Thought(action, 1e3 * (time.process_time() - began))

    def _situation(self, history: History) -> tuple[Belief, BallState]:
        length = len(history)
        while history[:length] not in self._known:
            length -= 1
        belief, state = self._known[history[:length]]
        for step in range(length, len(history)):
            action, pressed = history[step]
            state = self.plan.world.step(state, Action.parse(action))
            belief = belief.update(state, pressed)
            self._known[history[: step + 1]] = belief, state
        if history:
            self._known.move_to_end(history)
        while len(self._known) > self._remembered:
            oldest = next(known for known in self._known if known)
            del self._known[oldest]
        return belief, state


class Minds:
    """So many processes, each with a thinker for every robot; a trial keeps to one of them.

    A process that dies is `replaced` (how often is counted, and said in the log of the server); the question
    that it was at raises BrokenProcessPool.
    """

    def __init__(self, robots: Sequence[RobotPlan], processes: int = 1) -> None:
        self._robots = tuple(robots)
        self._pools = [self._started() for _ in range(processes if robots else 0)]
        self._next = 0
        self.replaced = 0

    def _started(self) -> ProcessPoolExecutor:
        context = get_context("spawn")
        return ProcessPoolExecutor(1, mp_context=context, initializer=_begin, initargs=(self._robots,))

    def warm_up(self) -> None:
        """Load kernels everywhere; on a new machine they are compiled first, by one process."""
        for pool in self._pools:
            for number in range(len(self._robots)):
                pool.submit(_think, number, ()).result()

    def mind(self) -> int:
        """The process for the next trial."""
        self._next += 1
        return self._next % max(1, len(self._pools))

    def think(self, mind: int, robot: RobotPlan, history: History) -> "Future[Thought]":
        """The thought of one robot after these steps, to come."""
        number = self._robots.index(robot)
        try:
            return self._pools[mind].submit(_think, number, history)
        except BrokenProcessPool:
            self.replaced += 1
            log.warning("a process of the planner died; another is started")
            self._pools[mind].shutdown(wait=False)
            self._pools[mind] = self._started()
            return self._pools[mind].submit(_think, number, history)

    def close(self) -> None:
        """End all processes, when each has done what it is at."""
        for pool in self._pools:
            pool.shutdown(cancel_futures=True)

    def processes(self) -> list[int]:
        """Their process numbers, for measurements."""
        return [pid for pool in self._pools for pid in (getattr(pool, "_processes", None) or {})]


_thinkers: list[Thinker] = []


def _begin(robots: tuple[RobotPlan, ...]) -> None:
    """In a new process: its thinkers; they give way to the server, whose clock waits for nobody."""
    end_with_parent()
    os.nice(10)
    _thinkers[:] = [Thinker(plan) for plan in robots]


def end_with_parent() -> None:
    """This process leaves interrupts to its parent, and ends with it, however that ends."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent: Any = parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    connection.wait([sentinel])
    os._exit(1)


def _think(number: int, history: History) -> Thought:
    return _thinkers[number].think(history)
