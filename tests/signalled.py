"""Teachers who show more than a key: random observation models, and one with a gaze."""

from dataclasses import replace
from typing import Any

import numpy as np
from hypothesis import strategies as st

from taskcomm.channels import NormalChannel, ObservationModel, PlainChannel, TargetChannel
from taskcomm.observation import Signals
from taskcomm.teacher import TeacherModel

ROLES = ("mov", "wrt", "other", "none")
FACES = ("smile", "frown")


def _distribution(names: tuple[str, ...]) -> st.SearchStrategy[dict[str, float]]:
    counts = st.tuples(*(st.integers(1, 9) for _ in names))
    return counts.map(lambda parts: dict(zip(names, (n / sum(parts) for n in parts), strict=True)))


@st.composite
def observation_models(
    draw: st.DrawFn, model: TeacherModel, numbers: bool = True, key: bool = True
) -> ObservationModel:
    """A key that may err, a face, a gaze, an angle of the gaze and a loudness; each may be missing."""
    states = model.mental_states
    reals, widths = st.floats(-2, 2), st.floats(0.5, 2)
    channels: dict[str, Any] = {}
    if draw(st.booleans()):
        channels["face"] = PlainChannel({state: draw(_distribution(FACES)) for state in states})
    if draw(st.booleans()):
        channels["gaze"] = TargetChannel({state: draw(_distribution(ROLES)) for state in states})
        if numbers and draw(st.booleans()):
            measured = ROLES[: draw(st.integers(3, 4))]
            mean = {state: {role: draw(reals) for role in measured} for state in states}
            sd = {state: {role: draw(widths) for role in measured} for state in states}
            channels["angle"] = NormalChannel(mean, sd, target="gaze")
    if numbers and draw(st.booleans()):
        mean_of, sd_of = {s: draw(reals) for s in states}, {s: draw(widths) for s in states}
        channels["loudness"] = NormalChannel(mean_of, sd_of)
    errors = st.sampled_from([0.0, 0.05, 0.3]) if key else st.just(0.0)
    return ObservationModel(draw(errors), draw(errors), channels)


@st.composite
def signals_of(draw: st.DrawFn, seen: ObservationModel, num_balls: int) -> Signals | None:
    """What may be observed in a step beside the key; any of it may be missing."""
    values: dict[str, st.SearchStrategy[Any]] = {
        "face": st.sampled_from(FACES),
        "gaze": st.sampled_from([*map(str, range(1, num_balls + 1)), "none"]),
        "angle": st.floats(-2, 2),
        "loudness": st.floats(-2, 2),
    }
    return {name: draw(values[name]) for name in seen.channels if draw(st.booleans())} or None


def gazing(miss: float = 0.0, false_press: float = 0.0, model: TeacherModel | None = None) -> TeacherModel:
    """The intuitive teacher (or `model`), who looks at what is approved of, and now and then elsewhere."""
    model = TeacherModel.intuitive() if model is None else model
    idle = dict(zip(ROLES, (0.2, 0.15, 0.15, 0.5), strict=True))
    table = dict.fromkeys(model.mental_states, idle) | {
        "that_mov": dict(zip(ROLES, (0.7, 0.1, 0.1, 0.1), strict=True)),
        "that_wrt": dict(zip(ROLES, (0.2, 0.6, 0.1, 0.1), strict=True)),
        "that_dist": dict(zip(ROLES, (0.5, 0.3, 0.1, 0.1), strict=True)),
    }
    return replace(model, observation=ObservationModel(miss, false_press, {"gaze": TargetChannel(table)}))


def total_variation(one: Any, other: Any) -> float:
    return float(np.abs(np.asarray(one) - np.asarray(other)).sum() / 2)
