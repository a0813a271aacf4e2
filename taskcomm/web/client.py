"""One browser at the other end of a WebSocket: what is sent to it, how fast it may send, its clock."""

import asyncio
import time
from collections import deque
from contextlib import suppress
from dataclasses import dataclass, field

from starlette.websockets import WebSocket, WebSocketDisconnect

from taskcomm.web.protocol import Ping, Pong, Role, ToClient, encode

RATE, BURST = 40.0, 120.0  # messages a second that a client may send, and at once
_WAITING = 512  # messages that may wait for a slow client
REPLACED, REFUSED = 4000, 4003  # close codes: another tab took over; the client broke the rules


@dataclass(slots=True)
class Link:
    """Round-trip time and offset of a client's clock, in ms: what the quickest of the last pings says."""

    samples: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=16))
    _sent: dict[int, tuple[float, float]] = field(default_factory=dict)
    _count: int = 0

    def ping(self) -> Ping:
        """The next ping."""
        self._count += 1
        self._sent[self._count] = time.monotonic(), time.time()
        self._sent.pop(self._count - 8, None)
        return Ping(n=self._count)

    def pong(self, pong: Pong) -> bool:
        """Take in the answer; False where that ping was never sent, or answered before.

        An answer that comes after the next eight pings is too old to say anything: it is let pass.
        """
        if 0 < pong.n <= self._count - 8:
            return True
        if pong.n not in self._sent:
            return False
        sent, sent_utc = self._sent.pop(pong.n)
        rtt = 1e3 * (time.monotonic() - sent)
        self.samples.append((rtt, pong.at - (1e3 * sent_utc + rtt / 2)))
        return True

    @property
    def best(self) -> tuple[float, float] | None:
        """Round-trip time, and client's clock minus server's; None before the first answer."""
        return min(self.samples, default=None)

    def fields(self) -> dict[str, float]:
        """Both, for a log."""
        best = self.best
        return {} if best is None else {"rtt_ms": round(best[0], 3), "offset_ms": round(best[1], 3)}


class Client:
    """A connection that has said hello, or has yet to."""

    def __init__(self, socket: WebSocket) -> None:
        self.socket = socket
        self.role: Role | None = None
        self.name = ""
        self.link = Link()
        self.presses = 0
        self.watched: str | None = None
        self.closing: tuple[int, str] | None = None
        self.heard = time.monotonic()
        self._outbox: asyncio.Queue[bytes | None] = asyncio.Queue(_WAITING)
        self._allowed, self._then = BURST, time.monotonic()

    @property
    def silent(self) -> float:
        """Seconds since the last message from it."""
        return time.monotonic() - self.heard

    def send(self, message: ToClient) -> None:
        """Queue a message; a client too slow to take them is dropped."""
        if self.closing is None:
            try:
                self._outbox.put_nowait(encode(message))
            except asyncio.QueueFull:
                self.drop(REFUSED, "too slow")

    def acknowledge(self, done: "asyncio.Future[None]", message: ToClient) -> None:
        """Send `message` when `done` is, unless it failed."""

        def say(future: "asyncio.Future[None]") -> None:
            if not future.cancelled() and future.exception() is None:
                self.send(message)

        done.add_done_callback(say)

    def drop(self, code: int, reason: str) -> None:
        """Close, once what was queued has gone out (where there is room for more)."""
        if self.closing is None:
            self.closing = code, reason
            with suppress(asyncio.QueueFull):
                self._outbox.put_nowait(None)

    def within_rate(self) -> bool:
        """Count one message that came; False where there are too many."""
        now = time.monotonic()
        self._allowed = min(BURST, self._allowed + RATE * (now - self._then)) - 1.0
        self._then = now
        return self._allowed >= 0

    async def pump(self) -> None:
        """Send what is queued until the connection is closed."""
        with suppress(WebSocketDisconnect, RuntimeError, OSError):
            while (content := await self._outbox.get()) is not None:
                await self.socket.send_text(content.decode())
                if self.closing is not None and self._outbox.empty():
                    break
            code, reason = self.closing or (1000, "")
            await self.socket.close(code, reason)
