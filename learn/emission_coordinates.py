"""What is learned of the observation model as free coordinates, and how steep the objective is in them.

The rates are those of the expected log-likelihood, given the responsibilities (Fisher's identity).
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from learn import emissions
from learn.observing import KEY, Observing
from taskcomm.channels import NormalChannel, ObservationModel
from taskcomm.lattice import Floats

FURTHEST = 20.0  # of log odds, log probabilities and log standard deviations


class EmissionCoordinates:
    """Log odds of the key's errors, log probabilities of a channel's values up to a constant in each mental
    state, and of numbers the means (in standard deviations of them all) and log standard deviations.

    `labels` name the coordinates.
    """

    def __init__(self, observing: Observing) -> None:
        self.observing = observing
        self.labels = self._labels()

    def _labels(self) -> tuple[str, ...]:
        found, seen = [], self.observing
        for name in seen.learned:
            if name in KEY:
                found.append(f"log odds of {name}")
                continue
            for state in seen.base.mental_states:
                if name in seen.numbers:
                    for role in self._roles(name):
                        of = ".".join([name, state, *([role] if role else [])])
                        found += [f"mean of {of}", f"log sd of {of}"]
                else:
                    found += [f"log odds of {name}.{state}.{value}" for value in seen.counted[name].names]
        return tuple(found)

    def _roles(self, name: str) -> tuple[str, ...]:
        channel = self.observing.observation.channels[name]
        assert isinstance(channel, NormalChannel)
        return channel.roles or ("",)

    def point(self) -> Floats:
        """Where the observation model stands."""
        seen, found = self.observing, []
        for name in seen.learned:
            if name in KEY:
                p = getattr(seen.observation, name)
                found.append(math.log(p) - math.log1p(-p))
                continue
            channel: Any = seen.observation.channels[name]
            for state in seen.base.mental_states:
                if name in seen.numbers:
                    overall = seen.numbers[name].overall
                    for role in self._roles(name):
                        mean, sd = (_at(by[state], role) for by in (channel.mean, channel.sd))
                        found += [mean / overall, math.log(sd / overall)]
                else:
                    row = [channel.table[state][value] for value in seen.counted[name].names]
                    found += np.log(np.maximum(row, math.exp(-FURTHEST)) / max(row)).tolist()
        return np.array(found)

    def model(self, point: Floats) -> ObservationModel:
        """The observation model at a point."""
        seen = self.observing
        values = iter(point.tolist())
        key, channels = {}, dict(seen.observation.channels)
        for name in seen.learned:
            if name in KEY:
                key[name] = 1 / (1 + math.exp(-next(values)))
                continue
            channel: Any = channels[name]
            if name in seen.numbers:
                channels[name] = self._normal(name, channel, values)
                continue
            table = {state: dict(channel.table[state]) for state in seen.base.mental_states}
            for row in table.values():
                names = seen.counted[name].names
                odds = np.exp([next(values) for _ in names])
                left = sum(row[value] for value in names)
                row.update(zip(names, (left * odds / odds.sum()).tolist(), strict=True))
            channels[name] = type(channel)(table)
        return replace(seen.observation, channels=channels, **key)

    def _normal(self, name: str, channel: NormalChannel, values: Any) -> NormalChannel:
        overall = self.observing.numbers[name].overall
        mean: dict[str, Any] = {state: {} for state in self.observing.base.mental_states}
        sd: dict[str, Any] = {state: {} for state in mean}
        for state in mean:
            for role in self._roles(name):
                mean[state][role] = next(values) * overall
                sd[state][role] = math.exp(next(values)) * overall
        if channel.target is None:
            mean, sd = ({state: by[state][""] for state in by} for by in (mean, sd))
        return NormalChannel(mean, sd, channel.target)

    def rates(self, weight: Floats) -> Floats:
        """Rates of the objective, priors included, from the responsibilities of all steps, (steps, 2 + M)."""
        seen, found = self.observing, []
        for name in seen.learned:
            if name in KEY:
                erred, could = seen.errors(name, weight)
                total = could + 2 * emissions.PSEUDOCOUNT
                found.append(erred + emissions.PSEUDOCOUNT - total * getattr(seen.observation, name))
                continue
            channel: Any = seen.observation.channels[name]
            for k, state in enumerate(seen.base.mental_states):
                if name in seen.numbers:
                    for role in self._roles(name):
                        mean, sd = (_at(by[state], role) for by in (channel.mean, channel.sd))
                        found += self._of_numbers(name, role, mean, sd, weight[:, k])
                else:
                    found += self._of_values(name, channel.table[state], weight[:, k])
        return np.array(found)

    def _of_values(self, name: str, row: Mapping[str, float], weight: Floats) -> list[float]:
        names, rows, code = self.observing.counted[name]
        counts = np.bincount(code, weight[rows], minlength=len(names)) + emissions.PSEUDOCOUNT
        p = np.array([row[value] for value in names])
        return list((counts - counts.sum() * p / p.sum()).tolist())

    def _of_numbers(self, name: str, role: str, mean: float, sd: float, weight: Floats) -> list[float]:
        rows, values, roles, overall = self.observing.numbers[name]
        chosen = slice(None) if roles is None else roles == role
        away, heavy = (values[chosen] - mean) / sd, weight[rows[chosen]]
        prior = emissions.PSEUDO_SPREAD * ((overall / sd) ** 2 - 1)
        return [float(heavy @ away) * overall / sd, float(heavy @ (away**2 - 1)) + prior]


def _at(value: Any, role: str) -> float:
    return float(value[role]) if role else float(value)
