"""Slow, plain oracles: every mental-state path and every tree, straight from MODEL.md."""

import itertools
import math
from collections.abc import Hashable, Sequence
from typing import Any

from taskcomm.teacher import TableTop, TeacherModel
from taskcomm.world import World


def move(level: float, on: bool, seconds: float, top: TableTop) -> float:
    return min(1.0, level + seconds / top.rise) if on else max(0.0, level - seconds / top.fall)


def probabilities(
    model: TeacherModel, cues: Sequence[Sequence[bool]], path: Sequence[str], pressed: Sequence[bool]
) -> dict[str, float]:
    """P(M_t = m) for every mental state, after the mental states `path` of the steps before t.

    cues[s][c] is the cue of approval c in step s (0, 1, ..., t = len(cues) - 1).
    """
    now = len(cues) - 1
    result = {"mistake": model.mistake}
    for column, (state, top) in enumerate(model.approvals.items()):

        def cue(step: int, column: int = column) -> bool:
            return step >= 0 and bool(cues[step][column])

        late = top.delay / model.dt
        n = math.floor(late + 1e-9)
        g = max(0.0, late - n)
        level, on = 0.0, 0.0
        for step in range(now + 1):
            for seen, part in ((cue(step - n - 1), g * model.dt), (cue(step - n), (1 - g) * model.dt)):
                if part > 0:
                    level = move(level, seen, part, top)
                    on = on + part if seen else 0.0
            if step < now and path[step] == state:
                level, on = 0.0, 0.0
        probability = top.peak * level
        if top.decay is not None:
            probability *= math.exp(-max(0.0, on - top.hold) / top.decay)
        presses = [step for step in range(now) if pressed[step]]
        if presses and (now - presses[-1]) * model.dt <= model.rest + 1e-9 * model.dt:
            probability = 0.0
        result[state] = probability
    result["waiting"] = 1 - sum(result.values())
    return result


def paths(
    model: TeacherModel, cues: Sequence[Sequence[bool]], pressed: Sequence[bool]
) -> dict[tuple[str, ...], float]:
    """P(path, presses) of every mental-state path that fits the presses."""
    reasons = ["mistake", *model.approvals]
    result = {}
    for path in itertools.product(*([*reasons] if press else ["waiting"] for press in pressed)):
        weight = 1.0
        for step in range(len(pressed)):
            weight *= probabilities(model, cues[: step + 1], path[:step], pressed)[path[step]]
        result[path] = weight
    return result


def cue_columns(world: World, model: TeacherModel, states: Sequence[Hashable], task: int) -> list[list[bool]]:
    rows = [list(world.cue_names).index(top.cue) for top in model.approvals.values()]
    return [[bool(table[row, task]) for row in rows] for table in (world.cues(state) for state in states)]


def joint(
    world: World,
    model: TeacherModel,
    states: Sequence[Hashable],
    pressed: Sequence[bool],
    prior: Sequence[float],
) -> list[float]:
    """P(task, presses) for every task, by enumeration."""
    return [
        prior[task] * sum(paths(model, cue_columns(world, model, states, task), pressed).values())
        for task in range(len(world.tasks))
    ]


def entropy_of(weights: Sequence[float]) -> float:
    total = sum(weights)
    return -sum(w / total * math.log(w / total) for w in weights if w > 0)


def full_tree(belief: Any, state: Hashable, horizon: int, gamma: float = 1.0) -> dict[Any, float]:
    """Q_h of every valid action, by the whole closed-loop tree over `Belief.update`."""
    if horizon == 0:
        return {}
    world: World = belief.world
    values = {}
    for action in world.actions(state):
        reached = world.step(state, action)
        p = belief.press_probability(reached)
        value = 0.0
        for pressed, probability in ((False, 1 - p), (True, p)):
            after = belief.update(reached, pressed)
            future = full_tree(after, reached, horizon - 1, gamma)
            value += probability * (after.entropy() + gamma * min(future.values(), default=0.0))
        values[action] = value
    return values
