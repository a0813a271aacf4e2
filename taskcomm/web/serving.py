"""Runs a study on a port."""

import asyncio
import gc
import logging
import socket
from collections.abc import Callable

import uvicorn

from taskcomm.web.app import application
from taskcomm.web.house import House
from taskcomm.web.protocol import LONGEST
from taskcomm.web.study.folder import StudyFolder

LOOPBACK = "127.0.0.1"


class AddressInUse(OSError):
    """The address cannot be listened on; the message says which and why."""


def listening(host: str, port: int) -> socket.socket:
    """A socket that is bound; port 0 takes a free one. Raises AddressInUse."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    bound = socket.socket(family, socket.SOCK_STREAM)
    bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        bound.bind((host, port))
    except OSError as error:
        bound.close()
        raise AddressInUse(f"cannot listen on {host}:{port}: {error.strerror or error}") from None
    return bound


def origins_of(host: str, port: int) -> frozenset[str]:
    """Where pages of a server bound to `host` come from: its own address, by every name it has here."""
    loopback = {"127.0.0.1", "localhost", "[::1]"}
    if host in ("0.0.0.0", "::"):
        own = {info[4][0] for info in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)}
        names = loopback | {str(address) for address in own} | {socket.gethostname()}
    elif host in ("127.0.0.1", "localhost", "::1"):
        names = loopback
    else:
        names = {f"[{host}]" if ":" in host else host}
    return frozenset(f"http://{name}:{port}" for name in names)


def serve(
    folder: StudyFolder,
    *,
    host: str = LOOPBACK,
    port: int = 0,
    bound: socket.socket | None = None,
    lockstep: bool = False,
    processes: int = 1,
    origins: frozenset[str] = frozenset(),
    ready: Callable[[str], None] | None = None,
    until: Callable[[House], bool] | None = None,
) -> None:
    """Serve a study until interrupted, or until `until(house)`, asked ten times a second, is true.

    It listens on host and port (0: a free one), or on a socket that is `bound` already.
    Pages may come from the server's own address, and from `origins` (where a proxy gives it another name).
    `ready` is called with the server's address (`http://127.0.0.1:8000`) when it can be used. Everything is
    on disk when this returns.
    """
    bound = bound or listening(host, port)
    host, port = bound.getsockname()[:2]
    house = House.of(folder, processes=processes, lockstep=lockstep)
    try:
        name = f"[{host}]" if ":" in host else socket.gethostname() if host == "0.0.0.0" else host
        allowed = origins | origins_of(host, port)
        asyncio.run(_run(house, bound, f"http://{name}:{port}", allowed, ready, until))
    finally:
        house.close()


async def _run(
    house: House,
    bound: socket.socket,
    address: str,
    origins: frozenset[str],
    ready: Callable[[str], None] | None,
    until: Callable[[House], bool] | None,
) -> None:
    config = uvicorn.Config(
        application(house, origins),
        log_level=logging.WARNING,
        access_log=False,
        ws="websockets-sansio",
        ws_max_size=LONGEST,
        ws_ping_interval=10.0,
        ws_ping_timeout=10.0,
        ws_per_message_deflate=False,
        server_header=False,
        proxy_headers=False,
        timeout_graceful_shutdown=3,
    )
    server = uvicorn.Server(config)
    gc.collect()
    gc.freeze()  # what is there now stays: no collection during a trial need look at it
    running = asyncio.create_task(server.serve(sockets=[bound]))
    while not server.started and not running.done():
        await asyncio.sleep(0.02)
    if ready is not None and server.started:
        ready(address)
    while not running.done():
        if until is not None and until(house):
            server.should_exit = True
        await asyncio.wait({running}, timeout=0.1)
    await running
