"""How the teacher's mental state shows: the key, and further signals (MODEL.md, section 3, end).

P(O_t | M_t, theta) = P(key | M_t) * product over channels of P(signal | M_t, role of its target under theta)
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, ClassVar

from taskcomm.modelfields import ModelError, distribution, mapping, number, probability, real

NONE = "none"  # a signal about a target that points at nothing
Table = Mapping[str, Mapping[str, float]]


class _Value:
    """Equal where `to_dict` says the same; may be hashed and pickled."""

    def to_dict(self) -> dict[str, Any]:
        raise NotImplementedError

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and isinstance(other, _Value) and other.to_dict() == self.to_dict()

    def __hash__(self) -> int:
        return hash(json.dumps(self.to_dict(), sort_keys=True))

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuilt, (type(self), {k: v for k, v in self.to_dict().items() if k != "kind"})


def _rebuilt(kind: type, document: dict[str, Any]) -> Any:
    return ObservationModel.from_dict(document) if kind is ObservationModel else kind(**document)


def _table(document: Any) -> Table:
    """By mental state a distribution, each over the same names."""
    rows = {state: distribution(f"table.{state}", row) for state, row in mapping("table", document).items()}
    names = list(next(iter(rows.values())))
    for state, row in rows.items():
        if set(row) != set(names):
            raise ModelError(f"table.{state}: must have a probability of {', '.join(names)}")
    return MappingProxyType(
        {state: MappingProxyType({name: row[name] for name in names}) for state, row in rows.items()}
    )


def _plain(table: Table) -> dict[str, dict[str, float]]:
    return {state: dict(row) for state, row in table.items()}


@dataclass(frozen=True, slots=True, eq=False)
class PlainChannel(_Value):
    """A signal with one of several values: `table` has P(value | M) by mental state, then by value.

    Raises ModelError naming the field.

    >>> PlainChannel({"waiting": {"smile": 0.1, "frown": 0.9}, "mistake": {"smile": 0, "frown": 1}}).values
    ('smile', 'frown')
    """

    kind: ClassVar[str] = "plain"
    table: Table

    def __post_init__(self) -> None:
        object.__setattr__(self, "table", _table(self.table))

    @property
    def states(self) -> Iterable[str]:
        return self.table

    @property
    def values(self) -> tuple[str, ...]:
        return tuple(next(iter(self.table.values())))

    def to_dict(self) -> dict[str, Any]:
        return {"kind": self.kind, "table": _plain(self.table)}


@dataclass(frozen=True, slots=True, eq=False)
class TargetChannel(_Value):
    """A signal that names a part of the world, such as the ball looked at, or "none".

    What matters is the part's role under the task (for a ball: mov, wrt or other; the World says so by
    `roles(task)`). `table` has P(role | M) by mental state, then by role, "none" included. Parts of one
    role share its probability evenly; where a task gives nothing a role, the other probabilities are divided
    by their sum. Raises ModelError naming the field.
    """

    kind: ClassVar[str] = "target"
    table: Table

    def __post_init__(self) -> None:
        object.__setattr__(self, "table", _table(self.table))
        if NONE not in self.roles:
            raise ModelError(f"table: must have a probability of {NONE!r} beside the roles")

    @property
    def states(self) -> Iterable[str]:
        return self.table

    @property
    def roles(self) -> tuple[str, ...]:
        """The roles that the table knows, and "none"."""
        return tuple(next(iter(self.table.values())))

    def to_dict(self) -> dict[str, Any]:
        return {"kind": self.kind, "table": _plain(self.table)}


@dataclass(frozen=True, slots=True, eq=False)
class NormalChannel(_Value):
    """A signal that is a number, normally distributed: `mean` and `sd` by mental state.

    With `target`, the name of a TargetChannel, they are by mental state, then by the role of what that
    channel names in the same step; "none" may be left out: nothing is measured then. Belief and learning use
    such a channel, the planner does not. Raises ModelError naming the field.
    """

    kind: ClassVar[str] = "normal"
    mean: Mapping[str, Any]
    sd: Mapping[str, Any]
    target: str | None = None

    def __post_init__(self) -> None:
        if self.target is not None and (not isinstance(self.target, str) or not self.target):
            raise ModelError(f"target: must be the name of a channel, not {self.target!r}")
        for name, above in (("mean", False), ("sd", True)):
            object.__setattr__(self, name, self._numbers(name, getattr(self, name), above))
        if set(self.mean) != set(self.sd):
            raise ModelError("sd: must have the mental states of mean")
        if self.target is not None and len({frozenset(row) for row in self._rows()}) > 1:
            raise ModelError("mean and sd: must have the same roles in every mental state")

    def _rows(self) -> Iterable[Mapping[str, float]]:
        return [*self.mean.values(), *self.sd.values()]

    def _numbers(self, name: str, document: Any, above: bool) -> Mapping[str, Any]:
        result: dict[str, Any] = {}
        for state, value in mapping(name, document).items():
            place = f"{name}.{state}"
            if self.target is None:
                result[state] = number(place, value, above=True) if above else real(place, value)
            else:
                row = mapping(place, value).items()
                result[state] = MappingProxyType(
                    {
                        role: number(f"{place}.{role}", x, above=True)
                        if above
                        else real(f"{place}.{role}", x)
                        for role, x in row
                    }
                )
        return MappingProxyType(result)

    @property
    def states(self) -> Iterable[str]:
        return self.mean

    @property
    def roles(self) -> tuple[str, ...]:
        """The roles that are measured; () without a target."""
        return () if self.target is None else tuple(next(iter(self.mean.values())))

    def to_dict(self) -> dict[str, Any]:
        if self.target is None:
            return {"kind": self.kind, "mean": dict(self.mean), "sd": dict(self.sd)}
        mean, sd = _plain(self.mean), _plain(self.sd)
        return {"kind": self.kind, "mean": mean, "sd": sd, "target": self.target}


Channel = PlainChannel | TargetChannel | NormalChannel
_KINDS: Mapping[str, type[PlainChannel] | type[TargetChannel] | type[NormalChannel]] = {
    kind.kind: kind for kind in (PlainChannel, TargetChannel, NormalChannel)
}


@dataclass(frozen=True, slots=True, eq=False)
class ObservationModel(_Value):
    """P(O | M, role): what of the teacher's mental state is seen.

    `miss` is P(no press | M is not waiting), `false_press` is P(press | waiting), each per time step.
    `channels` are further signals by name, independent of the key and of one another given M and the task.
    The default is the paper's: the key is pressed exactly when M is not waiting.

    Raises ModelError naming the field.

    >>> ObservationModel(miss=0.1).is_exact_key, ObservationModel().is_exact_key
    (False, True)
    """

    miss: float = 0.0
    false_press: float = 0.0
    channels: Mapping[str, Channel] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("miss", "false_press"):
            object.__setattr__(self, name, probability(name, getattr(self, name)))
        if not isinstance(self.channels, Mapping):
            raise ModelError("channels: must be an object")
        for name, channel in self.channels.items():
            if not isinstance(name, str) or name in ("", "press"):
                raise ModelError(f"channels: {name!r} cannot name a channel")
            if not isinstance(channel, Channel):
                raise ModelError(f"channels.{name}: must be a channel, not {channel!r}")
        for name, channel in self.channels.items():
            if isinstance(channel, NormalChannel) and channel.target is not None:
                self._check_target(name, channel)
        object.__setattr__(self, "channels", MappingProxyType(dict(self.channels)))

    def _check_target(self, name: str, channel: NormalChannel) -> None:
        target = self.channels.get(channel.target or "")
        if not isinstance(target, TargetChannel):
            raise ModelError(f"channels.{name}.target: {channel.target!r} is no channel about a target")
        if {*channel.roles, NONE} != {*target.roles, NONE}:
            raise ModelError(f"channels.{name}: must have the roles of {channel.target}: {target.roles}")

    @property
    def is_exact_key(self) -> bool:
        """Whether the key is all that is seen, and says exactly whether M is waiting."""
        return self.miss == 0 and self.false_press == 0 and not self.channels

    @property
    def discrete(self) -> dict[str, PlainChannel | TargetChannel]:
        """The channels with finitely many values, which the planner branches over."""
        return {name: c for name, c in self.channels.items() if not isinstance(c, NormalChannel)}

    @property
    def continuous(self) -> dict[str, NormalChannel]:
        return {name: c for name, c in self.channels.items() if isinstance(c, NormalChannel)}

    def check(self, mental_states: Sequence[str]) -> None:
        """Raise ModelError unless every channel speaks of exactly these mental states."""
        for name, channel in self.channels.items():
            for state in mental_states:
                if state not in channel.states:
                    raise ModelError(f"observation.channels.{name}: nothing is said of {state!r}")
            for state in channel.states:
                if state not in mental_states:
                    raise ModelError(f"observation.channels.{name}: unknown mental state {state!r}")

    def to_dict(self) -> dict[str, Any]:
        """As in a model file."""
        channels = {name: channel.to_dict() for name, channel in self.channels.items()}
        key = {"miss": self.miss, "false_press": self.false_press}
        return key | ({"channels": channels} if channels else {})

    @classmethod
    def from_dict(cls, document: Any) -> "ObservationModel":
        """From a model file; ModelError says which field is wrong and why."""
        if not isinstance(document, Mapping):
            raise ModelError("must be an object")
        for name in document:
            if name not in ("miss", "false_press", "channels"):
                raise ModelError(f"{name}: unknown field")
        fields = dict(document)
        channels = fields.pop("channels", {})
        if not isinstance(channels, Mapping):
            raise ModelError("channels: must be an object")
        return cls(channels={name: _channel(name, part) for name, part in channels.items()}, **fields)


def _channel(name: str, document: Any) -> Channel:
    place = f"channels.{name}"
    if not isinstance(document, Mapping):
        raise ModelError(f"{place}: must be an object")
    fields = dict(document)
    kind = _KINDS.get(str(fields.pop("kind", None)))
    if kind is None:
        raise ModelError(f"{place}.kind: must be one of {', '.join(_KINDS)}, not {document.get('kind')!r}")
    required = {"mean", "sd"} if kind is NormalChannel else {"table"}
    for key in sorted(required - set(fields)):
        raise ModelError(f"{place}.{key}: missing")
    for key in fields:
        if key not in required and not (kind is NormalChannel and key == "target"):
            raise ModelError(f"{place}.{key}: unknown field")
    try:
        return kind(**fields)
    except ModelError as error:
        raise ModelError(f"{place}.{error}") from None
