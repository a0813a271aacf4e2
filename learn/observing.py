"""Learning how M shows: the key's errors and further channels, in the same EM as the table-tops.

Given the responsibilities P(M_t = m, task | trial) the observation model has an M-step of its own, in closed
form; table-tops and observation model raise the expected log-likelihood apart from each other.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from learn import emissions
from learn.estep import Evidence, Expectation
from learn.exposure import FitError
from taskcomm.channels import NONE, NormalChannel, ObservationModel, PlainChannel, TargetChannel
from taskcomm.lattice import Floats, Ints, relative
from taskcomm.observation import Observer
from taskcomm.teacher import ModelError, TeacherModel
from taskcomm.trials import Trial
from taskcomm.world import World

KEY = ("miss", "false_press")
START = {"miss": 0.05, "false_press": 0.001}
WAITING = 0


def with_channels(
    model: TeacherModel, trials: Sequence[Trial], world: World, learned: Sequence[str]
) -> TeacherModel:
    """`model` ready for what is to be `learned`: channels that it lacks added, zeros opened.

    Raises FitError for a channel that no trial has a signal of, or signals of two kinds.
    """
    seen, states = model.observation, model.mental_states
    channels = dict(seen.channels)
    told: Any = getattr(world, "roles", None)
    for name in learned:
        if name in KEY:
            continue
        if name not in channels:
            signals = [value for trial in trials for value in trial.signals(name) if value is not None]
            if not signals:
                raise FitError(f"observe: no trial has a signal {name!r}, and the model has no such channel")
            if len({isinstance(value, str) for value in signals}) > 1:
                raise FitError(f"observe: signals of {name!r} are words in some steps, numbers in others")
            channels[name] = emissions.first_guess(signals, states, told(world.tasks[0]) if told else None)
        channels[name] = emissions.opened(channels[name])
    start = {name: getattr(seen, name) or START[name] for name in KEY if name in learned}
    try:
        return replace(model, observation=replace(seen, channels=channels, **start))
    except ModelError as error:
        raise FitError(f"observe: {error}") from None


class Counted(NamedTuple):
    """A discrete channel over the steps of all units: the values (roles, of a target) that something in the
    world may have, the steps where there is one, and which, as places among the `names`."""

    names: tuple[str, ...]
    rows: Ints
    code: Ints


class Numbers(NamedTuple):
    """A continuous channel over the steps of all units: where it has a value, the values, the roles of what
    they are about (None without a target), and their standard deviation."""

    rows: Ints
    values: Floats
    roles: NDArray[np.str_] | None
    overall: float


class Observing:
    """The observation model of a fit: where it stands, its M-step, its weights in the lattice.

    `learned` names its parts that move: "miss", "false_press", or channels; `counted` and `numbers` are what
    the steps show of the channels.
    """

    def __init__(
        self,
        trials: Sequence[Trial],
        world: World,
        model: TeacherModel,
        learned: Sequence[str],
        evidence: Evidence,
    ) -> None:
        self.world, self.base, self.learned, self.evidence = world, model, tuple(learned), evidence
        self.observation = model.observation
        lattice, exposure = evidence.exposure.lattice, evidence.exposure
        steps = exposure.steps[exposure.unit_trial]
        starts = np.concatenate([[0], np.cumsum(steps)])
        order = exposure.unit_trial
        patterns: dict[Any, int] = {}
        codes = [
            np.array([patterns.setdefault(_pattern(step, model), len(patterns)) for step in trial.steps])
            for trial in trials
        ]
        self._patterns = list(patterns)
        self._pattern = np.concatenate([codes[trial] for trial in order])
        self._unit = np.repeat(np.arange(len(steps)), steps)
        self._task = np.array([int(share.argmax()) for share in exposure.unit_tasks])[self._unit]
        last = np.zeros(len(lattice.layer_press), dtype=np.bool_)
        last[lattice.unit_layers[1:] - 1] = True
        self._layers = np.flatnonzero(~last)
        unit_of_layer = np.repeat(np.arange(len(steps)), np.diff(lattice.unit_layers))
        self._rows = starts[unit_of_layer] + lattice.layer_press
        self._silent = np.ones(int(starts[-1]), dtype=np.bool_)
        self._silent[self._rows[self._layers]] = False
        self.numbers = self._measured(trials, order)
        self.counted = {
            name: self._counted(name) for name in self.learned if name in self.observation.discrete
        }
        # What is not the observation model's: labels, which bar states whatever the observation.
        self._barred = np.zeros((int(starts[-1]), lattice.event.shape[1]), dtype=np.bool_)
        events = lattice.event_log[self._layers]
        self._barred[self._rows[self._layers]] = (events == -np.inf) & (
            self._logs()[self._rows[self._layers]] > -np.inf
        )
        self.set(model.observation)

    def _measured(self, trials: Sequence[Trial], order: Ints) -> dict[str, Numbers]:
        """The numbers of every continuous channel, over the steps of all units."""
        result = {}
        for name, channel in self.observation.continuous.items():
            each = [np.array([math.nan if x is None else float(x) for x in t.signals(name)]) for t in trials]
            values = np.concatenate([each[trial] for trial in order])
            rows, roles = np.flatnonzero(~np.isnan(values)), None
            if channel.target is not None:
                named = [dict(self._patterns[code][1]).get(channel.target) for code in self._pattern[rows]]
                if None in named:
                    raise FitError(
                        f"observe: a step with {name!r} needs the {channel.target!r} that it is about"
                    )
                by_task = self._roles()
                roles = np.array(
                    [by_task[task][str(value)] for task, value in zip(self._task[rows], named, strict=True)]
                )
                measured = np.isin(
                    roles, channel.roles
                )  # as for the belief, numbers about others say nothing
                rows, roles = rows[measured], roles[measured]
            overall = (float(values[rows].std()) if len(rows) else 0.0) or 1.0
            result[name] = Numbers(rows, values[rows], roles, overall)
        return result

    def _logs(self) -> Floats:
        """ln P(observation | M) of every step of every unit, (steps, 2 + M); densities for numbers."""
        seen, states = self.observation, self.base.mental_states
        discrete = replace(seen, channels=seen.discrete)
        observer = Observer(self.world, replace(self.base, observation=discrete))
        logs = np.array([observer.log_weights(pressed, dict(signals)) for pressed, signals in self._patterns])
        result = logs[self._pattern, self._task]
        if self.numbers:
            from scipy.stats import norm
        for name, (rows, values, roles, _) in self.numbers.items():
            channel = seen.continuous[name]
            for k, state in enumerate(states):
                mean, sd = channel.mean[state], channel.sd[state]
                if roles is not None:
                    mean, sd = (np.array([by[role] for role in roles]) for by in (mean, sd))
                result[rows, k] += norm.logpdf(values, mean, sd)
        return np.asarray(result)

    def set(self, observation: ObservationModel) -> None:
        """Stand at `observation`: the lattice's events and constants become its own."""
        self.observation = observation
        lattice, logs = self.evidence.exposure.lattice, self._logs()
        logs[self._barred] = -np.inf
        at_events, greatest = relative(logs[self._rows[self._layers]])
        lattice.observe(self._layers, at_events)
        constant = np.zeros(len(self._unit))
        constant[self._silent] = logs[self._silent, WAITING]
        constant[self._rows[self._layers]] = greatest[:, 0]
        lattice.unit_constant[:] = np.bincount(self._unit, constant)

    def log_prior(self) -> float:
        """Log density of the weak priors on what is learned, in nats, up to a constant."""
        seen, total = self.observation, 0.0
        for name in self.learned:
            if name in KEY:
                p = getattr(seen, name)
                total += emissions.PSEUDOCOUNT * (math.log(p) + math.log1p(-p))
            else:
                overall = self.numbers[name].overall if name in self.numbers else 1.0
                total += emissions.log_prior(seen.channels[name], overall)
        return total

    @property
    def num_free(self) -> int:
        return sum(
            1 if name in KEY else emissions.count(self.observation.channels[name]) for name in self.learned
        )

    def responsibilities(self, expectation: Expectation) -> Floats:
        """P(unit, M_t = m | trial) of every step of every unit, weighted by trial: (steps, 2 + M)."""
        result = np.zeros(self._barred.shape)
        unit = expectation.unit
        if self.evidence.weights is not None:
            unit = unit * self.evidence.weights[self.evidence.exposure.unit_trial]
        result[self._silent, WAITING] = unit[self._unit[self._silent]]
        layers = self.evidence.exposure.lattice.layer_memories[:-1]
        by_layer = np.add.reduceat(expectation.press, layers)
        result[self._rows[self._layers]] = by_layer[self._layers]
        return result

    def learn(self, expectation: Expectation) -> None:
        """The M-step: the expected log-likelihood of what was observed, with the priors, at its greatest."""
        weight = self.responsibilities(expectation)
        seen = self.observation
        channels = dict(seen.channels)
        for name in self.learned:
            if name not in KEY:
                channels[name] = self._channel(name, weight)
        key = {name: self._error(name, weight) for name in KEY if name in self.learned}
        self.set(replace(seen, channels=channels, **key))

    def errors(self, name: str, weight: Floats) -> tuple[float, float]:
        """Weight of the steps in which the key erred in this way, and of those in which it could have."""
        pressed = np.array([{None: math.nan}.get(key, float(key or 0)) for key, _ in self._patterns])[
            self._pattern
        ]
        could = weight[:, 1:].sum(axis=1) if name == "miss" else weight[:, WAITING]
        erred = pressed == (0.0 if name == "miss" else 1.0)
        return float(could[erred].sum()), float(could[~np.isnan(pressed)].sum())

    def _error(self, name: str, weight: Floats) -> float:
        erred, could = self.errors(name, weight)
        return (erred + emissions.PSEUDOCOUNT) / (could + 2 * emissions.PSEUDOCOUNT)

    def _roles(self) -> list[dict[str, str]]:
        told: Any = self.world.roles  # type: ignore[attr-defined]
        return [{**told(task), NONE: NONE} for task in self.world.tasks]

    def _counted(self, name: str) -> Counted:
        channel = self.observation.channels[name]
        values = [dict(signals).get(name) for _, signals in self._patterns]
        there = np.array([value is not None for value in values])[self._pattern]
        rows = np.flatnonzero(there)
        seen = [str(values[code]) for code in self._pattern[rows]]
        names = channel.values if isinstance(channel, PlainChannel) else channel.roles
        if isinstance(channel, TargetChannel):
            roles = self._roles()
            seen = [roles[task][value] for task, value in zip(self._task[rows], seen, strict=True)]
            there_is = {role for by_value in roles for role in by_value.values()}
            names = tuple(role for role in names if role in there_is)  # nothing bears on others: they stay
        place = {value: code for code, value in enumerate(names)}
        return Counted(names, rows, np.array([place[value] for value in seen], dtype=np.int64))

    def _channel(self, name: str, weight: Floats) -> Any:
        channel, states = self.observation.channels[name], self.base.mental_states
        if isinstance(channel, NormalChannel):
            return self._normal(channel, self.numbers[name], weight)
        names, rows, code = self.counted[name]
        table = {}
        for k, state in enumerate(states):
            row = dict(channel.table[state])
            left = sum(row[value] for value in names)
            found = emissions.categorical(names, code, weight[rows, k])
            table[state] = row | {value: left * p for value, p in found.items()}
        return type(channel)(table)

    def _normal(self, channel: NormalChannel, numbers: Numbers, weight: Floats) -> NormalChannel:
        rows, values, roles, overall = numbers
        mean: dict[str, Any] = {}
        sd: dict[str, Any] = {}
        for k, state in enumerate(self.base.mental_states):
            if roles is None:
                before = channel.mean[state], channel.sd[state]
                mean[state], sd[state] = emissions.normal(values, weight[rows, k], overall) or before
                continue
            mean[state], sd[state] = dict(channel.mean[state]), dict(channel.sd[state])
            for role in channel.roles:
                found = emissions.normal(values[roles == role], weight[rows[roles == role], k], overall)
                if found is not None:
                    mean[state][role], sd[state][role] = found
        return NormalChannel(mean, sd, channel.target)


def _pattern(step: Any, model: TeacherModel) -> tuple[bool | None, tuple[tuple[str, str], ...]]:
    """The key, and the signals of discrete channels."""
    given = step.signals or {}
    names = [name for name in model.observation.discrete if given.get(name) is not None]
    return step.pressed, tuple((name, given[name]) for name in names)
