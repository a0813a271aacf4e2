"""Servers of one trial in lockstep, as small as can be: for tests of the bots alone."""

from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

from websockets.asyncio.server import ServerConnection, serve
from websockets.exceptions import ConnectionClosed

from taskcomm.robot import Final
from taskcomm.web.frames import frame
from taskcomm.web.pilots import OperatorPilot
from taskcomm.web.protocol import (
    Act,
    Answer,
    Done,
    Hello,
    Page,
    Press,
    Pressed,
    Seat,
    Welcome,
    decode,
    encode,
)
from taskcomm.world import NOA, Action, BallWorld

WORLD = BallWorld()


@asynccontextmanager
async def served(server: "TeacherSide | OperatorSide") -> AsyncIterator[str]:
    """The address of a server that is running."""

    async def speak(socket: ServerConnection) -> None:
        try:
            await server.speak(socket)
        except ConnectionClosed:
            return

    async with serve(speak, "127.0.0.1", 0) as running:
        yield f"http://127.0.0.1:{next(iter(running.sockets)).getsockname()[1]}"


async def _say(socket: ServerConnection, message: Any) -> None:
    await socket.send(encode(message).decode())


async def _welcome(socket: ServerConnection, role: Any) -> None:
    assert isinstance(decode(await socket.recv()), Hello)
    await _say(socket, Welcome(role=role, title="", name="P01", language="en", texts={}, lockstep=True))


@dataclass
class TeacherSide:
    """Shows `actions` to a teacher whose card is (1, 2, 4); `presses` are counted by step, as last shown.

    The line breaks once after each of the steps `breaks`; then that step is shown again.
    """

    actions: Sequence[Action]
    breaks: set[int] = field(default_factory=set)
    presses: dict[int, int] = field(default_factory=dict)

    async def speak(self, socket: ServerConnection) -> None:
        await _welcome(socket, "teacher")
        if not self.presses:
            await _say(socket, Page(index=0, of=3, kind="card", content={"mov": 1, "wrt": 2, "dist": 4}))
            assert isinstance(decode(await socket.recv()), Answer)
        await _say(socket, Page(index=1, of=3, kind="trial"))
        first, state = max(self.presses, default=0), WORLD.start()
        for t, action in enumerate(self.actions):
            state = WORLD.step(state, action)
            if t >= first:
                self.presses[t] = 0
                await _say(socket, frame(WORLD, state, t, action))
                while not isinstance(message := decode(await socket.recv()), Done):
                    self.presses[t] += isinstance(message, Press)
            if t in self.breaks:
                self.breaks.remove(t)
                await socket.close()
                return
        await _say(socket, Page(index=2, of=3, kind="thanks"))


@dataclass
class OperatorSide:
    """Does what an operator asks, but not in the steps `deaf`; `pressed(actions)` says when presses come."""

    pressed: Callable[[Sequence[Action]], bool]
    deaf: set[int] = field(default_factory=set)
    actions: list[Action] = field(default_factory=list)
    final: Any = None

    async def speak(self, socket: ServerConnection) -> None:
        await _welcome(socket, "operator")
        await _say(socket, Seat(state="control", participant="P01"))
        pilot, state, action = OperatorPilot(WORLD), WORLD.start(), NOA
        while len(self.actions) < 400:
            self.actions.append(action)
            t, state = len(self.actions) - 1, WORLD.step(state, action)
            pilot.look([], None, state)
            await _say(socket, frame(WORLD, state, t, action))
            if self.pressed(self.actions):
                await _say(socket, Pressed(t=t))
            while not isinstance(message := decode(await socket.recv()), Done):
                assert isinstance(message, Act)
                assert message.t == t
                if message.action == "final":
                    self.final = state
                    await socket.wait_closed()
                    return
                if t not in self.deaf:
                    assert pilot.choose(message.action), message.action
            choice = pilot.take(None).action
            assert not isinstance(choice, Final)
            action = choice
