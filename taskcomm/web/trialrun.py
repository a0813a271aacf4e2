"""One trial as it runs: clock, world, who controls the robot, the key, the log. It knows no network."""

import asyncio
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from taskcomm.logwriter import TrialWriter
from taskcomm.robot import Final
from taskcomm.trials import Step
from taskcomm.web.clock import Clock
from taskcomm.web.frames import frame
from taskcomm.web.pilots import Choice, Pilot, PlannerPilot
from taskcomm.web.protocol import Frame
from taskcomm.world import Action, BallState, BallWorld

# Seconds: were the planner set to work at once, its frames would come later than an operator's, and tell.
_FRAME_GOES_FIRST = 0.01
_FIRST_THOUGHT = 1.0  # that a planner may take beyond the countdown: its process may have to start again
Order = Literal["pause", "go_on", "abort"]


class StorageError(OSError):
    """A line of a log could not be written; the trial stops, and what was acknowledged is there."""


class Audience(Protocol):
    """Whoever is to be told how a trial goes."""

    def show(self, frame: Frame) -> None:
        """To everyone who sees this trial."""

    def opened(self) -> None:
        """To the operator: another step, other actions."""

    def saved(self, seq: int) -> None:
        """Lines up to `seq` are on disk."""

    def clocks(self) -> dict[str, Any]:
        """Round-trip times and clock offsets of those who take part, in ms, for the log."""


@dataclass(frozen=True)
class Timing:
    """Rules of time, in seconds. `limit` is in steps. In `lockstep` no clock runs: see TrialRun.done."""

    step: float = 0.5
    limit: int = 600
    countdown: int = 3
    grace: float = 2.0
    away: float = 120.0
    lockstep: bool = False


class TrialRun:
    """Runs a trial to its end; `run()` gives the reason: final, timeout or aborted.

    At the tick of step t the action is applied and shown; presses until the next tick belong to the step; its
    line is written at the next tick. While the teacher is away the key is written as not recorded, unless it
    was pressed before; after `grace` the clock pauses until the teacher is back, after `away` the trial is
    aborted. A stall of the machine (a tick late by half a step) lengthens the step that it hit, with an event
    `stall`; the clock moves by as much. A trial that is given with steps goes on from the last of them, with
    a resume line.
    """

    def __init__(
        self,
        writer: TrialWriter,
        pilot: Pilot,
        append: Callable[[bytes], "asyncio.Future[None]"],
        audience: Audience,
        timing: Timing,
        waits_for: frozenset[str] = frozenset(("teacher",)),
    ) -> None:
        world = writer.head.world
        assert isinstance(world, BallWorld)
        self.world, self.writer, self.pilot, self.timing = world, writer, pilot, timing
        self.clock = Clock(timing.step)
        self._append_bytes, self._audience, self._waits_for = append, audience, waits_for
        self.state: BallState = world.start()
        for step in writer.steps:
            self.state = world.step(self.state, step.action)  # type: ignore[arg-type]
        self.t = len(writer.steps) - 1
        self._action: Any = writer.steps[-1].action if writer.steps else None
        self.mode: Literal["count", "run", "pause", "over"] = "count"
        self._count = 0
        self._final: Any = None
        self._pressed = self._gap = False
        self._away_since: float | None = None
        self._paused = self._aborted = False
        self.held = False  # whether what is chosen now comes to nothing: the next action has been chosen
        self._changed = asyncio.Event()
        self._done: set[str] = set()
        self._broken: BaseException | None = None
        self.defaults = sum(step.action_source == "default" for step in writer.steps)

    async def run(self) -> str:
        """The trial, to its end. Raises StorageError where its log cannot be written."""
        await self._append(self._beginning())
        looked = asyncio.create_task(self._first_look())
        await self._counted_down()
        await looked
        await self._first_thought()
        if self._held_up():
            await self._interval()
        choice, late = self._begin_clock(), 0.0
        while True:
            ended = self._ended(choice)
            if ended is not None:
                return await self._end(ended, choice)
            await self._show_step(choice)
            late_next = await self._step_over()
            pressed = self._key()
            following = self.pilot.take(pressed)
            self._write_step(choice, pressed, late)
            choice, late = following, late_next
            if self._held_up():
                await self._interval()

    async def _first_look(self) -> None:
        if not self.timing.lockstep:
            await asyncio.sleep(_FRAME_GOES_FIRST)
        self.pilot.look(self.writer.steps, None, self.state)
        self._audience.opened()

    async def _first_thought(self) -> None:
        with suppress(TimeoutError):
            await asyncio.wait_for(self.pilot.settled(), None if self.timing.lockstep else _FIRST_THOUGHT)

    def _beginning(self) -> bytes:
        if self.writer.next_seq == 0:
            return self.writer.start()
        return self.writer.resume(utc=utc(), steps=len(self.writer.steps))

    def _begin_clock(self) -> Choice:
        """The first choice of the trial, or after a crash: a person has chosen nothing, a planner has."""
        last = self.writer.steps[-1].pressed if self.writer.steps else None
        self.clock.start(self.t + 1)
        self.mode = "run"
        return self.pilot.take(last)

    def _ended(self, choice: Choice) -> str | None:
        if self._aborted:
            return "aborted"
        if isinstance(choice.action, Final):
            return "final"
        return "timeout" if len(self.writer.steps) >= self.timing.limit else None

    async def _show_step(self, choice: Choice) -> None:
        assert isinstance(choice.action, Action)
        self.t += 1
        self._action, self.state = choice.action, self.world.step(self.state, choice.action)
        self._pressed, self._gap = False, self._away_since is not None
        self._done.clear()
        self._show()
        if isinstance(self.pilot, PlannerPilot) and not self.timing.lockstep:
            await asyncio.sleep(_FRAME_GOES_FIRST)
        self.pilot.look(self.writer.steps, choice.action, self.state)
        self._audience.opened()

    async def _step_over(self) -> float:
        """Wait for the next tick; by how many ms it is late."""
        if not self.timing.lockstep:
            late = await self.clock.until(self.t + 1)
            if self.clock.stalled(late):
                self.event("stall", ms=round(late, 3))
            return late
        while not (self._waits_for <= self._done or self._aborted):
            await self._news()
            if self._away_since is not None and self._away_too_long():
                self._aborted = True
        await self.pilot.settled()
        return 0.0

    def _key(self) -> bool | None:
        return True if self._pressed else None if self._gap and not self.timing.lockstep else False

    def _write_step(self, choice: Choice, pressed: bool | None, late: float) -> None:
        timing = None
        if not self.timing.lockstep:
            since_due = 0.0 if self.clock.stalled(late) else late
            onset = round(1e3 * self.timing.step * self.t + since_due, 3)
            timing = {"onset": onset, "late_ms": round(late, 3)}
            timing |= {} if choice.plan_ms is None else {"plan_ms": round(choice.plan_ms, 3)}
        self.defaults += choice.source == "default"
        self._append(self.writer.step(Step(choice.action, pressed, choice.source, timing=timing)))
        if isinstance(self.pilot, PlannerPilot) and self.pilot.failed:
            self.event("planner_failed", reason=self.pilot.failed)
            self.pilot.failed = None

    def _held_up(self) -> bool:
        """Whether the next step must wait: somebody paused, or the teacher has been away too long."""
        if self._broken is not None:
            raise StorageError(f"the log of this trial cannot be written: {self._broken}")
        away = self._away_since is not None and time.monotonic() - self._away_since >= self.timing.grace
        return (self._paused or (away and not self.timing.lockstep)) and not self._aborted

    async def _interval(self) -> None:
        """Pauses, until none is due any more or the trial is aborted; a countdown ends each."""
        self.held = True
        while self._held_up():
            self.event("pause", cause="order" if self._paused else "away")
            self.mode = "pause"
            self._show()
            while (self._paused or self._away_since is not None) and not self._aborted:
                await self._news()
                if self._away_since is not None and self._away_too_long():
                    self._aborted = True
            if not self._aborted:
                await self._counted_down()
        self.held = False
        if not self._aborted:
            self.event("go_on")
            self.clock.start(self.t + 1)
            self.mode = "run"

    def _away_too_long(self) -> bool:
        return self._away_since is not None and time.monotonic() - self._away_since >= self.timing.away

    async def _news(self) -> None:
        """Until something changes, or a second has gone by."""
        self._changed.clear()
        try:
            await asyncio.wait_for(self._changed.wait(), 1.0)
        except TimeoutError:
            return

    async def _counted_down(self) -> None:
        self.mode = "count"
        for count in range(0 if self.timing.lockstep else self.timing.countdown, 0, -1):
            self._count = count
            self._show()
            await asyncio.sleep(1.0)
        self._count = 0

    async def _end(self, reason: str, choice: Choice) -> str:
        displayed = choice.action.task if isinstance(choice.action, Final) and reason == "final" else None
        self.mode = "over"
        if displayed is not None:
            self.t, self._action, self._final = self.t + 1, None, displayed
        self._show()
        summary = {} if self.timing.lockstep else self.clock.summary() | self._audience.clocks()
        self.event("timing", default_actions=self.defaults, **summary)
        await self._append(self.writer.end(reason, displayed))
        return reason

    def current(self) -> Frame:
        """What is to be seen now."""
        at = self.world, self.state, self.t, self._action
        return frame(*at, final=self._final, count=self._count, mode=self.mode)

    def _show(self) -> None:
        self._audience.show(self.current())

    def event(self, kind: str, **fields: Any) -> "asyncio.Future[None]":
        """Write something raw beside the steps; the future is done when it is on disk."""
        if not self.timing.lockstep and self.mode != "count" and self.t >= 0:
            fields = {"t": self.t, "server_ms": round(self.clock.elapsed_ms, 3)} | fields
        return self._append(self.writer.event(kind, **fields))

    def _append(self, line: bytes) -> "asyncio.Future[None]":
        done, seq = self._append_bytes(line), self.writer.next_seq - 1
        done.add_done_callback(lambda future: self._written(future, seq))
        return done

    def _written(self, future: "asyncio.Future[None]", seq: int) -> None:
        if future.cancelled():
            return
        error = future.exception()
        self._broken = self._broken or error
        if self._broken is None:
            self._audience.saved(seq)

    def press(self, **fields: Any) -> "asyncio.Future[None] | None":
        """The spacebar went down: in this step, if one runs. The future is done when it is on disk."""
        if self.mode == "over":
            return None
        self._pressed = self._pressed or self.mode == "run"
        return self.event("press", **fields)

    def teacher_away(self, **fields: Any) -> None:
        """The teacher's connection is lost, or silent."""
        if self._away_since is None and self.mode != "over":
            self._away_since, self._gap = time.monotonic(), True
            self.event("away", **fields)

    def teacher_back(self) -> None:
        """The teacher's connection is there again."""
        if self._away_since is not None and self.mode != "over":
            self._away_since = None
            self.event("back")
            self._changed.set()

    def order(self, what: Order) -> None:
        """Pause, go on, or abort, at the next tick."""
        self._paused = what == "pause" if what != "abort" else self._paused
        self._aborted = self._aborted or what == "abort"
        if self.mode != "over":
            self.event("order", what=what)
        self._changed.set()

    def done(self, role: str, t: int) -> None:
        """In lockstep: nothing more comes from `role` in step `t`."""
        if t == self.t:
            self._done.add(role)
            self._changed.set()


def utc() -> str:
    """Now, as logs write it."""
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
