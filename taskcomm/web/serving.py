"""Runs a study on a port."""

import asyncio
import gc
import logging
import resource
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import uvicorn

from taskcomm.web.app import application
from taskcomm.web.house import House
from taskcomm.web.protocol import LONGEST
from taskcomm.web.study.folder import StudyFolder

LOOPBACK = "127.0.0.1"
EVERYWHERE = ("0.0.0.0", "::")
FILES = 8192  # that may be open: every connection is one


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
    loopback = {"127.0.0.1", "localhost", "::1"}
    if host in EVERYWHERE:
        names = loopback | _own_addresses() | {socket.gethostname().lower()}
    else:
        names = loopback if host in loopback else {host.lower()}
    given = {f"http://{_bracketed(name)}" for name in names}
    return frozenset({f"{name}:{port}" for name in given} | (given if port == 80 else set()))


def _own_addresses() -> set[str]:
    """Addresses of this machine: those of its name, and those from which it would speak to others."""
    found = set[str]()
    with suppress(OSError):
        found |= {str(info[4][0]) for info in socket.getaddrinfo(socket.gethostname(), None)}
    for family, elsewhere in ((socket.AF_INET, "192.0.2.1"), (socket.AF_INET6, "2001:db8::1")):
        with suppress(OSError), socket.socket(family, socket.SOCK_DGRAM) as probe:
            probe.connect((elsewhere, 9))  # sends nothing: it finds the way, and so the own address
            found.add(str(probe.getsockname()[0]))
    return {address for address in found if "%" not in address}


def _bracketed(name: str) -> str:
    return f"[{name}]" if ":" in name else name


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
    asked, (host, port) = host, bound.getsockname()[:2]
    _allow_files(FILES)
    try:
        house = House.of(folder, processes=processes, lockstep=lockstep)
    except BaseException:
        bound.close()
        raise
    try:
        name = socket.gethostname() if host in EVERYWHERE else _bracketed(host)
        allowed = origins | origins_of(host, port) | origins_of(asked, port)
        with _terminated_as_interrupted():
            asyncio.run(_run(house, bound, f"http://{name}:{port}", allowed, ready, until))
    finally:
        house.close()


@contextmanager
def _terminated_as_interrupted() -> Iterator[None]:
    """SIGTERM ends this as Ctrl-C does: what waits is written first."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _allow_files(wanted: int) -> None:
    """Raise this process's limit of open files, as far as it may: idle connections must not stop a log."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    allowed = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
    if soft != resource.RLIM_INFINITY and soft < allowed:
        resource.setrlimit(resource.RLIMIT_NOFILE, (allowed, hard))


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
