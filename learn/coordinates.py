"""A teacher model as a vector: natural parameters, and free coordinates that cannot leave the model."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from taskcomm.lattice import Bools, Extent, Floats
from taskcomm.teacher import Parameters, TeacherModel

NAMES = ("peak", "rise", "fall", "delay")
LEAST_ODDS = 1e-8


@dataclass(frozen=True)
class Bounds:
    """How long rise and fall (from one step) and delay (from 0) may become, in seconds.

    An initial model beyond them widens them to itself. Shorter bounds make a long trial's lattice
    smaller.
    """

    rise: float = 10.0
    fall: float = 10.0
    delay: float = 2.0

    def __post_init__(self) -> None:
        for name in ("rise", "fall", "delay"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise ValueError(f"bounds.{name}: must be a positive number of seconds")


def names_of(states: Sequence[str]) -> tuple[str, ...]:
    """Names of the natural parameters, in the order of every vector of them.

    >>> names_of(["that_mov"])
    ('mistake', 'that_mov.peak', 'that_mov.rise', 'that_mov.fall', 'that_mov.delay')
    """
    return ("mistake", *(f"{state}.{name}" for name in NAMES for state in states))


def vector_of(model: TeacherModel) -> Floats:
    """mistake, then the peaks, rises, falls and delays of the approval states: shape (1 + 4 M,)."""
    tops = model.approvals.values()
    return np.array([model.mistake, *(getattr(top, name) for name in NAMES for top in tops)])


def model_at(vector: Floats, model: TeacherModel) -> TeacherModel:
    """`model` with the natural parameters of `vector`; what else it has stays."""
    rows = vector[1:].reshape(4, -1)
    tops = {
        state: replace(
            top,
            peak=float(rows[0, m]),
            rise=float(rows[1, m]),
            fall=float(rows[2, m]),
            delay=float(rows[3, m]),
        )
        for m, (state, top) in enumerate(model.approvals.items())
    }
    return replace(model, mistake=float(vector[0]), approvals=tops)


def parameters_at(vector: Floats, base: Parameters) -> Parameters:
    """`base` with the natural parameters of `vector`, as arrays."""
    peak, rise, fall, delay = vector[1:].reshape(4, -1)
    late = delay / base.dt
    whole = np.floor(late + 1e-9)
    return replace(
        base,
        mistake=float(vector[0]),
        peak=peak,
        rise=rise,
        fall=fall,
        steps_late=whole.astype(np.int64),
        part_late=np.maximum(late - whole, 0.0),
    )


class Coordinates:
    """The free coordinates of a model: log odds against waiting, log rise, log fall, delay.

    mistake and the free peaks are a softmax beside waiting, so they never sum to 1; `free` (1 + 4 M,)
    says which natural parameters may move, and the others stay where `start` has them. `least` and
    `most` bound the coordinates.

    >>> model = TeacherModel.intuitive()
    >>> space = Coordinates(model, Bounds(), free=np.ones(13, dtype=np.bool_))
    >>> vector = vector_of(model)
    >>> bool(np.allclose(space.vector(space.point(vector)), vector))
    True
    """

    def __init__(self, model: TeacherModel, bounds: Bounds, free: Bools) -> None:
        self.base, self.free, self.dt = vector_of(model), free, model.dt
        states = len(model.approvals)
        self.odds = np.flatnonzero(free[: 1 + states])
        self.times = 1 + states + np.flatnonzero(free[1 + states : 1 + 3 * states])
        self.delays = 1 + 3 * states + np.flatnonzero(free[1 + 3 * states :])
        fixed = np.setdiff1d(np.arange(1 + states), self.odds)
        self.room = 1.0 - self.base[fixed].sum()
        longest = np.concatenate([np.full(states, bounds.rise), np.full(states, bounds.fall)])
        longest = np.maximum(longest, self.base[1 + states : 1 + 3 * states])
        self.longest = longest
        self.latest = np.maximum(np.full(states, bounds.delay), self.base[1 + 3 * states :])
        least_odds, most_odds = math.log(LEAST_ODDS), -math.log(LEAST_ODDS)
        self.least = np.concatenate(
            [
                np.full(len(self.odds), least_odds),
                np.full(len(self.times), math.log(self.dt)),
                np.zeros(len(self.delays)),
            ]
        )
        self.most = np.concatenate(
            [
                np.full(len(self.odds), most_odds),
                np.log(longest[self.times - 1 - states]),
                self.latest[self.delays - 1 - 3 * states],
            ]
        )

    def extent(self, base: Parameters) -> Extent:
        """The lattice extent that holds every point of the space."""
        states, now = len(base.peak), Extent.of(base)
        free = self.free[1:].reshape(4, states)
        rise, fall = self.longest.reshape(2, states)
        most = np.ceil(self.latest / self.dt - 1e-9).astype(np.int64)
        return replace(
            now,
            rise=np.where(free[1], rise, now.rise),
            fall=np.where(free[2], fall, now.fall),
            least_late=np.where(free[3], 0, now.least_late),
            most_late=np.where(free[3], most, now.most_late),
        )

    @property
    def index(self) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        """Which natural parameter each coordinate moves."""
        return np.concatenate([self.odds, self.times, self.delays])

    def point(self, vector: Floats) -> Floats:
        """The coordinates of natural parameters, moved to the nearest bound where beyond it."""
        waiting = self.room - vector[self.odds].sum()
        with np.errstate(divide="ignore"):
            odds = np.log(vector[self.odds] / waiting)
        point = np.concatenate([odds, np.log(vector[self.times]), vector[self.delays]])
        return np.asarray(np.clip(point, self.least, self.most), dtype=np.float64)

    def vector(self, point: Floats) -> Floats:
        """The natural parameters at a point; rise and fall never below one step, for rounding."""
        vector, a = self.base.copy(), len(self.odds)
        if a:
            top = max(0.0, float(point[:a].max()))
            odds = np.exp(point[:a] - top)
            vector[self.odds] = self.room * odds / (math.exp(-top) + odds.sum())
        b = a + len(self.times)
        vector[self.times] = np.maximum(np.exp(point[a:b]), self.dt)
        vector[self.delays] = point[b:]
        return vector

    def rates(self, vector: Floats, rates: Floats) -> Floats:
        """Rates in the coordinates from the rates in the natural parameters at `vector`."""
        p = vector[self.odds]
        mean = float(p @ rates[self.odds]) / self.room
        return np.concatenate(
            [p * (rates[self.odds] - mean), vector[self.times] * rates[self.times], rates[self.delays]]
        )
