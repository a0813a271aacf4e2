"""A program's line to the server: what a browser does with its WebSocket, without a browser."""

import asyncio
import time
from collections.abc import AsyncGenerator, Callable

import msgspec
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.typing import Origin

from taskcomm.web.protocol import FromClient, Hello, Ping, Pong, ToAny, ToClient, Welcome

SHUT_OUT = range(4000, 5000)  # codes of a server that wants no more of us
_decoder = msgspec.json.Decoder(ToAny)
_encoder = msgspec.json.Encoder()


class LineError(Exception):
    """The server is gone for good, or wants no more of us; says which."""


def now_ms() -> float:
    """Milliseconds since 1970, as a browser gives them with an event."""
    return time.time() * 1000


class Line:
    """Says hello, answers pings, and after a break connects again, until nobody answers for `patience` s.

    `address` is that of the page, `http://host:port`. `heard(seconds, content)`, if given, gets every message
    as it came, with a monotonic time. `connections` counts connections so far.
    """

    def __init__(
        self,
        address: str,
        token: str,
        *,
        patience: float = 30.0,
        heard: Callable[[float, bytes], None] | None = None,
    ) -> None:
        self.address = address.rstrip("/")
        self.patience = patience
        self.connections = 0
        self._token, self._heard = token, heard
        self._socket: ClientConnection | None = None
        self._later: set[asyncio.Task[None]] = set()

    async def messages(self) -> AsyncGenerator[ToClient, None]:
        """What the server says, a Welcome first after each connection; pings are answered here.

        Raises LineError where the server shuts us out, or does not answer any more.
        """
        while True:
            socket = await self._connected()
            try:
                async for content in socket:
                    raw = content.encode() if isinstance(content, str) else content
                    if self._heard:
                        self._heard(time.monotonic(), raw)
                    message = _decoder.decode(raw)
                    if isinstance(message, Ping):
                        await self.send(Pong(n=message.n, at=now_ms()))
                        continue
                    if isinstance(message, Welcome):
                        self.connections += 1
                    yield message
            except ConnectionClosed:
                pass
            finally:
                self._socket = None
                for task in self._later:
                    task.cancel()
                await socket.close()
            if socket.close_code in SHUT_OUT:
                raise LineError(f"{self.address}: the server closed the line: {socket.close_reason}")

    async def send(self, message: FromClient) -> bool:
        """Whether it could be sent; what cannot be sent now is not sent later."""
        if self._socket is None:
            return False
        try:
            await self._socket.send(_encoder.encode(message).decode())
        except ConnectionClosed:
            return False
        return True

    def send_later(self, seconds: float, message: Callable[[], FromClient]) -> None:
        """Make and send a message when so much time has gone by, if this connection is still there."""
        task = asyncio.create_task(self._wait_and_send(seconds, message))
        self._later.add(task)
        task.add_done_callback(self._later.discard)

    async def _wait_and_send(self, seconds: float, message: Callable[[], FromClient]) -> None:
        await asyncio.sleep(seconds)
        await self.send(message())

    async def _connected(self) -> ClientConnection:
        waiting, until = 0.05, time.monotonic() + self.patience
        while True:
            try:
                socket = await connect(
                    self.address.replace("http", "ws", 1) + "/ws",
                    origin=Origin(self.address),
                    compression=None,
                    proxy=None,
                    ping_interval=None,
                    max_size=None,
                )
                self._socket = socket
                await self.send(Hello(token=self._token))
                return socket
            except (OSError, InvalidHandshake, TimeoutError) as error:
                if time.monotonic() > until:
                    reason = f"nobody answered for {self.patience:g} s"
                    raise LineError(f"{self.address}: {reason}: {error}") from None
            await asyncio.sleep(waiting)
            waiting = min(0.5, 1.5 * waiting)
