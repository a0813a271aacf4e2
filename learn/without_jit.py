"""Loading pomegranate in less time."""

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any


@contextmanager
def without_jit() -> Iterator[None]:
    """numba's JIT switched off within, and afterwards as it was: imports that would compile do not."""
    config: Any = import_module("numba").config
    compiling = config.DISABLE_JIT
    config.DISABLE_JIT = True
    try:
        yield
    finally:
        config.DISABLE_JIT = compiling
