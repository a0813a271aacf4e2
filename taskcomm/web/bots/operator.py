"""A simulated person at the operator's page."""

from collections import deque
from collections.abc import Sequence
from contextlib import aclosing

import numpy as np

from taskcomm.operators import ScriptedOperator
from taskcomm.robot import Final
from taskcomm.web.bots.latency import latency
from taskcomm.web.bots.line import Line, LineError, now_ms
from taskcomm.web.bots.mirror import world_of
from taskcomm.web.protocol import Act, Done, Frame, Pressed, Problem, Ready, Seat, Welcome
from taskcomm.world import NOA


class OperatorBot:
    """An operator who says ready when asked and plays as ScriptedOperator does, a step behind the presses.

    What the robot did not do (too late, or lost in a crash) is asked for again. `run()` never ends by itself.
    """

    def __init__(self, line: Line, step: float, seed: Sequence[int]) -> None:
        self.line, self.step, self.seed = line, step, tuple(seed)
        self._seat = Seat(state="idle", participant="")
        self._script: ScriptedOperator | None = None
        self._lockstep = self._started = False
        self._heard = self._decided = -1  # step whose presses the script knows; step in which it last acted
        self._presses: set[int] = set()
        self._asked: deque[str] = deque()
        self._carried_out: list[tuple[str, int]] = []
        self._rng = np.random.default_rng([*self.seed, 0])

    async def run(self) -> None:
        """Until cancelled. Raises LineError where the line is lost for good, or something is refused."""
        async with aclosing(self.line.messages()) as messages:
            async for message in messages:
                match message:
                    case Welcome():
                        self._lockstep = message.lockstep
                    case Seat():
                        await self._sit(message)
                    case Pressed():
                        self._presses.add(message.t)
                    case Frame():
                        await self._watch(message)
                    case Problem():
                        raise LineError(f"refused: {message.text}")

    async def _sit(self, seat: Seat) -> None:
        self._seat = seat
        if seat.state == "ask":
            await self.line.send(Ready())

    def _begin(self, frame: Frame) -> None:
        self._script = ScriptedOperator(world_of(frame), self.step, reaction=1.0 + self.step)
        key = [int.from_bytes(self._seat.participant.encode(), "big"), *self.seed]
        self._script.reset(np.random.default_rng(key))
        self._presses.clear()
        self._asked.clear()
        self._carried_out.clear()
        self._heard = self._decided = -1
        self._started = False

    async def _watch(self, frame: Frame) -> None:
        if self._seat.state != "control" or frame.state != "run" or frame.t < 0:
            return
        if self._script is None or frame.t == 0:
            self._begin(frame)
        self._reconcile(frame)
        if not self._asked and frame.t > self._decided:
            self._decide(frame.t)
        if self._asked:
            await self._act(frame.t, self._asked[0])
        if self._lockstep:
            await self.line.send(Done(t=frame.t))

    def _reconcile(self, frame: Frame) -> None:
        """Strike off what was carried out in this step; what was undone by a crash is asked for again."""
        while self._carried_out and self._carried_out[-1][1] >= frame.t:
            self._asked.appendleft(self._carried_out.pop()[0])
        if self._asked and frame.action == self._asked[0]:
            self._carried_out.append((self._asked.popleft(), frame.t))

    def _decide(self, t: int) -> None:
        assert self._script is not None
        pressed = any(self._heard < press < t for press in self._presses)
        self._heard, self._decided = max(self._heard, t - 1), t
        action = self._script.act(pressed if self._started else None)
        self._started = True
        if isinstance(action, Final):
            self._asked.append("final")
        elif action != NOA:
            self._asked.append(str(action))

    async def _act(self, t: int, action: str) -> None:
        if self._lockstep:
            await self.line.send(Act(t=t, action=action, at=now_ms()))
        else:
            wait = latency(self.step, self._rng)
            self.line.send_later(wait, lambda: Act(t=t, action=action, at=now_ms()))
