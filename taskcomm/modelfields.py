"""What the fields of a teacher model may be, and the error that names the one that is wrong."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np


class ModelError(ValueError):
    """A teacher model that cannot be; the message names the field."""


def number(name: str, value: Any, above: bool = False) -> float:
    """`value` as a finite float of at least 0, or above it."""
    result = real(name, value, "finite and " + ("above 0" if above else "at least 0"))
    if result < 0 or (above and result == 0):
        raise ModelError(f"{name}: must be finite and {'above' if above else 'at least'} 0, not {value!r}")
    return result


def real(name: str, value: Any, wanted: str = "finite") -> float:
    """`value` as a finite float, -0.0 as 0.0."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise ModelError(f"{name}: must be a number, not {value!r}")
    try:
        result = float(value) + 0.0
    except OverflowError:
        result = math.inf
    if not math.isfinite(result):
        raise ModelError(f"{name}: must be {wanted}, not {value!r}")
    return result


def probability(name: str, value: Any) -> float:
    """`value` as a probability below 1."""
    result = number(name, value)
    if result >= 1:
        raise ModelError(f"{name}: must be below 1, not {result:g}")
    return result


def mapping(name: str, value: Any) -> dict[str, Any]:
    """`value` as a dictionary by names, at least one."""
    if not isinstance(value, Mapping) or not value:
        raise ModelError(f"{name}: must hold at least one field by its name, not {value!r}")
    for key in value:
        if not isinstance(key, str) or not key:
            raise ModelError(f"{name}: {key!r} cannot be a name")
    return dict(value)


def distribution(name: str, value: Any) -> dict[str, float]:
    """`value` as probabilities by names that sum to 1."""
    result = {key: number(f"{name}.{key}", p) for key, p in mapping(name, value).items()}
    if abs(math.fsum(result.values()) - 1) > 1e-9:
        raise ModelError(f"{name}: must sum to 1, not {math.fsum(result.values()):.10g}")
    return result
