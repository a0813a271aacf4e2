"""A study that is served in a thread of the test, on a free port of this machine."""

import asyncio
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any

import msgspec
from websockets import Origin
from websockets.sync.client import ClientConnection, connect

from taskcomm.web.house import House
from taskcomm.web.protocol import Role
from taskcomm.web.serving import LOOPBACK, _run, listening, origins_of
from taskcomm.web.study.folder import StudyFolder


@dataclass
class Served:
    """Where it is, and what it holds."""

    address: str
    house: House
    loop: asyncio.AbstractEventLoop
    clients: ExitStack

    @property
    def socket(self) -> str:
        return self.address.replace("http", "ws", 1) + "/ws"

    def token(self, role: Role, name: str = "") -> str:
        return self.house.folder.tokens[role][name or role]

    def link(self, role: Role, name: str = "") -> str:
        return f"{self.address}/#{self.token(role, name)}"

    def connect(self) -> ClientConnection:
        """A bare WebSocket, from the server's own page."""
        return self.clients.enter_context(
            connect(self.socket, origin=Origin(self.address), open_timeout=5, close_timeout=1)
        )

    def hello(self, role: Role, name: str = "") -> ClientConnection:
        """One that has said hello and read its welcome."""
        client = self.connect()
        send(client, type="hello", token=self.token(role, name))
        assert receive(client)["type"] == "welcome"
        return client


def send(client: ClientConnection, **message: Any) -> None:
    client.send(msgspec.json.encode(message).decode())


def receive(client: ClientConnection, *kinds: str, timeout: float = 5.0) -> dict[str, Any]:
    """The next message, or the next of these types, within `timeout` s; pings are answered."""
    end = time.monotonic() + timeout
    while True:
        message: dict[str, Any] = msgspec.json.decode(client.recv(timeout=max(0.0, end - time.monotonic())))
        if message["type"] == "ping":
            send(client, type="pong", n=message["n"], at=0)
        elif not kinds or message["type"] in kinds:
            return message


@contextmanager
def served(folder: StudyFolder, *, lockstep: bool = False) -> Iterator[Served]:
    """Serve a study until the block ends; everything is on disk then."""
    bound = listening(LOOPBACK, 0)
    port = bound.getsockname()[1]
    house = House.of(folder, lockstep=lockstep)
    begun, ended = threading.Event(), threading.Event()
    loops: list[asyncio.AbstractEventLoop] = []
    address = f"http://{LOOPBACK}:{port}"

    def ready(_: str) -> None:
        loops.append(asyncio.get_running_loop())
        begun.set()

    def run() -> None:
        asyncio.run(_run(house, bound, address, origins_of(LOOPBACK, port), ready, lambda _: ended.is_set()))

    thread = threading.Thread(target=run)
    thread.start()
    try:
        assert begun.wait(10), "the server did not start"
        with ExitStack() as clients:
            yield Served(address, house, loops[0], clients)
    finally:
        ended.set()
        thread.join(15)
        house.close()
