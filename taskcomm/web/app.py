"""The web application: the page's files, and the WebSocket that everything else goes over."""

import asyncio
import logging
import time
from collections.abc import AsyncIterator, Awaitable, Callable, MutableMapping
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any

import msgspec
from starlette.applications import Starlette
from starlette.routing import Mount, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

from taskcomm.web.client import REFUSED, Client
from taskcomm.web.house import House
from taskcomm.web.protocol import LONGEST, VERSION, Hello, Welcome, decode

log = logging.getLogger("taskcomm")
STATIC = Path(__file__).with_name("static")
HELLO_WITHIN = 5.0  # seconds
CONNECTIONS = 1024
HEADERS = {
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self';"
    " img-src 'self' data:; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-cache",
}

Scope = MutableMapping[str, Any]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]


class _Headers:
    """Adds HEADERS to every HTTP answer."""

    def __init__(self, app: Callable[[Scope, Receive, Send], Awaitable[None]]) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def with_headers(message: MutableMapping[str, Any]) -> None:
            if message["type"] == "http.response.start":
                added = [(name.encode(), value.encode()) for name, value in HEADERS.items()]
                message["headers"] = [*message.get("headers", []), *added]
            await send(message)

        await self._app(scope, receive, with_headers if scope["type"] == "http" else send)


def application(house: House, origins: frozenset[str]) -> Any:
    """The ASGI application of a study. A WebSocket is taken only with one of these Origins, exactly.

    There are at most CONNECTIONS of them, those included that have yet to say who they are.
    """
    open_sockets = 0

    @asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        beat = asyncio.create_task(house.beat())
        house.services.note("start", lockstep=house.timing.lockstep)
        yield
        beat.cancel()
        house.services.note("stop")

    async def connect(socket: WebSocket) -> None:
        nonlocal open_sockets
        if socket.headers.get("origin") not in origins or open_sockets >= CONNECTIONS:
            await socket.close(REFUSED)
            return
        open_sockets += 1
        try:
            await _serve(house, socket)
        finally:
            open_sockets -= 1

    routes = [WebSocketRoute("/ws", connect), Mount("/", StaticFiles(directory=STATIC, html=True))]
    return _Headers(Starlette(routes=routes, lifespan=lifespan))


async def _serve(house: House, socket: WebSocket) -> None:
    """One connection, from hello to its end."""
    await socket.accept()
    client = Client(socket)
    pump = asyncio.create_task(client.pump())
    try:
        if await _welcomed(house, client):
            await _listen(house, client)
    except WebSocketDisconnect:
        pass
    except Exception:
        log.exception("a connection of %s %s", client.role, client.name)
        client.drop(1011, "")
    finally:
        if client.role is not None:
            house.detach(client)
        client.drop(1000, "")
        with suppress(asyncio.TimeoutError):
            await asyncio.wait_for(pump, 2.0)


async def _welcomed(house: House, client: Client) -> bool:
    """Whether the first message is a hello with a token of this study."""
    try:
        hello = decode(await asyncio.wait_for(client.socket.receive_text(), HELLO_WITHIN))
    except (TimeoutError, msgspec.DecodeError, UnicodeError, KeyError):
        client.drop(REFUSED, "no hello")
        return False
    seat = house.folder.seat(hello.token) if isinstance(hello, Hello) else None
    if seat is None or not isinstance(hello, Hello) or hello.version != VERSION:
        client.drop(REFUSED, "unknown link" if seat is None else "another version; reload the page")
        return False
    client.send(
        Welcome(
            role=seat.role,
            title=house.design.title,
            name=seat.name,
            language=house.design.language,
            texts=house.folder.texts.interface,
            lockstep=house.timing.lockstep,
        )
    )
    house.attach(client, seat)
    return True


async def _listen(house: House, client: Client) -> None:
    """Every message, until the client goes or breaks a rule."""
    while client.closing is None:
        try:
            text = await client.socket.receive_text()
            message = decode(text)
        except (msgspec.DecodeError, UnicodeError, KeyError):
            client.drop(REFUSED, "not a message")
            return
        if len(text) > LONGEST or not (house.timing.lockstep or client.within_rate()):
            client.drop(REFUSED, "too much")
        elif isinstance(message, Hello):
            client.drop(REFUSED, "hello was said")
        else:
            client.heard = time.monotonic()
            await house.handle(client, message)
