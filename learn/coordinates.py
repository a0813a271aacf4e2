"""A teacher model as a vector: natural parameters, and free coordinates that cannot leave the model."""

import math
from collections.abc import Collection, Sequence, Sized
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from taskcomm.lattice import Bools, Extent, Floats
from taskcomm.teacher import Parameters, TeacherModel

NAMES = ("peak", "rise", "fall", "delay", "decay", "hold")
LOGARITHMIC = ("rise", "fall", "decay")
LEAST_ODDS = 1e-8


@dataclass(frozen=True)
class Bounds:
    """How long rise, fall, decay (each from one step), delay and hold (from 0) may become, in seconds.

    An initial model beyond them widens them to itself. Shorter bounds make a long trial's lattice
    smaller.
    """

    rise: float = 10.0
    fall: float = 10.0
    delay: float = 2.0
    decay: float = 60.0
    hold: float = 5.0

    def __post_init__(self) -> None:
        for name in NAMES[1:]:
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise ValueError(f"bounds.{name}: must be a positive number of seconds")


def names_of(states: Sequence[str]) -> tuple[str, ...]:
    """Names of the natural parameters, in the order of every vector of them.

    >>> names_of(["that_mov"])[:4]
    ('mistake', 'that_mov.peak', 'that_mov.rise', 'that_mov.fall')
    """
    return ("mistake", *(f"{state}.{name}" for name in NAMES for state in states))


def states_of(vector: Sized) -> int:
    """How many approval states a vector of natural parameters is of."""
    return (len(vector) - 1) // len(NAMES)


def vector_of(model: TeacherModel) -> Floats:
    """mistake, then the peaks, rises, falls, delays, decays and holds of the approval states.

    Shape (1 + 6 M,); a table-top without decay has an infinite one.
    """
    tops = model.approvals.values()
    values = [getattr(top, name) for name in NAMES for top in tops]
    return np.array([model.mistake, *(math.inf if value is None else value for value in values)])


def model_at(vector: Floats, model: TeacherModel) -> TeacherModel:
    """`model` with the natural parameters of `vector`; what else it has stays."""
    rows = vector[1:].reshape(len(NAMES), -1)
    tops = {}
    for m, (state, top) in enumerate(model.approvals.items()):
        values: dict[str, Any] = {name: float(rows[k, m]) for k, name in enumerate(NAMES)}
        values["decay"] = values["decay"] if math.isfinite(values["decay"]) else None
        tops[state] = replace(top, **values)
    return replace(model, mistake=float(vector[0]), approvals=tops)


def parameters_at(vector: Floats, base: Parameters) -> Parameters:
    """`base` with the natural parameters of `vector`, as arrays."""
    peak, rise, fall, delay, decay, hold = vector[1:].reshape(len(NAMES), -1)
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
        decay=decay,
        hold=hold,
        decays=bool(np.isfinite(decay).any()),
    )


class Coordinates:
    """The free coordinates of a model: log odds against waiting, log rise, log fall, delay, log decay, hold.

    mistake and the free peaks are a softmax beside waiting, so they never sum to 1; `free` (1 + 6 M,)
    says which natural parameters may move, and the others stay where `model` has them. Those named in
    `shared` ("delay", "decay", ...) are one coordinate for all the approval states that are free in them.
    `least` and `most` bound the coordinates; `kinds` (coordinates,) names what each is of, `index` the
    (first) natural parameter that it moves, `members` all of them.

    >>> model = TeacherModel.intuitive()
    >>> space = Coordinates(model, Bounds(), free=np.arange(19) < 13)
    >>> vector = vector_of(model)
    >>> bool(np.allclose(space.vector(space.point(vector)), vector))
    True
    """

    def __init__(
        self, model: TeacherModel, bounds: Bounds, free: Bools, shared: Collection[str] = ()
    ) -> None:
        self.base, self.free, self.dt = vector_of(model), free, model.dt
        states = len(model.approvals)
        self.states = states
        self.odds = np.flatnonzero(free[: 1 + states])
        fixed = np.setdiff1d(np.arange(1 + states), self.odds)
        self.room = 1.0 - self.base[fixed].sum()
        self.longest = np.full(len(free), math.inf)
        groups, kinds = [], ["odds"] * len(self.odds)
        for k, name in enumerate(NAMES[1:], start=1):
            rows = slice(1 + k * states, 1 + (k + 1) * states)
            given = np.where(np.isfinite(self.base[rows]), self.base[rows], 0.0)
            self.longest[rows] = np.maximum(getattr(bounds, name), given)
            moving = rows.start + np.flatnonzero(free[rows])
            parts = [moving] if name in shared else [np.array([i]) for i in moving]
            groups += [part for part in parts if len(part)]
            kinds += [name] * (len(groups) + len(self.odds) - len(kinds))
        self.members = (*(np.array([i]) for i in self.odds), *groups)
        self.kinds = tuple(kinds)
        self.index = np.array([group[0] for group in self.members], dtype=np.int64)
        self._rest = np.concatenate([[0], *groups]).astype(np.int64)[1:]
        self._owner = np.repeat(np.arange(len(groups)), [len(group) for group in groups])
        self._log = np.isin(self.kinds[len(self.odds) :], LOGARITHMIC)
        most = np.array([self.longest[group].max() for group in groups])
        a = len(self.odds)
        self.least = np.full(len(self.members), math.log(LEAST_ODDS))
        self.most = -self.least
        self.least[a:] = np.where(self._log, math.log(self.dt), 0.0)
        self.most[a:] = np.where(self._log, np.log(np.maximum(most, self.dt)), most)

    def shortest(self, index: int) -> float:
        """The least value of a time, by its place among the natural parameters."""
        return 0.0 if NAMES[(index - 1) // self.states] in ("delay", "hold") else self.dt

    def extent(self, base: Parameters) -> Extent:
        """The lattice extent that holds every point of the space."""
        now = Extent.of(base)
        _, rise, fall, delay, decay, _ = self.free[1:].reshape(len(NAMES), self.states)
        longest = self.longest[1:].reshape(len(NAMES), self.states)
        most = np.ceil(longest[3] / self.dt - 1e-9).astype(np.int64)
        return replace(
            now,
            rise=np.where(rise, longest[1], now.rise),
            fall=np.where(fall, longest[2], now.fall),
            least_late=np.where(delay, 0, now.least_late),
            most_late=np.where(delay, most, now.most_late),
            decays=decay | now.decays,
        )

    def point(self, vector: Floats) -> Floats:
        """The coordinates of natural parameters, moved to the nearest bound where beyond it."""
        waiting = self.room - vector[self.odds].sum()
        a = len(self.odds)
        point = vector[self.index]
        with np.errstate(divide="ignore"):
            point[:a] = np.log(point[:a] / waiting)
            point[a:][self._log] = np.log(point[a:][self._log])
        return np.asarray(np.clip(point, self.least, self.most), dtype=np.float64)

    def vector(self, point: Floats) -> Floats:
        """The natural parameters at a point; times in logarithms never below one step, for rounding."""
        vector, a = self.base.copy(), len(self.odds)
        if a:
            top = max(0.0, float(point[:a].max()))
            odds = np.exp(point[:a] - top)
            vector[self.odds] = self.room * odds / (math.exp(-top) + odds.sum())
        values = point[a:].copy()
        values[self._log] = np.maximum(np.exp(values[self._log]), self.dt)
        vector[self._rest] = values[self._owner]
        return vector

    def rates(self, vector: Floats, rates: Floats) -> Floats:
        """Rates in the coordinates from the rates in the natural parameters at `vector`."""
        p = vector[self.odds]
        mean = float(p @ rates[self.odds]) / self.room
        scale = np.where(self._log[self._owner], vector[self._rest], 1.0)
        others = np.bincount(self._owner, scale * rates[self._rest], minlength=len(self._log))
        return np.concatenate([p * (rates[self.odds] - mean), others])
