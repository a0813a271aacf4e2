"""How sure a fit is of each parameter: standard errors and intervals."""

import math
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtri

from learn.coordinates import LOGARITHMIC, names_of, vector_of
from learn.em import prepare
from learn.exposure import FitError, trials_given
from learn.information import Information, information
from learn.intervals import How, Method, ParameterInterval, Uncertainty
from learn.mstep import Objective
from learn.optimum import across_breakpoints, climb_smoothly, polish
from learn.profile import CLOSE, Profile
from learn.resampling import groups_of, resampled
from learn.result import FitResult
from learn.slices import Slice
from taskcomm.lattice import Bools, Floats
from taskcomm.parallel import map_in_order
from taskcomm.trials import Trial
from taskcomm.world import World

METHODS = ("likelihood", "wald", "bootstrap")
MOST_TOPS, ENOUGH = 4, 0.1  # nats above at which the walks begin again at once
Held = tuple[int, int | None]  # the coordinate of a parameter and, for a ratio, that of its divisor


def uncertainty(
    result: FitResult,
    trials: Sequence[Trial],
    world: World | None = None,
    *,
    method: Method = "likelihood",
    level: float = 0.95,
    weights: ArrayLike | None = None,
    resamples: int = 200,
    seed: int = 0,
    jobs: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Uncertainty:
    """Standard errors and intervals at confidence `level` for every parameter of a fit to `trials`.

    "likelihood": all values at which the profile log-likelihood is within half the chi-squared quantile
    (1.92 nats at 0.95) of its greatest; kinks, bounds and ridges are no trouble to it. Where the fit was
    not the greatest, it is begun again from what was (`Uncertainty.above`). "wald": estimate
    and standard errors on the scale of the coordinate (log odds, logarithms), for the parameters that
    have them. "bootstrap": percentiles of fits to `resamples` draws of teachers (`participant_id`; a
    trial without one counts as a teacher). Only this one, and `robust_error`, allow for teachers who
    differ. All hold the observation model as it was learned. `weights` are those of the fit.
    `progress(done, total)` is called as parts finish.

    Raises FitError for trials that are not those of the fit, ValueError for other bad arguments.

    >>> from taskcomm.world import NOA, Action, BallWorld
    >>> from taskcomm.trials import Step
    >>> from learn.em import fit
    >>> steps = [Step(Action.parse("light_on(1)"), False)] + [Step(NOA, t % 4 == 3) for t in range(40)]
    >>> trial = Trial("example", BallWorld(), BallWorld().tasks[0], tuple(steps))
    >>> found = uncertainty(fit([trial], starts=1), [trial])
    >>> found["that_mov.peak"].low < found["that_mov.peak"].estimate < found["that_mov.peak"].high
    True

    Source: MODEL.md, section 7.
    """
    if method not in METHODS:
        raise ValueError(f"method: must be one of {', '.join(METHODS)}, not {method!r}")
    if not 0 < level < 1:
        raise ValueError(f"level: must be above 0 and below 1, not {level!r}")
    trials = trials_given(trials, "uncertainty")
    objective, centre = _prepared(result, trials, world, weights)
    found = information(objective, centre)
    intervals = _Intervals(result, objective, centre, found, groups_of(trials))
    tell = progress or (lambda done, total: None)
    if method == "wald":
        return intervals.assembled(intervals.wald(level), method, level)
    if method == "bootstrap":
        draws = resampled(
            objective, centre, intervals.groups, resamples, seed, jobs, lambda done: tell(done, resamples)
        )
        return intervals.assembled(
            _percentiles(objective, result, draws, level), method, level, draws=draws, seed=seed
        )
    drop, items = ndtri((1 + level) / 2) ** 2 / 2, intervals.informed()
    for number in range(MOST_TOPS):
        walk = Walk(objective, centre, information(objective, centre).bend, drop)
        last = number + 1 == MOST_TOPS
        limits = map_in_order(
            walk, items, jobs, lambda done: tell(done, len(items)), None if last else _far_above
        )
        highest = max(limits, key=lambda each: each.above, default=None)
        if highest is None or highest.above < CLOSE:
            break
        centre = _summit(objective, highest.top)
    return intervals.profiled(items, limits, level, centre)


def profile_curve(
    result: FitResult,
    trials: Sequence[Trial],
    parameter: str,
    world: World | None = None,
    *,
    weights: ArrayLike | None = None,
    drop: float = 3.0,
    points: int = 31,
) -> tuple[Floats, Floats]:
    """The profile log-likelihood of one parameter, as far as it is `drop` nats down on either side.

    As many `points`: values of the parameter, in order, and by how many nats the log-likelihood is lower
    there than at the fit, the other parameters at their best. KeyError for a parameter not learned.
    """
    objective, centre = _prepared(result, trials_given(trials), world, weights)
    names = names_of(list(result.model.approvals))
    held = [c for c, i in enumerate(objective.space.index) if names[i] == parameter]
    if not held:
        raise KeyError(f"{parameter}: not among the parameters that were learned")
    along, top = Slice(objective, held[0]), objective.value(centre)
    profile = Profile(along, centre, top, information(objective, centre).bend)
    low, high = (profile.end(direction, drop).value for direction in (-1, 1))
    visits = profile.swept(np.linspace(low, high, points))
    natural = [along.natural(along.point(visit.value, visit.rest)) for visit in visits]
    return np.array(natural), np.array([visit.drop for visit in visits])


def _prepared(
    result: FitResult, trials: Sequence[Trial], world: World | None, weights: ArrayLike | None
) -> tuple[Objective, Floats]:
    """What the fit climbed, its observation model as it was learned, and where it ended."""
    world = trials[0].world if world is None else world
    objective = prepare(trials, world, result.model, replace(result.settings, observe=()), weights)
    if objective.evidence.exposure.hashes != result.trial_hashes:
        raise FitError("trials: not those of the fit, or in another order")
    return objective, objective.space.point(vector_of(result.model))


@dataclass(frozen=True)
class Limits:
    """An interval in natural parameters; `above`, `within` (places, 1 + 6 M) and `top` are a `Profile`'s."""

    low: float
    high: float
    how: How
    open_low: bool = False
    open_high: bool = False
    above: float = 0.0
    within: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    top: Floats = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class Walk:
    """Both ends of the profile-likelihood interval of a parameter."""

    objective: Objective
    centre: Floats
    bend: Floats
    drop: float

    def __call__(self, item: Held) -> Limits:
        top = self.objective.value(self.centre)
        along = Slice(self.objective, *item)
        profile = Profile(along, self.centre, top, self.bend)
        low, high = profile.end(-1, self.drop), profile.end(1, self.drop)
        ends = (along.natural(low.point), along.natural(high.point))
        within = profile.within(self.drop + CLOSE)
        return Limits(*ends, "profile", low.open, high.open, profile.above, within, profile.highest())


def _far_above(limits: Limits) -> bool:
    return limits.above > ENOUGH


def _summit(objective: Objective, point: Floats) -> Floats:
    """The best that is found from a point that was higher than the fit, breakpoints and all."""
    point, value = climb_smoothly(objective, point)
    point, _ = across_breakpoints(objective, point, value)
    return polish(objective, point, np.random.default_rng(0))[0]


@dataclass(frozen=True)
class _Intervals:
    """What the intervals of one fit are made of."""

    result: FitResult
    objective: Objective
    centre: Floats
    information: Information
    groups: tuple[Hashable, ...]

    @property
    def names(self) -> tuple[str, ...]:
        return names_of(list(self.result.model.approvals))

    def smooth(self) -> Bools:
        """The coordinates at neither kink nor bound nor ridge, (k,)."""
        return np.array([not self.result.marks[self.names[i]] for i in self.objective.space.index])

    def informed(self) -> list[Held]:
        """The coordinates that have data and, for each state on a ridge, peak over rise."""
        space, names, marks = self.objective.space, self.names, self.result.marks
        index = space.index.tolist()
        held: list[Held] = [(c, None) for c, i in enumerate(index) if marks[names[i]] != "no data"]
        on_ridge = [c for c in range(len(space.odds)) if marks[names[index[c]]] == "ridge"]
        return held + [(c, index.index(index[c] + space.states)) for c in on_ridge]

    def named(self, held: Held) -> list[str]:
        """The parameters that a coordinate moves, or the ratio."""
        members = self.objective.space.members[held[0]]
        return [self.names[i] + ("/rise" if held[1] is not None else "") for i in members]

    def wald(self, level: float) -> dict[str, Limits]:
        space, smooth = self.objective.space, self.smooth()
        limits: dict[str, Limits] = {}
        covariance, reach = self.information.covariance(smooth), ndtri((1 + level) / 2)
        for c in np.flatnonzero(smooth):
            along = Slice(self.objective, int(c))
            way = np.zeros(len(self.centre))
            way[along.keep], way[c] = -along.slopes(self.centre), 1.0
            variance, rest = float(way @ covariance @ way), self.centre[along.keep]
            if 0 < variance < math.inf:  # elsewhere the log-likelihood bends the wrong way
                values = along.value(self.centre) + reach * math.sqrt(variance) * np.array([-1.0, 1.0])
                if c >= len(space.odds):
                    values = np.clip(values, space.least[c], space.most[c])
                low, high = (along.natural(along.point(value, rest)) for value in values.tolist())
                limits |= dict.fromkeys(self.named((int(c), None)), Limits(low, high, "wald"))
        return limits

    def profiled(
        self, items: Sequence[Held], found: Sequence[Limits], level: float, highest: Floats
    ) -> Uncertainty:
        limits = {name: each for item, each in zip(items, found, strict=True) for name in self.named(item)}
        above = max(0.0, self.objective.value(highest) - self.objective.value(self.centre))
        within = [each.within for each in found if len(each.within)]
        draws = np.concatenate([vector_of(self.result.model)[None], *within])
        all_of_it = self.assembled(limits, "likelihood", level, above, draws)
        return replace(all_of_it, highest=self.objective.space.vector(highest)) if above > 0 else all_of_it

    def errors(self) -> tuple[Floats, Floats]:
        """Standard errors of the natural parameters, and those that allow for teachers who differ."""
        smooth, weights = self.smooth(), self.objective.evidence.weights
        covariances = (
            self.information.covariance(smooth),
            self.information.robust_covariance(smooth, self.groups, weights),
        )
        jacobian = self.information.jacobian * smooth
        plain, robust = (
            np.sqrt(np.maximum(np.einsum("na,ab,nb->n", jacobian, covariance, jacobian), 0.0))
            for covariance in covariances
        )
        return plain, robust

    def assembled(
        self,
        limits: Mapping[str, Limits],
        method: Method,
        level: float,
        above: float = 0.0,
        draws: Floats | None = None,
        seed: int | None = None,
    ) -> Uncertainty:
        estimates = dict(zip(self.names, map(float, vector_of(self.result.model)), strict=True))
        for name in limits:
            if name.endswith("/rise"):
                state = name.split(".")[0]
                estimates[name] = estimates[f"{state}.peak"] / estimates[f"{state}.rise"]
        plain, robust = (dict(zip(self.names, each, strict=True)) for each in self.errors())
        intervals = []
        for name, estimate in estimates.items():
            own = limits.get(name)
            regular = name in plain and not self.result.marks[name]
            interval = ParameterInterval(
                name,
                estimate,
                _known(plain[name]) if regular else None,
                _known(robust[name]) if regular else None,
            )
            if own is not None:
                ends = {key: getattr(own, key) for key in ("low", "high", "how", "open_low", "open_high")}
                interval = replace(interval, **ends)
            intervals.append(interval)
        return Uncertainty(
            method, level, len(set(self.groups)), tuple(intervals), above,
            len(draws) if method == "bootstrap" and draws is not None else None, seed, draws,
        )  # fmt: skip


def _known(value: float) -> float | None:
    return float(value) if math.isfinite(value) and value > 0 else None


def _percentiles(objective: Objective, result: FitResult, draws: Floats, level: float) -> dict[str, Limits]:
    """The middle `level` of the bootstrap's fits, of the parameters that were learned and have data.

    An end at a bound is open, but for a delay or hold of 0.
    """
    space, limits = objective.space, {}
    for i, name in enumerate(names_of(list(result.model.approvals))):
        if result.marks[name] not in ("no data", "fixed"):
            low, high = np.quantile(draws[:, i], [(1 - level) / 2, (1 + level) / 2])
            shortest = name.split(".")[-1] in LOGARITHMIC and low <= space.dt * (1 + 1e-9)
            longest = high >= space.longest[i] * (1 - 1e-9)
            limits[name] = Limits(float(low), float(high), "bootstrap", bool(shortest), bool(longest))
    return limits
