"""The teacher model: how the teacher's mental state follows what the robot shows.

Source: the paper, section 3.3 (transition model, figure 2); MODEL.md, section 3.
"""

import hashlib
import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from taskcomm.channels import ObservationModel
from taskcomm.modelfields import ModelError as ModelError
from taskcomm.modelfields import number
from taskcomm.wholefile import write_whole

SCHEMA = "taskcomm.teacher/1"
UNITS = {"time": "second", "probability": "per time step"}


@dataclass(frozen=True, slots=True)
class TableTop:
    """A table-top: P(M_t = m) = peak * level, where the level follows the cue.

    The level rises by dt / rise while the cue is on and falls by dt / fall while it is off,
    within [0, 1]; the cue is seen `delay` seconds late; M_t = m sets the level to 0. With `decay`
    the probability is further multiplied by exp(-max(0, q - hold) / decay), q the seconds the
    (late) cue has been on without a break, or since the last reset.

    `peak` is a probability per time step; rise, fall, delay, decay and hold are in seconds.
    Raises ModelError naming the field.

    >>> TableTop(cue="mov_lit", peak=0.1, rise=2.0, fall=2.0).delay
    0.0
    """

    cue: str
    peak: float
    rise: float
    fall: float
    delay: float = 0.0
    decay: float | None = None
    hold: float = 0.0

    def __post_init__(self) -> None:
        if not isinstance(self.cue, str) or not self.cue:
            raise ModelError(f"cue: must be the name of a cue, not {self.cue!r}")
        for name in ("peak", "delay", "hold"):
            object.__setattr__(self, name, number(name, getattr(self, name)))
        for name in ("rise", "fall"):
            object.__setattr__(self, name, number(name, getattr(self, name), above=True))
        if self.decay is not None:
            object.__setattr__(self, "decay", number("decay", self.decay, above=True))
        if self.peak >= 1:
            raise ModelError(f"peak: must be below 1, not {self.peak:g}")


@dataclass(frozen=True, slots=True, eq=False)
class Parameters:
    """A model as arrays over its M approval states, for one World; read-only.

    `cue` are rows of `world.cues(state)`; `steps_late` and `part_late` are n and g of
    delay = (n + g) dt; `decay` is infinite where there is none, and `decays` says whether there is
    any; `rest_steps` is how many steps after a press no approval can follow.
    """

    dt: float
    mistake: float
    cue: NDArray[np.int64]
    peak: NDArray[np.float64]
    rise: NDArray[np.float64]
    fall: NDArray[np.float64]
    steps_late: NDArray[np.int64]
    part_late: NDArray[np.float64]
    decay: NDArray[np.float64]
    hold: NDArray[np.float64]
    rest_steps: int
    decays: bool


@dataclass(frozen=True)
class TeacherModel:
    """The teacher's mental state M_t given what the robot has shown.

    M_t is `mistake` with probability `mistake`, an approval state m with the probability of its
    table-top, and otherwise `waiting`; the spacebar is pressed exactly when M_t is not `waiting`,
    unless `observation` says otherwise. For `rest` seconds after a press (the key going down, for whatever
    reason) no approval follows. `dt` is the length of a step in seconds.
    `provenance` is free: where the model came from, kept in its file.

    Raises ModelError naming the field: mistake must be above 0, mistake and the peaks must sum to
    less than 1, rise and fall must be at least dt.

    >>> model = TeacherModel.intuitive()
    >>> model.mental_states
    ('waiting', 'mistake', 'that_mov', 'that_wrt', 'that_dist')
    >>> model.approvals["that_mov"].peak
    0.1
    """

    mistake: float
    approvals: Mapping[str, TableTop]
    dt: float = 0.5
    rest: float = 0.0
    provenance: Mapping[str, Any] = field(default_factory=dict, compare=False)
    observation: ObservationModel = field(default_factory=ObservationModel)

    def __post_init__(self) -> None:
        for name, above in (("mistake", True), ("dt", True), ("rest", False)):
            object.__setattr__(self, name, number(name, getattr(self, name), above=above))
        if not isinstance(self.approvals, Mapping) or not self.approvals:
            raise ModelError("approvals: must map at least one mental state to its TableTop")
        for state, top in self.approvals.items():
            if not isinstance(state, str) or state in ("", "waiting", "mistake"):
                raise ModelError(f"approvals: {state!r} cannot name an approval state")
            if not isinstance(top, TableTop):
                raise ModelError(f"approvals.{state}: must be a TableTop, not {top!r}")
            for name in ("rise", "fall"):
                if getattr(top, name) < self.dt * (1 - 1e-12):
                    raise ModelError(
                        f"approvals.{state}.{name}: must be at least dt = {self.dt:g} s,"
                        f" not {getattr(top, name):g}"
                    )
        total = self.mistake + sum(top.peak for top in self.approvals.values())
        if total >= 1:
            raise ModelError(f"mistake and peaks: must sum to less than 1, not {total:g}")
        if not isinstance(self.provenance, Mapping):
            raise ModelError(f"provenance: must be a mapping, not {self.provenance!r}")
        if not isinstance(self.observation, ObservationModel):
            raise ModelError(f"observation: must be an ObservationModel, not {self.observation!r}")
        self.observation.check(self.mental_states)
        object.__setattr__(self, "approvals", MappingProxyType(dict(self.approvals)))
        object.__setattr__(self, "provenance", MappingProxyType(dict(self.provenance)))

    def __hash__(self) -> int:
        return hash((self.mistake, self.dt, self.rest, frozenset(self.approvals.items()), self.observation))

    def __reduce__(self) -> tuple[Any, ...]:
        values = self.mistake, dict(self.approvals), self.dt, self.rest, dict(self.provenance)
        return _rebuild, (*values, self.observation)

    @classmethod
    def intuitive(cls) -> Self:
        """The model that the paper set from intuition."""
        cues = {"that_mov": "mov_lit", "that_wrt": "wrt_lit_while_mov_held", "that_dist": "mov_at_dist"}
        return cls(
            mistake=0.005,
            approvals={state: TableTop(cue, peak=0.1, rise=2.0, fall=2.0) for state, cue in cues.items()},
            provenance={"made_by": "TeacherModel.intuitive", "source": "Woodward & Wood 2012"},
        )

    @property
    def mental_states(self) -> tuple[str, ...]:
        """All values of M: waiting, mistake, then the approval states in the model's order."""
        return ("waiting", "mistake", *self.approvals)

    def with_dt(self, dt: float) -> Self:
        """The model at another step length, approximately.

        The total press probability P = mistake + sum of peaks becomes 1 - (1 - P)^(dt' / dt),
        split in the old proportions; times stay. Approximate, since levels are sampled at the
        ends of steps. Rise and fall below the new dt become dt, below which nothing changes. A key that
        fires by itself does so as often per second; the other observation probabilities stay as they are.
        """
        dt = number("dt", dt, above=True)
        total = self.mistake + sum(top.peak for top in self.approvals.values())
        scale = -math.expm1(math.log1p(-total) * dt / self.dt) / total
        tops = {
            state: replace(top, peak=top.peak * scale, rise=max(top.rise, dt), fall=max(top.fall, dt))
            for state, top in self.approvals.items()
        }
        note = dict(self.provenance) | {
            "converted_from_dt": self.dt,
            "conversion": f"from dt = {self.dt:g} s to {dt:g} s, approximate",
        }
        seen = self.observation
        false_press = -math.expm1(math.log1p(-seen.false_press) * dt / self.dt)
        return replace(
            self,
            mistake=self.mistake * scale,
            approvals=tops,
            dt=dt,
            provenance=note,
            observation=replace(seen, false_press=false_press),
        )

    def parameters(self, cue_names: Sequence[str]) -> Parameters:
        """The model as arrays, its cues as rows of a cue table with these names."""
        names = list(cue_names)
        for state, top in self.approvals.items():
            if top.cue not in names:
                raise ModelError(
                    f"approvals.{state}.cue: unknown cue {top.cue!r}; this world has {', '.join(names)}"
                )
        tops = list(self.approvals.values())
        late = np.array([top.delay for top in tops]) / self.dt
        whole = np.floor(late + 1e-9)
        arrays = {
            name: np.array([getattr(top, name) for top in tops]) for name in ("peak", "rise", "fall", "hold")
        }
        decay = np.array([math.inf if top.decay is None else top.decay for top in tops])
        parameters = Parameters(
            dt=self.dt,
            mistake=self.mistake,
            cue=np.array([names.index(top.cue) for top in tops], dtype=np.int64),
            steps_late=whole.astype(np.int64),
            part_late=np.maximum(late - whole, 0.0),
            decay=decay,
            decays=bool(np.isfinite(decay).any()),
            rest_steps=int(self.rest / self.dt + 1e-9),
            **arrays,
        )
        for name in ("cue", "peak", "rise", "fall", "hold", "decay", "steps_late", "part_late"):
            getattr(parameters, name).setflags(write=False)
        return parameters

    def _fields(self) -> dict[str, Any]:
        fields = {
            "dt": self.dt,
            "mistake": self.mistake,
            "rest": self.rest,
            "approvals": {state: asdict(top) for state, top in self.approvals.items()},
        }
        seen = self.observation
        return fields if seen.is_exact_key else fields | {"observation": seen.to_dict()}

    @property
    def sha256(self) -> str:
        """Hash of the parameters alone (not of the provenance)."""
        return hashlib.sha256(json.dumps(self._fields(), sort_keys=True).encode()).hexdigest()

    def to_dict(self) -> dict[str, Any]:
        """What a model file holds, as plain values: schema, units, parameters, provenance."""
        return {"schema": SCHEMA, "units": UNITS} | self._fields() | {"provenance": dict(self.provenance)}

    def to_json(self) -> str:
        """The model file."""
        return json.dumps(self.to_dict(), indent=2, ensure_ascii=False) + "\n"

    @classmethod
    def from_json(cls, text: str | bytes) -> Self:
        """The model of a model file's text; ModelError says which field is wrong and why."""
        try:
            document = json.loads(text, object_pairs_hook=_object)
        except ModelError:
            raise
        except (ValueError, RecursionError) as error:
            raise ModelError(f"not JSON: {error}") from None
        return cls.from_dict(document)

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> Self:
        """The model of what a model file holds, or of one among several in a JSON document.

        ModelError says which field is wrong and why.

        >>> TeacherModel.from_dict(TeacherModel.intuitive().to_dict()) == TeacherModel.intuitive()
        True
        """
        if not isinstance(document, Mapping):
            raise ModelError("a model file holds one JSON object")
        document = dict(document)
        schema = document.pop("schema", None)
        if schema != SCHEMA:
            raise ModelError(f"schema: this version reads {SCHEMA!r}, not {schema!r}")
        units = document.pop("units", UNITS)
        if units != UNITS:
            raise ModelError(f"units: must be {UNITS}, not {units!r}")
        known = {"dt", "mistake", "rest", "approvals", "observation", "provenance"}
        for name in sorted({"dt", "mistake", "approvals"} - set(document)):
            raise ModelError(f"{name}: missing")
        for name in sorted(map(str, set(document) - known)):
            raise ModelError(f"{name}: unknown field")
        approvals = document.pop("approvals")
        if not isinstance(approvals, Mapping):
            raise ModelError("approvals: must be an object")
        tops = {state: _table_top(f"approvals.{state}", top) for state, top in approvals.items()}
        if not isinstance(document.get("provenance", {}), Mapping):
            raise ModelError("provenance: must be an object")
        seen = _observation(document.pop("observation", {}))
        return cls(approvals=tops, observation=seen, **document)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the model file; an existing file is replaced whole or left as it was.

        Raises OutputError (an OSError), naming the file, where it cannot be written.
        """
        write_whole(Path(path), self.to_json().encode())

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Read a model file; ModelError names the file and the field."""
        try:
            return cls.from_json(Path(path).read_bytes())
        except ModelError as error:
            raise ModelError(f"{path}: {error}") from None


def _object(pairs: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    document = dict(pairs)
    if len(document) < len(pairs):
        names = [name for name, _ in pairs]
        raise ModelError(f"{next(name for name in names if names.count(name) > 1)}: given twice")
    return document


def _rebuild(*values: Any) -> TeacherModel:
    return TeacherModel(*values)


def _observation(document: Any) -> ObservationModel:
    try:
        return ObservationModel.from_dict(document)
    except ModelError as error:
        raise ModelError(f"observation: {error}") from None


def _table_top(name: str, document: Any) -> TableTop:
    if not isinstance(document, Mapping):
        raise ModelError(f"{name}: must be an object")
    known = {item.name for item in fields(TableTop)}
    for key in sorted(map(str, set(document) - known)):
        raise ModelError(f"{name}.{key}: unknown field")
    for key in ("cue", "peak", "rise", "fall"):
        if key not in document:
            raise ModelError(f"{name}.{key}: missing")
    try:
        return TableTop(**document)
    except ModelError as error:
        raise ModelError(f"{name}.{error}") from None
