"""May a fit be trusted? The certificate that every fit ends with."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal, Self

import numpy as np

from learn.audit import AS_NONE
from learn.basins import Ending
from learn.mstep import Objective
from learn.optimum import TOLERANCE, Slopes
from learn.statistics import full, vanished
from taskcomm.lattice import Floats

Kind = Literal[
    "converged", "at a bound", "iteration limit", "slope left", "not monotone", "degenerate", "surpassed"
]
TRUSTED = ("converged", "at a bound")
FLAT = 1e-3
NO_LOSS = 0.01
SURPASSED = 0.1  # nats
BEND_STEP = 1e-4


@dataclass(frozen=True)
class Certificate:
    """What a fit can say for itself.

    `kind` is the gravest that holds: "degenerate" (the maximum is no estimate, see `degeneracies`),
    "iteration limit" (EM was still rising), "slope left" (a one-sided slope above `tolerance`), "not
    monotone" (the objective fell somewhere on the way), "surpassed" (the profiles of its intervals found a
    model more than SURPASSED nats more likely), "at a bound" (some parameter lies at one; a remark),
    "converged". `reasons` are sentences on why a fit is not to be trusted, empty where it is.

    `log_likelihood` (nats) is that of the presses, `objective` with the priors. `endings` says where each
    start ended, and `basins` on how many hills, see `learn.basins.endings`. `em_alone` is the best
    objective that EM reached without the search, `search_gain` what the search added. `steepest` is the
    greatest one-sided slope at the end (nats per unit of log odds, log time or second of delay; None
    where nothing was free) and `steepest_along` its direction. `kinks`, `bounds` and `no_data` are
    parameters, `ridges` approval states: remarks, no faults.
    """

    kind: Kind
    reasons: tuple[str, ...]
    log_likelihood: float
    objective: float
    iterations: int
    endings: tuple[Ending, ...]
    basins: int
    em_alone: float
    search_gain: float
    monotone: bool
    steepest: float | None
    steepest_along: str
    tolerance: float
    kinks: tuple[str, ...]
    ridges: tuple[str, ...]
    bounds: tuple[str, ...]
    no_data: tuple[str, ...]

    @property
    def trusted(self) -> bool:
        """Whether it is a maximum that may be used; a kink, a ridge or a bound does not speak against it."""
        return self.kind in TRUSTED

    @property
    def status(self) -> str:
        """`converged`, or why the fit is not to be trusted, in one line."""
        if self.trusted:
            return "converged"
        return f"{'degenerate' if self.kind == 'degenerate' else 'not converged'}: {'; '.join(self.reasons)}"

    def with_profiles(self, above: float) -> Self:
        """The certificate once profiles have looked beside the fit, and found one `above` it, in nats."""
        if not above > SURPASSED:
            return self
        reason = f"a model {above:.2f} nats more likely lies beside it: more starts may find it"
        kind: Kind = "surpassed" if self.trusted else self.kind
        return replace(self, kind=kind, reasons=(*self.reasons, reason))

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON; what is not a finite number is None."""
        document = asdict(self) | {"trusted": self.trusted, "status": self.status}
        document["endings"] = [_plain(ending._asdict()) for ending in self.endings]
        return _plain({key: list(v) if isinstance(v, tuple) else v for key, v in document.items()})

    def lines(self) -> tuple[str, ...]:
        """The certificate for people, a line for each of its parts."""
        said = "may be trusted" if self.trusted else "NOT TO BE TRUSTED"
        below = [ending.below for ending in self.endings]
        hills = "in one basin" if self.basins == 1 else f"in {self.basins} basins"
        count = "1 start, whose own climb" if len(below) == 1 else f"{len(below)} starts, whose own climbs"
        slope = "nothing was free"
        if self.steepest is not None:
            held = "no direction rises" if self.steepest <= self.tolerance else "NOT AN OPTIMUM"
            along = f" towards {self.steepest_along}" if self.steepest_along else ""
            slope = f"{held}; steepest one-sided slope {self.steepest:.2g} nats{along}"
        remarks = [
            ("kinks", self.kinks, " (the likelihood falls at a slope to either side)"),
            ("ridges", self.ridges, " (only peak/rise and peak/fall are known)"),
            ("at bounds", self.bounds, " (the data would take them further, or leave them open)"),
            ("no data", self.no_data, " (they stay where they were)"),
        ]
        return (
            f"{said}: {self.kind}" + (f" ({'; '.join(self.reasons)})" if self.reasons else ""),
            f"{count} ended {_span(below)} nats below the optimum, {hills}",
            f"EM alone reached an objective of {self.em_alone:.2f} nats, the search added"
            f" {self.search_gain:.2f}; {self.iterations} iterations,"
            f" {'monotone' if self.monotone else 'NOT MONOTONE'}",
            slope,
            *(f"{name}: {', '.join(of)}{means}" for name, of, means in remarks if of),
        )


def _span(values: Sequence[float]) -> str:
    low, high = f"{min(values):.2g}", f"{max(values):.2g}"
    return low if low == high else f"{low} to {high}"


def _plain(document: Mapping[str, Any]) -> dict[str, Any]:
    return {
        key: None if isinstance(value, float) and not math.isfinite(value) else value
        for key, value in document.items()
    }


def kind_of(
    degenerate: Sequence[str],
    iterations: int,
    em_converged: bool,
    steepest: float,
    monotone: bool,
    bound: bool,
) -> tuple[Kind, tuple[str, ...]]:
    """The gravest kind that holds, and all reasons for it; they are none for one that may be trusted."""
    found: list[tuple[Kind, str]] = [("degenerate", reason) for reason in degenerate]
    if not em_converged:
        found.append(("iteration limit", f"EM still rising after {iterations} iterations"))
    elif steepest > TOLERANCE:
        found.append(("slope left", f"a slope of {steepest:.3g} nats is left, above {TOLERANCE:g}"))
    if not monotone:
        found.append(("not monotone", "the objective fell on the way, which exact EM cannot do"))
    if found:
        return found[0][0], tuple(reason for _, reason in found)
    return "at a bound" if bound else "converged", ()


def remarked(marks: Mapping[str, str], filled: bool) -> dict[str, tuple[str, ...]]:
    """The marks of parameters by what is remarked; a ridge is that of an approval state.

    `filled`: mistake and the peaks sum to 1, the most that they can.
    """

    def marked(mark: str) -> tuple[str, ...]:
        return tuple(name for name, given in marks.items() if given == mark)

    ridges = tuple(dict.fromkeys(name.rsplit(".", 1)[0] for name in marked("ridge")))
    return {
        "kinks": marked("at a kink"),
        "ridges": ridges,
        "bounds": marked("at its bound") + marked(AS_NONE) + (("sum of the peaks",) if filled else ()),
        "no_data": marked("no data"),
    }


def steepest_along(slopes: Slopes, labels: Sequence[str]) -> str:
    """The direction of the greatest one-sided slope: the coordinates that it moves, with their signs.

    >>> slopes = Slopes(np.array([[0.6, -0.8]]), np.array([1.0]), np.zeros(2), np.zeros(2))
    >>> steepest_along(slopes, ["log a", "log b"])
    '+0.60 log a, -0.80 log b'
    """
    if not len(slopes.slopes):
        return ""
    direction = slopes.directions[int(slopes.slopes.argmax())]
    return named_direction(direction, labels)


def named_direction(direction: Floats, labels: Sequence[str]) -> str:
    """A direction by the coordinates that it moves; only higher or lower where it is one."""
    moved = np.flatnonzero(np.abs(direction) > 0.05).tolist()
    if len(moved) == 1:
        return f"{'higher' if direction[moved[0]] > 0 else 'lower'} {labels[moved[0]]}"
    return ", ".join(f"{direction[i]:+.2f} {labels[i]}" for i in moved)


def degeneracies(
    objective: Objective, point: Floats, marks: Mapping[str, str], names: Sequence[str], labels: Sequence[str]
) -> tuple[str, ...]:
    """Why a maximum is no estimate of a teacher: sentences, none where it is one.

    The log-likelihood is not finite; no press (and no signal instead), nothing but presses, or no cue of any
    approval state was ever seen; mistake has vanished, or every peak; the log-likelihood does not bend along
    some direction of the coordinates that are at neither kink nor bound nor ridge (the information is
    singular).
    """
    space, exposure = objective.space, objective.evidence.exposure
    if not math.isfinite(objective.value(point)):
        return ("the log-likelihood is not finite",)
    signalled = np.ptp(np.exp(exposure.lattice.event_log[:, 1:]), axis=1).any()
    if not signalled and not any(len(steps) for steps in exposure.press_steps):
        return ("no press in any trial, so nothing says what presses follow",)
    found = []
    peaks = [i for i, name in enumerate(names) if name.endswith(".peak")]
    odds = dict(zip(space.index.tolist(), point.tolist(), strict=True))
    informed = [odds[i] for i in peaks if i in odds]
    if not informed:
        found.append("no cue was ever on, so nothing was learned of the approval states")
    elif all(vanished(value) for value in informed):
        found.append("every peak has vanished, so no press is explained by a cue")
    if vanished(odds.get(0, 0.0)):
        found.append("mistake has vanished, so a robot with this model never gets over a mistake")
    if sum(map(len, exposure.press_steps)) == exposure.steps.sum():
        found.append("every step has a press, so nothing says when people wait")
    flat = flat_direction(objective, point, _smooth(objective, point, marks, names))
    if flat is not None:
        found.append(f"the log-likelihood has no peak towards {named_direction(flat, labels)}: it is flat")
    return tuple(found)


def _smooth(objective: Objective, point: Floats, marks: Mapping[str, str], names: Sequence[str]) -> list[int]:
    """The coordinates at neither kink nor bound nor ridge; where mistake and the peaks sum to 1, but the
    greatest of them, as all of their odds may grow together."""
    space = objective.space
    plain = [c for c, members in enumerate(space.members) if not any(marks[names[int(i)]] for i in members)]
    greatest = int(point[: len(space.odds)].argmax()) if full(objective, point) else -1
    return [c for c in plain if c != greatest]


def flat_direction(objective: Objective, point: Floats, smooth: Sequence[int]) -> Floats | None:
    """A direction along which the objective does not bend, by less than FLAT nats per squared unit.

    Differences of the exact rates over the `smooth` coordinates; flat counts only what loses no more than
    NO_LOSS nats 0.3 units either way. None where there is none.
    """
    if not smooth:
        return None
    chosen, space = list(smooth), objective.space
    steps = BEND_STEP * np.eye(len(point))[chosen]
    rates = [[objective.value_and_rates(point + s * step)[1][chosen] for s in (1, -1)] for step in steps]
    bend = np.array([(behind - ahead) / (2 * BEND_STEP) for ahead, behind in rates])
    sizes, axes = np.linalg.eigh((bend + bend.T) / 2)
    if sizes[0] >= FLAT:
        return None
    direction = np.zeros(len(point))
    direction[chosen] = axes[:, 0]
    ends = [np.clip(point + s * 0.3 * direction, space.least, space.most) for s in (1, -1)]
    here = objective.value(point)
    return direction if min(objective.value(end) for end in ends) > here - NO_LOSS else None
