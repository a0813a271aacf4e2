"""The levels of the table-tops over one time step (MODEL.md, section 3), on arrays."""

import numpy as np
from numpy.typing import NDArray

from taskcomm.teacher import Parameters

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


def _move(level: Floats, on: Bools, seconds: Floats, parameters: Parameters) -> Floats:
    slope = np.where(on, seconds / parameters.rise, -seconds / parameters.fall)
    return np.minimum(1.0, np.maximum(0.0, level + slope))


def advance(
    level: Floats, on_time: Floats, older: Bools, newer: Bools, parameters: Parameters
) -> tuple[Floats, Floats]:
    """Levels and on-times at the end of a step, all of shape (..., M).

    `older` and `newer` are the cues as seen late: c[t - n - 1], for the first `part_late` of the
    step, and c[t - n], for the rest of it. `on_time` is q: seconds the late cue has been on
    without a break.
    """
    first = parameters.part_late * parameters.dt
    last = parameters.dt - first
    if first.any():
        level = _move(level, older, first, parameters)
        on_time = (on_time + first) * older
    return _move(level, newer, last, parameters), (on_time + last) * newer


def approval_probability(level: Floats, on_time: Floats, resting: bool, parameters: Parameters) -> Floats:
    """P(M_t = m) for each approval state, shape (..., M)."""
    if resting:
        return np.zeros_like(level)
    probability = parameters.peak * level
    if parameters.decays:
        late = np.maximum(0.0, on_time - parameters.hold)
        probability = probability * np.exp(-late / parameters.decay)
    return probability
