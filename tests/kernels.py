"""Kernels that are compiled for other kernels only, for tests to call."""

from typing import Any

from numba import njit


def outside(kernel: Any) -> Any:
    """The kernel, as Python can call it."""

    @njit(error_model="numpy")
    def call(*arguments: Any) -> Any:
        return kernel(*arguments)

    return call
