"""What informed each parameter, and what the data leave open: ridges, kinks, bounds, no data."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from learn.audit import AS_NONE
from learn.coordinates import LEAST_ODDS, NAMES, Coordinates, names_of, parameters_at, states_of
from learn.estep import Expectation
from learn.mstep import Objective
from learn.optimum import TOLERANCE, Slopes
from taskcomm.lattice import Floats

BELOW_FULL = 1 - 1e-9
LONGER = 1e-6
STRETCH = 1.05
NOTHING = 1e-4  # nats; a standard error of 3.5 on the logarithm of all three
FULL, LITTLE = 1e-3, 0.1
SLIGHT = 0.1  # nats
NEARLY = 100  # times its least odds: a probability below has vanished


def vanished(log_odds: float) -> bool:
    """Whether a probability, by its odds against waiting, has gone as near to 0 as it can, or nearly."""
    return log_odds < math.log(LEAST_ODDS * NEARLY)


def full(objective: Objective, point: Floats) -> bool:
    """Whether mistake and the peaks sum to 1, the most that they can, or might as well.

    Next to none is left, or less than LITTLE is, and none could be at a loss of no more than SLIGHT nats.
    """
    space = objective.space
    left = 1 - float(space.vector(point)[: 1 + space.states].sum())
    odds = np.arange(len(point)) < len(space.odds)
    summed = np.clip(point + np.where(odds, 7.0, 0.0), space.least, space.most)
    return left < FULL or (left < LITTLE and objective.value(summed) > objective.value(point) - SLIGHT)


class Informed(NamedTuple):
    """Expected steps and presses that each natural parameter bears on, (1 + 6 M,), and the highest
    level that each approval state has shown, (M,)."""

    steps: Floats
    presses: Floats
    reached: Floats


def informed(objective: Objective, vector: Floats, expectation: Expectation) -> Informed:
    """What informed each parameter at `vector`; leaves the chain's levels at `vector`.

    A rise or fall of one step is as short as it can be and has no slope of its own; it is informed by the
    steps that a slightly longer one would change. Nothing informs the times of a peak that has vanished.
    """
    from learn import _slopes

    vanishing = LEAST_ODDS * NEARLY
    chain, states = objective.evidence.chain, states_of(vector)

    def counted(at: Floats) -> Informed:
        parameters = parameters_at(at, objective.base)
        chain.trace(parameters)
        steps, presses, reached = np.zeros((7, states)), np.zeros((7, states)), np.zeros(states)
        _slopes.informed(
            chain.lattice, chain.courses, chain.share, chain.slope, expectation.memory, expectation.press,
            steps, presses, reached,
        )  # fmt: skip
        reached[np.isfinite(parameters.decay) & (reached > 0)] = 1.0  # a plateau that decays hides it
        gone = at[1 : 1 + states] < vanishing * (1 - at[: 1 + states].sum())
        for counts in (steps, presses):
            counts[1:6, gone] = 0.0  # without a peak no time changes anything
        flat = [np.concatenate([counts[6, :1], counts[:6].ravel()]) for counts in (steps, presses)]
        return Informed(flat[0], flat[1], reached)

    longer, times = vector.copy(), slice(1 + states, 1 + 3 * states)
    longer[times] = np.maximum(vector[times], objective.space.dt * (1 + LONGER))
    beside, here = counted(longer), counted(vector)
    at_least = np.where(longer > vector, beside.steps, here.steps)
    return Informed(at_least, np.where(longer > vector, beside.presses, here.presses), here.reached)


def settle(objective: Objective, point: Floats) -> Floats:
    """A point of equal objective that claims less: what the data do not move goes back.

    A time that no step bears on returns to the initial model's or, where that one is less likely, goes to
    its least value. On a ridge (a level
    that never reached 1) peak, rise and fall shrink together until the highest level reached is 1:
    the peak is then the greatest probability that was shown, and none is claimed beyond it.
    """
    space = objective.space
    vector, value = space.vector(point), objective.value(point)
    seen = informed(objective, vector, objective.expect(point))
    states = len(seen.reached)
    gone = vector[1 : 1 + states] < LEAST_ODDS * NEARLY * (1 - vector[: 1 + states].sum())

    def kept(rows: list[int], values: Floats, loss: float = 1e-9) -> Floats:
        changed = vector.copy()
        changed[rows] = values
        return changed if objective.value(space.point(changed)) >= value - loss else vector

    allowed = 1e-9 + 2 * float(vector[1 : 1 + states] @ (seen.steps[1 : 1 + states] * gone))
    for members in space.members:
        rows = members.tolist()
        if rows[0] > states and not seen.steps[rows].any():
            before, vector = vector, kept(rows, space.base[rows], allowed)
            if vector is before:  # none near this one matters, but the initial one does
                vector = kept(rows, np.full(len(rows), space.shortest(rows[0])), allowed)
    for m in range(states):
        rows = [1 + m, 1 + states + m, 1 + 2 * states + m]
        if 0 < seen.reached[m] < BELOW_FULL and space.free[rows].all() and not gone[m]:
            shrink = max(seen.reached[m], space.dt / vector[rows[1]], space.dt / vector[rows[2]])
            vector = kept(rows, vector[rows] * min(1.0, shrink), allowed)
    settled = space.point(vector)
    return settled if objective.value(settled) >= value - allowed else point


def ridges(objective: Objective, point: Floats) -> list[bool]:
    """Whether peak, rise and fall of each approval state can grow together and change next to nothing.

    By 5%, with no more than NOTHING nats lost: memories in which its level does reach 1 may be possible
    and have next to no weight.
    """
    space, value = objective.space, objective.value(point)
    vector = space.vector(point)
    states = states_of(vector)
    result = []
    for m in range(states):
        rows = [1 + m, 1 + states + m, 1 + 2 * states + m]
        stretch = min(STRETCH, *(space.longest[rows[1:]] / vector[rows[1:]]))
        stretched = vector.copy()
        stretched[rows] *= stretch
        fits = space.free[rows].all() and stretch > 1 + LONGER and stretched[: 1 + states].sum() < 1
        same = fits and abs(objective.value(space.point(stretched)) - value) < NOTHING
        result.append(bool(same))
    return result


def idle_decays(objective: Objective, point: Floats) -> list[bool]:
    """Whether each coordinate is a decay without which no more than SLIGHT nats would be lost."""
    space, value = objective.space, objective.value(point)
    result = []
    for kind, members in zip(space.kinds, space.members, strict=True):
        loss = math.inf
        if kind == "decay":
            vector = space.vector(point)
            vector[members] = math.inf
            without = objective.evidence.value(parameters_at(vector, objective.base))
            loss = value - without - objective.log_prior(vector)
        result.append(loss < SLIGHT)
    return result


def marks_of(
    space: Coordinates,
    point: Floats,
    slopes: Slopes,
    seen: Informed,
    ridge: Sequence[bool],
    idle: Sequence[bool],
    states: Sequence[str],
) -> dict[str, str]:
    """A remark for each natural parameter, "" where there is none; `ridge` by approval state, `idle` by
    coordinate."""
    names = names_of(states)
    marks, base = dict.fromkeys(names, ""), space.point(space.base)
    for i, name in enumerate(names):
        if not space.free[i]:
            no_cue = name.split(".")[-1] in NAMES[:3]
            marks[name] = "no data" if no_cue else "fixed"
    for coordinate, members in enumerate(space.members):
        at_bound = not space.least[coordinate] < point[coordinate] < space.most[coordinate]
        kink = min(-slopes.up[coordinate], -slopes.down[coordinate]) > TOLERANCE
        gone = space.kinds[coordinate] == "odds" and vanished(point[coordinate])
        mark = "at its bound" if at_bound or gone else "at a kink" if kink else ""
        if not seen.steps[members].any():
            same = math.isclose(point[coordinate], base[coordinate], rel_tol=1e-9, abs_tol=1e-9)
            mark = "no data" if same or coordinate == 0 else "at its bound" if at_bound else "flat"
        elif idle[coordinate]:
            mark = AS_NONE
        for i in members.tolist():
            marks[names[i]] = mark
    for m, state in enumerate(states):
        if ridge[m] and marks[f"{state}.peak"] == "":
            for name in NAMES[:3]:
                marks[f"{state}.{name}"] = marks[f"{state}.{name}"].replace("at a kink", "") or "ridge"
    return marks


def remarks_of(marks: Mapping[str, str], states: Sequence[str], filled: bool) -> tuple[str, ...]:
    """The marks as sentences, and one where mistake and the peaks sum to 1 (`filled`)."""
    sentences = {
        "at a kink": "has its best value at a kink: the likelihood falls to either side at a slope",
        "at its bound": "lies at its bound: the data would take it further, or leave it open",
        AS_NONE: "says no more than no decay at all: without it the presses are as likely",
        "flat": "has no data where it is: nothing near it changes the likelihood",
        "no data": "has no data: no step bears on it, and it stays where it was",
    }
    told = {name: mark for name, mark in marks.items() if mark in sentences}
    remarks = []
    if told.get("mistake") == "no data":
        remarks.append(
            "mistake has no data: no step has every level at 0, so little but its prior bears on it."
        )
        del told["mistake"]
    remarks += [f"{name} {sentences[mark]}." for name, mark in told.items()]
    remarks += [
        f"{state}: its peak has vanished: no press is laid to its cue, and nothing is known of its times."
        for state in states
        if marks[f"{state}.peak"] == "at its bound" and marks[f"{state}.rise"] == "no data"
    ]
    remarks += [
        f"{state}: its level is never held at 1, so only peak/rise and peak/fall are known; peak, rise and"
        " fall may grow together, and the smallest that fit are given."
        for state in states
        if marks[f"{state}.peak"] == "ridge"
    ]
    if filled:
        remarks.append("mistake and the peaks sum to 1, the most that they can, or might as well.")
    return tuple(remarks)
