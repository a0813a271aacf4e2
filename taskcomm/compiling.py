"""How kernels are compiled: once per machine, and whoever waits is told so."""

import logging
from collections.abc import Callable
from typing import Any

from numba import njit
from numba.core import event

log = logging.getLogger("taskcomm")


class _Announcer(event.Listener):
    """Logs the first compilation of each part; nothing is logged for what comes from the cache."""

    def __init__(self) -> None:
        self.parts: dict[str, str] = {}

    def on_start(self, event: Any) -> None:
        module = event.data["dispatcher"].py_func.__module__
        part = self.parts.pop(module, None)
        if part is not None:
            log.warning("compiling %s; this takes some seconds, once per machine", part)

    def on_end(self, event: Any) -> None:
        """Nothing to say."""


_announcer = _Announcer()
event.register("numba:compile", _announcer)  # type: ignore[no-untyped-call]


def kernel(module: str, part: str, **options: Any) -> Callable[[Any], Any]:
    """The decorator for the kernels of `module`, which make up `part` of the package.

    Compiled on first use, cached on disk where that can be written (elsewhere compiled in every
    process), without the interpreter's lock. `options` are further ones of numba's.
    """
    _announcer.parts[module] = part
    decorator: Callable[[Any], Any] = njit(cache=True, nogil=True, **options)
    return decorator
