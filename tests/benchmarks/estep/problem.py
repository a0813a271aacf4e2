"""The likelihood that other packages can express too: one cue, always on, levels on a grid.

With rise = fall = 2 s and steps of 0.5 s a level stands at 0, .25, .5, .75 or 1, and what may happen next is
the same at every step: a Markov chain over (level reached, mental state) with a constant transition matrix.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taskcomm.cueworld import CueWorld
from taskcomm.simulate import SimulatedTeacher
from taskcomm.teacher import TableTop, TeacherModel
from taskcomm.trials import Step, Trial

Floats = NDArray[np.float64]
WORLD = CueWorld(("on",))
MODEL = TeacherModel(mistake=0.005, approvals={"approves": TableTop("on", peak=0.1, rise=2.0, fall=2.0)})
MENTAL = ("waiting", "mistake", "approves")
SEED = 11


@dataclass(frozen=True)
class Chain:
    """The chain over (level reached, mental state): every step moves on, is observed, and resets.

    `start` (S,), `matrix` (S, S), rows from; `mental` (S,) is the mental state, an index of `MENTAL`, and
    `press` (2, S) is P(observation | state), no press first.
    """

    start: Floats
    matrix: Floats
    mental: NDArray[np.int64]
    press: Floats


def expanded(model: TeacherModel = MODEL) -> Chain:
    """The chain of a model with one state, its cue always on; levels that no step reaches are left out."""
    (top,) = model.approvals.values()
    ups = round(top.rise / model.dt)
    if not np.isclose(ups * model.dt, top.rise) or top.delay or top.decay is not None or model.rest:
        raise ValueError(f"{model}: its levels are on no grid, or its memory is longer")
    states = [(level, mental) for level in range(1, ups + 1) for mental in range(len(MENTAL))]
    drawn = {}
    for level in range(1, ups + 1):
        approves = top.peak * level / ups
        drawn[level] = (1 - model.mistake - approves, model.mistake, approves)
    matrix = np.zeros((len(states), len(states)))
    for row, (level, now) in enumerate(states):
        reached = min(ups, 1 + (0 if now == 2 else level))
        for column, (other, then) in enumerate(states):
            matrix[row, column] = drawn[other][then] if other == reached else 0.0
    start = np.array([drawn[1][then] if level == 1 else 0.0 for level, then in states])
    mental = np.array([then for _, then in states])
    return Chain(start, matrix, mental, np.stack([mental == 0, mental != 0]).astype(np.float64))


def simulated(trials: int, steps: int, model: TeacherModel = MODEL) -> tuple[Trial, ...]:
    """Simulated trials of equal length in which the cue is on from the first step."""
    show, rng, made = WORLD.show(["on"]), np.random.default_rng(SEED), []
    shown = WORLD.step(WORLD.start(), show)
    teacher = SimulatedTeacher(WORLD, model, WORLD.tasks[0])
    for number in range(trials):
        teacher.reset()
        pressed = [teacher.observe(shown, rng) for _ in range(steps)]
        made.append(Trial(f"{number}", WORLD, WORLD.tasks[0], tuple(Step(show, press) for press in pressed)))
    return tuple(made)


def write(path: Path, trials: tuple[Trial, ...], model: TeacherModel = MODEL) -> None:
    """The problem as arrays: `presses` (trials, steps) and the chain."""
    chain = expanded(model)
    given: dict[str, Any] = {name: getattr(chain, name) for name in ("start", "matrix", "mental", "press")}
    np.savez(path, presses=np.array([trial.presses for trial in trials]), **given)


def by_loops(chain: Chain, presses: NDArray[np.bool_]) -> tuple[float, Floats]:
    """Log-likelihood of one trial, and P(mental state | trial) at its presses, in plain numpy."""
    emitted = chain.press[presses.astype(np.int64)]
    ahead, filtered, total = chain.start, [], 0.0
    for row in emitted:
        joint = ahead * row
        total += float(np.log(joint.sum()))
        filtered.append(joint / joint.sum())
        ahead = filtered[-1] @ chain.matrix
    after, smoothed = np.ones(len(chain.start)), []
    for now, row in zip(reversed(filtered), reversed(emitted), strict=True):
        smoothed.append(now * after / (now @ after))
        after = chain.matrix @ (row * after)
        after /= after.max()
    by_mental = np.stack(
        [np.array(smoothed[::-1])[:, chain.mental == m].sum(axis=1) for m in range(3)], axis=1
    )
    return total, by_mental[presses]
