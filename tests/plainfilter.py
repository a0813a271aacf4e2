"""The filter of MODEL.md, section 5, as loops over a dictionary: slow, plain, good for long trials."""

import math
from collections.abc import Hashable, Sequence
from typing import NamedTuple

from oracles import cue_columns, move

from taskcomm.teacher import TableTop, TeacherModel
from taskcomm.world import World


class Memory(NamedTuple):
    level: float = 0.0
    on: float = 0.0


def moved(memory: Memory, top: TableTop, cues: Sequence[bool], dt: float) -> Memory:
    """Memory of one approval state at the end of the last step of `cues`."""
    late = top.delay / dt
    whole = math.floor(late + 1e-9)
    part = max(0.0, late - whole)
    level, on = memory
    for back, share in ((whole + 1, part), (whole, 1 - part)):
        at = len(cues) - 1 - back
        seen = at >= 0 and cues[at]
        if share > 0:
            level, on = move(level, seen, share * dt, top), (on + share * dt if seen else 0.0)
    return Memory(level, on)


def approval(memory: Memory, top: TableTop) -> float:
    fading = 1.0 if top.decay is None else math.exp(-max(0.0, memory.on - top.hold) / top.decay)
    return top.peak * memory.level * fading


def marginal(
    world: World, model: TeacherModel, states: Sequence[Hashable], pressed: Sequence[bool]
) -> list[float]:
    """P(task | presses) from a uniform prior, one task after the other."""
    likelihoods = []
    for task in range(len(world.tasks)):
        cues = cue_columns(world, model, states, task)
        likelihoods.append(_likelihood(model, cues, pressed))
    return [likelihood / math.fsum(likelihoods) for likelihood in likelihoods]


def _likelihood(model: TeacherModel, cues: Sequence[Sequence[bool]], pressed: Sequence[bool]) -> float:
    tops = list(model.approvals.values())
    weights = {tuple(Memory() for _ in tops): 1.0}
    since_press = math.inf
    for step, press in enumerate(pressed):
        columns = [[row[m] for row in cues[: step + 1]] for m in range(len(tops))]
        following: dict[tuple[Memory, ...], float] = {}
        rests = (since_press + 1) * model.dt <= model.rest + 1e-9 * model.dt
        for memory, weight in weights.items():
            now = tuple(moved(*each, model.dt) for each in zip(memory, tops, columns, strict=True))
            chances = [0.0 if rests else approval(*each) for each in zip(now, tops, strict=True)]
            if press:
                branches = [(now, model.mistake)] + [
                    ((*now[:m], Memory(), *now[m + 1 :]), chance) for m, chance in enumerate(chances)
                ]
            else:
                branches = [(now, 1 - model.mistake - sum(chances))]
            for branch, chance in branches:
                following[branch] = following.get(branch, 0.0) + weight * chance
        weights, since_press = following, 0 if press else since_press + 1
    return math.fsum(weights.values())
