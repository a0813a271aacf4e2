"""A server for one page: the page's own files, and a WebSocket whose other end is the test."""

import asyncio
import os
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
import uvicorn
from playwright.sync_api import Browser, Page
from starlette.applications import Starlette
from starlette.responses import Response
from starlette.routing import Mount, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import Scope
from starlette.websockets import WebSocket, WebSocketDisconnect

from taskcomm.web import protocol
from taskcomm.web.app import HEADERS, STATIC
from taskcomm.web.protocol import Frame, Role, ToClient, Welcome, encode
from taskcomm.web.serving import LOOPBACK, listening

LAPTOP = {"width": 1366, "height": 768}
LARGE = {"width": 2560, "height": 1440}


class _Files(StaticFiles):
    async def get_response(self, path: str, scope: Scope) -> Response:
        answer = await super().get_response(path, scope)
        answer.headers.update(HEADERS)
        return answer


class Stage:
    """The server's side of one page. `says` is said to each connection after its welcome."""

    def __init__(
        self, role: Role, says: Sequence[ToClient] = (), texts: dict[str, str] | None = None
    ) -> None:
        self.welcome = Welcome(role=role, title="A study", name="P01", language="en", texts=texts or {})
        self.says, self.address = list(says), ""
        self.heard: list[dict[str, Any]] = []
        self.connections = 0
        self.loop: asyncio.AbstractEventLoop | None = None
        self._socket: WebSocket | None = None

    async def serve(self, socket: WebSocket) -> None:
        await socket.accept()
        try:
            self.heard.append(msgspec.json.decode(await socket.receive_text()))
            await socket.send_text(encode(self.welcome).decode())
            for message in self.says:
                await socket.send_text(encode(message).decode())
            self._socket, self.loop = socket, asyncio.get_running_loop()
            self.connections += 1
            while True:
                text = await socket.receive_text()
                protocol.decode(text)  # whatever a page says is a message of the protocol
                self.heard.append(msgspec.json.decode(text))
        except WebSocketDisconnect:
            pass

    def say(self, *messages: ToClient) -> None:
        """Send these to the page."""
        for message in messages:
            assert self._socket is not None
            self._wait(self._socket.send_text(encode(message).decode()))

    def drop(self, code: int = 1001) -> None:
        """Close the connection."""
        assert self._socket is not None
        self._wait(self._socket.close(code))

    def _wait(self, doing: Any) -> None:
        assert self.loop is not None
        asyncio.run_coroutine_threadsafe(doing, self.loop).result(5)

    def of(self, kind: str) -> list[dict[str, Any]]:
        """What the page said of this type."""
        return [message for message in self.heard if message["type"] == kind]

    def until(self, kind: str, count: int = 1, seconds: float = 5.0) -> list[dict[str, Any]]:
        """What the page said of this type, once it did so `count` times."""
        end = time.monotonic() + seconds
        while len(self.of(kind)) < count:
            assert time.monotonic() < end, f"{len(self.of(kind))} of {count} {kind} in {self.heard}"
            time.sleep(0.01)
        return self.of(kind)

    def until_connected(self, count: int, seconds: float = 8.0) -> None:
        """Wait for the page's connection number `count`."""
        end = time.monotonic() + seconds
        while self.connections < count:
            assert time.monotonic() < end, f"{self.connections} connections, not {count}"
            time.sleep(0.01)


@contextmanager
def served(stage: Stage) -> Iterator[Stage]:
    """Serve it on a free port of this machine."""
    routes = [WebSocketRoute("/ws", stage.serve), Mount("/", _Files(directory=STATIC, html=True))]
    config = uvicorn.Config(
        Starlette(routes=routes), log_level="error", ws="websockets-sansio", lifespan="off"
    )
    server, bound = uvicorn.Server(config), listening(LOOPBACK, 0)
    stage.address = f"http://{LOOPBACK}:{bound.getsockname()[1]}"
    thread = threading.Thread(target=server.run, kwargs={"sockets": [bound]})
    thread.start()
    try:
        yield stage
    finally:
        server.should_exit = server.force_exit = True
        thread.join(10)


@contextmanager
def visit(browser: Browser, link: str, size: dict[str, int] = LAPTOP, **context: Any) -> Iterator[Page]:
    """A browser of its own at `link`; an error in the page's console fails the test."""
    troubles: list[str] = []
    within = browser.new_context(viewport=size, **context)  # type: ignore[arg-type]
    page = within.new_page()
    page.on("pageerror", lambda error: troubles.append(str(error)))
    page.on("console", lambda line: troubles.append(line.text) if line.type == "error" else None)
    page.goto(link)
    try:
        yield page
    finally:
        within.close()
    lost = ("WebSocket connection to", "ERR_CONNECTION")
    assert [text for text in troubles if not any(part in text for part in lost)] == []


@contextmanager
def opened(
    browser: Browser, stage: Stage, *, size: dict[str, int] = LAPTOP, **context: Any
) -> Iterator[Page]:
    """The page of `stage` in a browser, where nothing glides."""
    with visit(browser, f"{stage.address}/#token", size, **({"reduced_motion": "reduce"} | context)) as page:
        yield page


def frame(t: int = 0, **changed: Any) -> Frame:
    """A frame of three balls and four distances, with `changed` fields."""
    plain: dict[str, Any] = {
        "t": t,
        "balls": 3,
        "distances": 4,
        "lit": [],
        "held": 0,
        "placements": [],
        "slid": [],
        "final": [],
        "count": 0,
        "state": "run",
        "action": "noa",
    }
    return Frame(**(plain | changed))


def picture(page: Page, folder: Path, name: str) -> Path:
    """A screenshot, in the folder named by TASKCOMM_ARTEFACTS, else in `folder`."""
    kept = Path(os.environ.get("TASKCOMM_ARTEFACTS") or folder)
    kept.mkdir(parents=True, exist_ok=True)
    path = kept / f"{name}.png"
    page.screenshot(path=path)
    return path
