"""What is said of how sure a fit is: an interval for every parameter."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any, Literal, Self

from taskcomm.lattice import Floats

Method = Literal["likelihood", "wald", "bootstrap"]
UNKEPT = ("draws", "highest")  # in files
How = Literal["profile", "wald", "bootstrap", "none"]


@dataclass(frozen=True)
class ParameterInterval:
    """One parameter: estimate, standard errors, and the interval from `low` to `high`.

    `standard_error` is that of the observed information, `robust_error` allows for teachers who differ;
    both are None at a kink, bound or ridge, where the log-likelihood has no curvature. `how` says what the
    interval rests on; "none": there is none. At an open end (`open_low`, `open_high`) the data do not
    limit the parameter; the number there is only how far was looked.
    """

    parameter: str
    estimate: float
    standard_error: float | None = None
    robust_error: float | None = None
    low: float | None = None
    high: float | None = None
    how: How = "none"
    open_low: bool = False
    open_high: bool = False

    def covers(self, value: float) -> bool:
        """Whether the interval, open ends and all, holds a value; never where there is no interval."""
        if self.low is None or self.high is None:
            return False
        return (self.open_low or self.low <= value) and (self.open_high or value <= self.high)


def interval_text(interval: ParameterInterval) -> str:
    """The interval for a table.

    >>> interval_text(ParameterInterval("mistake", 0.01, low=0.0052, high=0.0171, how="profile"))
    '0.0052 to 0.0171'
    >>> interval_text(ParameterInterval("m.rise", 0.5, low=0.5, high=0.912, how="profile", open_low=True))
    '< 0.912'
    >>> interval_text(ParameterInterval("m.fall", 2.0))
    ''
    """
    if interval.low is None or interval.high is None:
        return ""
    if interval.open_low and interval.open_high:
        return "any"
    if interval.open_low:
        return f"< {interval.high:.3g}"
    if interval.open_high:
        return f"> {interval.low:.3g}"
    return f"{interval.low:.3g} to {interval.high:.3g}"


@dataclass(frozen=True)
class Uncertainty:
    """The intervals of a fit at confidence `level`, by parameter in the order of `names_of`, then those of
    peak/rise where only these are known.

    `method` and, for the bootstrap, `resamples` and `seed` say how they were made; `teachers` is how many
    there were. `above` (nats) is how much higher than the fit the profiles found the log-likelihood: above
    0.01 a fit with more starts would be better, and an estimate may lie off the middle of its interval.
    `highest` (1 + 6 M,) are the natural parameters there, None where that is the fit itself. `draws` (any
    number, 1 + 6 M) are natural parameters as far out as the intervals reach: the fits of the bootstrap, or
    the places at most the drop down that the profiles visited. Neither is kept in files.
    """

    method: Method
    level: float
    teachers: int
    intervals: tuple[ParameterInterval, ...]
    above: float = 0.0
    resamples: int | None = None
    seed: int | None = None
    draws: Floats | None = None
    highest: Floats | None = None

    def __getitem__(self, parameter: str) -> ParameterInterval:
        for interval in self.intervals:
            if interval.parameter == parameter:
                return interval
        raise KeyError(f"{parameter}: no such parameter; there are {', '.join(self.by_parameter)}")

    @property
    def by_parameter(self) -> Mapping[str, ParameterInterval]:
        return {interval.parameter: interval for interval in self.intervals}

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for a model's provenance and for JSON."""
        document = {item.name: getattr(self, item.name) for item in fields(self) if item.name not in UNKEPT}
        return document | {"intervals": [asdict(interval) for interval in self.intervals]}

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> Self:
        """What `to_dict` gave; ValueError for what it never gives."""
        try:
            values = dict(document)
            values["intervals"] = tuple(ParameterInterval(**each) for each in values["intervals"])
            return cls(**values)
        except (TypeError, KeyError) as error:
            raise ValueError(f"uncertainty: not what Uncertainty.to_dict gives: {error}") from None
