"""Where the starts of a fit have ended: on one hill, or on several."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from learn.coordinates import Coordinates
from learn.mstep import Objective
from learn.path import Path
from learn.statistics import settle
from taskcomm.lattice import Floats

DIP = 0.1
BETWEEN = 8


class Ending(NamedTuple):
    """Where one start ended, EM and its own climb done, beside the result of the fit.

    `below` is how many nats the objective is lower, `distance` the greatest difference of a coordinate
    (log odds, logarithms of times, seconds of delay) and `along` which one it is; `basin` 0 is that of
    the result.
    """

    start: str
    log_likelihood: float
    below: float
    distance: float
    along: str
    basin: int


def endings(
    objective: Objective, paths: Sequence[Path], best: Floats, labels: Sequence[str]
) -> tuple[Ending, ...]:
    """The ends of the starts' own climbs beside the result `best`; `labels` name the coordinates.

    From the highest end down, each belongs to the first basin to whose highest point a straight way leads
    on which the objective never falls more than DIP nats below that end; else it is one of its own.
    Before they are compared, what the data do not move is put back to where it was in all of them. Where
    an observation model is learned, each end has its own, and ways between them that of the result.
    """
    top, tops = objective.value(best), [best]
    ends, values, likelihoods = [], [], []
    kept = None if objective.observing is None else objective.observing.observation
    for path in paths:
        path.resume(objective)
        ends.append(settle(objective, path.point if path.ended is None else path.ended))
        values.append(objective.value(ends[-1]))
        likelihoods.append(values[-1] - objective.log_prior(objective.space.vector(ends[-1])))
    if objective.observing is not None and kept is not None:
        objective.observing.set(kept)
    basin = [0] * len(ends)
    for number in sorted(range(len(ends)), key=lambda number: -values[number]):
        end, floor = ends[number], min(values[number], objective.value(ends[number])) - DIP
        found = (b for b, other in enumerate(tops) if _no_dip(objective, end, other, floor))
        basin[number] = next(found, len(tops))
        if basin[number] == len(tops):
            tops.append(end)
    result = []
    for number, path in enumerate(paths):
        away, below = np.abs(ends[number] - best), max(0.0, top - values[number])
        along = labels[int(away.argmax())] if away.any() else ""
        far = float(away.max(initial=0.0))
        result.append(Ending(path.name, likelihoods[number], below, far, along, basin[number]))
    return tuple(result)


def _no_dip(objective: Objective, start: Floats, end: Floats, floor: float) -> bool:
    """Whether the objective stays at `floor` or above on the straight way between two points."""
    shares = (np.arange(BETWEEN) + 1) / (BETWEEN + 1)
    return all(objective.value(start + share * (end - start)) >= floor for share in shares)


def labels_of(space: Coordinates, names: Sequence[str]) -> tuple[str, ...]:
    """What the coordinates are called: `log odds of mistake`, `log that_mov.rise`, `that_mov.delay`, ...

    `names` are those of the natural parameters; a shared parameter is `log decay` alone.
    """
    labels = []
    for kind, members in zip(space.kinds, space.members, strict=True):
        name = names[int(members[0])] if len(members) == 1 else f"shared {kind}"
        prefix = {"odds": "log odds of ", "delay": "", "hold": ""}.get(kind, "log ")
        labels.append(prefix + name)
    return tuple(labels)
