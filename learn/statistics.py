"""What informed each parameter, and what the data leave open: ridges, kinks, bounds, no data."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from learn.coordinates import LEAST_ODDS, NAMES, Coordinates, names_of, parameters_at
from learn.estep import Expectation
from learn.mstep import Objective
from learn.optimum import TOLERANCE, Slopes
from taskcomm.lattice import Floats

BELOW_FULL = 1 - 1e-9


class Informed(NamedTuple):
    """Expected steps and presses that each natural parameter bears on, (1 + 4 M,), and the highest
    level that each approval state has shown, (M,)."""

    steps: Floats
    presses: Floats
    reached: Floats


def informed(objective: Objective, vector: Floats, expectation: Expectation) -> Informed:
    """What informed each parameter at `vector`; leaves the chain's levels at `vector`."""
    from learn import _slopes

    chain, states = objective.evidence.chain, (len(vector) - 1) // 4
    chain.trace(parameters_at(vector, objective.base))
    steps, presses, reached = np.zeros((5, states)), np.zeros((5, states)), np.zeros(states)
    _slopes.informed(
        chain.lattice, chain.share, chain.slope, expectation.memory, expectation.press, steps, presses,
        reached,
    )  # fmt: skip

    def flat(counts: Floats) -> Floats:
        return np.concatenate([counts[4, :1], counts[:4].ravel()])

    return Informed(flat(steps), flat(presses), reached)


def settle(objective: Objective, point: Floats) -> Floats:
    """A point of equal objective that claims less: what the data do not move goes back.

    A rise, fall or delay that no step bears on returns to the initial model's. On a ridge (a level
    that never reached 1) peak, rise and fall shrink together until the highest level reached is 1:
    the peak is then the greatest probability that was shown, and none is claimed beyond it.
    """
    space = objective.space
    vector = space.vector(point)
    seen = informed(objective, vector, objective.expect(point))
    states = len(seen.reached)
    back = vector.copy()
    idle = space.free & (seen.steps == 0)
    idle[: 1 + states] = False
    back[idle] = space.base[idle]
    for m in range(states):
        rows = [1 + m, 1 + states + m, 1 + 2 * states + m]
        if 0 < seen.reached[m] < BELOW_FULL and space.free[rows].all():
            shrink = max(seen.reached[m], space.dt / back[rows[1]], space.dt / back[rows[2]])
            back[rows] *= min(1.0, shrink)
    settled = space.point(back)
    kept = objective.value(settled) >= objective.value(point) - 1e-9
    return settled if kept else point


def marks_of(
    space: Coordinates, point: Floats, slopes: Slopes, seen: Informed, states: Sequence[str]
) -> dict[str, str]:
    """A remark for each natural parameter, "" where there is none."""
    names = names_of(states)
    marks = dict.fromkeys(names, "")
    for i, name in enumerate(names):
        if not space.free[i]:
            no_cue = name.split(".")[-1] in NAMES[:3]
            marks[name] = "no data" if no_cue else "fixed"
    for coordinate, i in enumerate(space.index.tolist()):
        at_bound = not space.least[coordinate] < point[coordinate] < space.most[coordinate]
        kink = min(-slopes.up[coordinate], -slopes.down[coordinate]) > TOLERANCE
        vanishing = i < 1 + len(states) and point[coordinate] < np.log(LEAST_ODDS * 100)
        if seen.steps[i] == 0:
            marks[names[i]] = "no data"
        elif at_bound or vanishing:
            marks[names[i]] = "at its bound"
        elif kink:
            marks[names[i]] = "at a kink"
    for m in range(len(states)):
        rows = [1 + m, 1 + len(states) + m, 1 + 2 * len(states) + m]
        if 0 < seen.reached[m] < BELOW_FULL and space.free[rows].all():
            for i in rows:
                marks[names[i]] = "ridge"
    return marks


def remarks_of(marks: Mapping[str, str], states: Sequence[str], seen: Informed) -> tuple[str, ...]:
    """The marks as sentences."""
    sentences = {
        "at a kink": "has its best value at a kink: the likelihood falls to either side at a slope",
        "at its bound": "lies at its bound: the data would take it further, or leave it open",
        "no data": "has no data: no step bears on it, and it stays where it was",
    }
    remarks = [f"{name} {sentences[mark]}." for name, mark in marks.items() if mark in sentences]
    for m, state in enumerate(states):
        if marks[f"{state}.peak"] == "ridge":
            remarks.append(
                f"{state}: its level never reached 1 (at most {seen.reached[m]:.3g}), so only peak/rise and"
                " peak/fall are known; peak, rise and fall may grow together."
            )
    return tuple(remarks)
