"""P(observation | mental state, task) as numbers: of one step, of a trial, of all that may be observed."""

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from taskcomm.channels import NONE, NormalChannel, PlainChannel, TargetChannel
from taskcomm.channels import ObservationModel as ObservationModel
from taskcomm.teacher import ModelError, TeacherModel
from taskcomm.world import World

Floats = NDArray[np.float64]
Signals = Mapping[str, str | float]

WAITING = 0  # the column of `waiting`, as in `TeacherModel.mental_states`


class SignalError(ValueError):
    """A signal that a channel of the model cannot have; the message names the channel."""


class Observed(Protocol):
    """What is observed in one step: the key (None: not recorded), and signals by channel."""

    @property
    def pressed(self) -> bool | None: ...
    @property
    def signals(self) -> Signals | None: ...


class _Trial(Protocol):
    @property
    def steps(self) -> Sequence[Observed]: ...


class Outcomes(NamedTuple):
    """All that may be observed in a step, continuous channels aside: `table` (outcomes, tasks, 2 + M)."""

    pressed: tuple[bool, ...]
    signals: tuple[dict[str, str], ...]
    table: Floats


def observation_logs(trial: _Trial, world: World, model: TeacherModel) -> Floats:
    """ln P(observation of step t | M_t, task), shape (T, tasks, 2 + M), columns as `model.mental_states`.

    A key state that was not recorded and a signal that is missing have the factor 1; signals of channels that
    the model lacks are left aside; a continuous channel contributes its density. Raises ModelError
    where a channel does not fit the world, SignalError naming step and channel for a value that cannot be.

    >>> from taskcomm.trials import Step, Trial
    >>> from taskcomm.world import NOA, BallWorld
    >>> trial = Trial("a", BallWorld(), None, (Step(NOA, True), Step(NOA, False), Step(NOA, None)))
    >>> np.exp(observation_logs(trial, trial.world, TeacherModel.intuitive()))[:, 0]
    array([[0., 1., 1., 1., 1.],
           [1., 0., 0., 0., 0.],
           [1., 1., 1., 1., 1.]])

    Source: MODEL.md, section 3.
    """
    observer = Observer(world, model)
    logs = np.empty((len(trial.steps), len(world.tasks), len(model.mental_states)))
    for t, step in enumerate(trial.steps):
        try:
            logs[t] = observer.log_weights(step.pressed, step.signals)
        except SignalError as error:
            raise SignalError(f"step {t}: {error}") from None
    return logs


class Observer:
    """The observation model of `model` in `world`, as arrays.

    `key` (2, 2 + M) is P(no press | M), P(press | M); `exact` says that the key is all there is and never
    errs; `tables` has P(value | M, task) of every discrete channel, by value, each (tasks, 2 + M). Raises
    ModelError where a channel does not fit the world.
    """

    def __init__(self, world: World, model: TeacherModel) -> None:
        seen, states = model.observation, model.mental_states
        self.model, self.exact = seen, seen.is_exact_key
        self._shape = len(world.tasks), len(states)
        press = np.full(len(states), 1.0 - seen.miss)
        press[WAITING] = seen.false_press
        self.key = np.stack([1.0 - press, press])
        self._roles = _roles(world) if any(not isinstance(c, PlainChannel) for c in _all(seen)) else {}
        self.tables: dict[str, dict[str, Floats]] = {}
        for name, channel in seen.discrete.items():
            try:
                if isinstance(channel, PlainChannel):
                    self.tables[name] = self._plain(channel, states)
                else:
                    self.tables[name] = self._about_targets(channel, states)
            except ModelError as error:
                raise ModelError(f"observation.channels.{name}: {error}") from None
        self._normals = {name: self._moments(channel, states) for name, channel in seen.continuous.items()}
        self._kept: dict[Any, Floats] = {}

    def _plain(self, channel: PlainChannel, states: Sequence[str]) -> dict[str, Floats]:
        rows = {value: [channel.table[state][value] for state in states] for value in channel.values}
        return {value: np.broadcast_to(np.array(row), self._shape) for value, row in rows.items()}

    def _about_targets(self, channel: TargetChannel, states: Sequence[str]) -> dict[str, Floats]:
        """P(value | M, task): P(role) shared evenly among the values that have the role."""
        if not self._roles:
            raise ModelError("this world says nothing of roles: it needs a method roles(task)")
        known = channel.roles
        for role in {role for roles in self._roles.values() for role in roles} - set(known):
            raise ModelError(f"the world knows a role {role!r}, the table only {', '.join(known)}")
        table = {role: np.array([channel.table[state][role] for state in states]) for role in known}
        result = {}
        for value, roles in self._roles.items():
            shares = [table[role] / self._sharing(task, role) for task, role in enumerate(roles)]
            result[value] = np.array(shares)
        total = np.sum(list(result.values()), axis=0)
        if not (total > 0).all():
            task, state = np.argwhere(total <= 0)[0]
            raise ModelError(f"table.{states[state]}: no value has a probability under task {task}")
        return {value: share / total for value, share in result.items()}

    def _sharing(self, task: int, role: str) -> int:
        return sum(roles[task] == role for roles in self._roles.values())

    def _moments(self, channel: NormalChannel, states: Sequence[str]) -> dict[str, tuple[Floats, Floats]]:
        """Mean and sd by value of the target ("" where there is none), each (tasks, 2 + M)."""
        if channel.target is None:
            pair = [np.array([by[state] for state in states]) for by in (channel.mean, channel.sd)]
            return {"": (np.broadcast_to(pair[0], self._shape), np.broadcast_to(pair[1], self._shape))}
        result = {}
        for value, roles in self._roles.items():
            if value in channel.roles or value != NONE:
                mean = np.array([[channel.mean[state][role] for state in states] for role in roles])
                sd = np.array([[channel.sd[state][role] for state in states] for role in roles])
                result[value] = mean, sd
        return result

    def log_weights(self, pressed: bool | None, signals: Signals | None = None) -> Floats:
        """ln P(observation of a step | M, task), shape (tasks, 2 + M).

        Raises SignalError naming the channel for a value that it cannot have.
        """
        known = {name: value for name, value in (signals or {}).items() if name in self.model.channels}
        return self._log_weights(pressed, known)

    def weights(self, pressed: bool | None, signals: Signals | None = None) -> Floats:
        """P(observation of a step | M, task), densities for numbers, shape (tasks, 2 + M); read-only."""
        signals = signals or {}
        key: Any = pressed, *(signals.get(name) for name in self.model.channels)
        if key not in self._kept:
            result = np.exp(self.log_weights(pressed, signals))
            result.setflags(write=False)
            if any(name in signals for name in self._normals):
                return result
            self._kept[key] = result
        return self._kept[key]

    def _log_weights(self, pressed: bool | None, signals: Signals) -> Floats:
        with np.errstate(divide="ignore"):
            result = np.zeros(self._shape)
            if pressed is not None:
                result = result + np.log(self.key[int(pressed)])
            for name, table in self.tables.items():
                result = result + self._of_channel(name, table, signals)
            for name, moments in self._normals.items():
                if name in signals and self.model.continuous[name].target is None:
                    result = result + _log_density(_number(name, signals[name]), *moments[""])
        return result

    def _of_channel(self, name: str, table: Mapping[str, Floats], signals: Signals) -> Floats:
        """ln P of a discrete channel together with the numbers about its target."""
        about = {
            other: _number(other, signals[other])
            for other, channel in self.model.continuous.items()
            if channel.target == name and other in signals
        }
        value = signals.get(name)
        if value is not None and value not in table:
            raise SignalError(f"signals.{name}: {value!r} is none of {', '.join(table)}")
        if value is None and not about:
            return np.zeros(self._shape)
        parts = []
        for one in table if value is None else [str(value)]:
            measured = [other for other in about if one in self._normals[other]]
            if value is None and len(measured) < len(about):
                continue  # nothing would have been measured
            densities = [_log_density(about[other], *self._normals[other][one]) for other in measured]
            parts.append(sum(densities, np.log(table[one])))
        return np.asarray(np.logaddexp.reduce(np.array(parts), axis=0))

    def outcomes(self) -> Outcomes:
        """Everything that key and discrete channels may show in a step, the key varying slowest."""
        names = list(self.tables)
        shown = [dict(zip(names, values, strict=True)) for values in product(*self.tables.values())]
        both = [(pressed, signals) for pressed in (False, True) for signals in shown]
        table = np.empty((len(both), *self._shape))
        for row, (pressed, signals) in enumerate(both):
            table[row] = self.key[int(pressed)]
            for name, value in signals.items():
                table[row] *= self.tables[name][value]
        return Outcomes(tuple(pressed for pressed, _ in both), tuple(signals for _, signals in both), table)

    def draw(self, task: int, state: int, rng: np.random.Generator) -> tuple[bool, dict[str, str | float]]:
        """Key and signals of a step, given the task and M (an index of `mental_states`).

        One random number for the key where it errs, then one for each channel in the model's order.
        """
        seen = self.model
        pressed = bool(self.key[1, state] == 1)
        if seen.miss or seen.false_press:
            pressed = bool(rng.random() < self.key[1, state])
        drawn: dict[str, str | float] = {}
        for name, table in self.tables.items():
            sums = np.cumsum([p[task, state] for p in table.values()])
            at = int(np.searchsorted(sums, rng.random() * sums[-1], side="right"))
            drawn[name] = list(table)[at]
        for name, channel in seen.continuous.items():
            moments = self._normals[name].get("" if channel.target is None else str(drawn[channel.target]))
            if moments is not None:
                drawn[name] = float(rng.normal(moments[0][task, state], moments[1][task, state]))
        return pressed, {name: drawn[name] for name in seen.channels if name in drawn}


def _all(seen: ObservationModel) -> list[Any]:
    return list(seen.channels.values())


def _roles(world: World) -> dict[str, list[str]]:
    """By value the role under every task, "none" last; empty where the world says nothing of roles."""
    told = getattr(world, "roles", None)
    if told is None:
        return {}
    by_task = [told(task) for task in world.tasks]
    for task, roles in zip(world.tasks, by_task, strict=True):
        if set(roles) != set(by_task[0]) or NONE in roles:
            raise ModelError(
                f"roles({task}): must have the names of roles({world.tasks[0]}), none of them 'none'"
            )
    values = {value: [roles[value] for roles in by_task] for value in by_task[0]}
    return values | {NONE: [NONE] * len(by_task)}


def _number(name: str, value: str | float) -> float:
    if isinstance(value, (str, bool)) or not np.isfinite(value):
        raise SignalError(f"signals.{name}: must be a finite number, not {value!r}")
    return float(value)


def _log_density(x: float, mean: Floats, sd: Floats) -> Floats:
    """ln of the normal density."""
    return np.asarray(-0.5 * ((x - mean) / sd) ** 2 - np.log(sd) - 0.5 * np.log(2 * np.pi))
