# mypy: disable-error-code="no-untyped-call"
"""How kernels are compiled: once per machine, and whoever waits is told so."""

import hashlib
import logging
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from numba import njit
from numba.core import event
from numba.core.caching import FunctionCache

log = logging.getLogger("taskcomm")

_ONCE = "once per machine"
_AGAIN = "in every process, since no folder to keep it in can be written; NUMBA_CACHE_DIR may name one"


class _Announcer(event.Listener):
    """Logs the first compilation of each part; nothing is logged for what comes from the cache."""

    def __init__(self) -> None:
        self.parts: dict[str, str] = {}
        self.said: set[str] = set()

    def on_start(self, event: Any) -> None:
        dispatcher = event.data["dispatcher"]
        part = self.parts.pop(dispatcher.py_func.__module__, None)
        if part is not None:
            kept = isinstance(dispatcher._cache, _Cache)
            log.warning("compiling %s; this may take a minute, %s", part, _ONCE if kept else _AGAIN)

    def on_end(self, event: Any) -> None:
        """Nothing to say."""

    def once(self, problem: str, folder: str, error: Exception) -> None:
        """Log what is wrong with a folder of compiled code, if that was not said before."""
        if folder not in self.said:
            self.said.add(folder)
            log.warning("%s (%s: %s)", problem, folder, error)


_announcer = _Announcer()
event.register("numba:compile", _announcer)


@cache
def _sources(folder: Path) -> str:
    """A digest of all kernels in a folder (`_*.py`): a kernel is compiled together with those it calls."""
    digest = hashlib.sha256()
    for path in sorted(folder.glob("_[a-z]*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()


class _Cache(FunctionCache):
    """numba's cache of one function, that is done without where it cannot be read or written.

    numba makes a function anew when its own file changes; here a change of any kernel beside it counts too.
    """

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        return *super()._index_key(sig, codegen), _sources(Path(self._py_func.__code__.co_filename).parent)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(sig, target_context)
        except OSError:
            return None  # nothing there; whether something can be put there, saving will tell
        except Exception as error:  # whatever a damaged file makes of pickle
            _announcer.once("damaged compiled code is made anew", self.cache_path, error)
            with suppress(OSError):
                self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        try:
            super().save_overload(sig, data)
        except Exception as error:  # a full disk, a folder that is gone, an index that cannot be read
            _announcer.once(
                "compiled code cannot be kept, and is made anew in every process; NUMBA_CACHE_DIR may name"
                " a folder that can be written",
                self.cache_path,
                error,
            )


def kernel(module: str, part: str, **options: Any) -> Callable[[Any], Any]:
    """The decorator for the kernels of `module`, which make up `part` of the package.

    Compiled on first use without the interpreter's lock; cached on disk where that can be written, by
    numba's rules (NUMBA_CACHE_DIR, beside the module, the user's cache folder), elsewhere compiled in every
    process. Either way the first compilation is logged, and trouble with the cache is never an error.
    `options` are further ones of numba's.
    """
    _announcer.parts[module] = part

    def compiled(function: Any) -> Any:
        dispatcher = njit(nogil=True, **options)(function)
        if hasattr(dispatcher, "_cache"):  # not so where NUMBA_DISABLE_JIT leaves the function as it is
            with suppress(RuntimeError):  # numba found no folder it can write
                dispatcher._cache = _Cache(function)
        return dispatcher

    return compiled
