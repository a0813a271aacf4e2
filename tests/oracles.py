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


def observed(
    world: Any, model: TeacherModel, task: int, state: str, pressed: bool | None, signals: dict[str, Any]
) -> float:
    """P(key, signals | M = state, task) of one step; what is not observed is summed over."""
    seen: Any = model.observation
    p = seen.false_press if state == "waiting" else 1 - seen.miss
    result = 1.0 if pressed is None else p if pressed else 1 - p
    for name, channel in seen.channels.items():
        if channel.kind == "plain" and name in signals:
            result *= channel.table[state][signals[name]]
        if channel.kind == "target":
            about = {other: c for other, c in seen.channels.items() if getattr(c, "target", None) == name}
            result *= _about_target(world, task, channel.table[state], state, name, about, signals)
        if channel.kind == "normal" and channel.target is None and name in signals:
            result *= _normal(signals[name], channel.mean[state], channel.sd[state])
    return result


def _about_target(
    world: Any, task: int, row: Any, state: str, name: str, about: dict[str, Any], signals: dict[str, Any]
) -> float:
    roles = {**world.roles(world.tasks[task]), "none": "none"}
    present = sum(row[role] for role in set(roles.values()))
    total = 0.0
    for value, role in roles.items():
        if name in signals and signals[name] != value:
            continue
        p = row[role] / list(roles.values()).count(role) / present
        for other, channel in about.items():
            if other in signals and role in channel.mean[state]:
                p *= _normal(signals[other], channel.mean[state][role], channel.sd[state][role])
            elif other in signals and name not in signals:
                p = 0.0  # no number would have been measured
        total += p
    return total


def _normal(x: float, mean: float, sd: float) -> float:
    return math.exp(-0.5 * ((x - mean) / sd) ** 2) / (sd * math.sqrt(2 * math.pi))


def observed_paths(
    world: World, model: TeacherModel, states: Sequence[Hashable], seen: Sequence[Any], task: int
) -> dict[tuple[str, ...], float]:
    """P(path, observations | task) of every mental-state path; `seen` has (pressed, signals) by step."""
    cues = cue_columns(world, model, states, task)
    pressed = [bool(key) for key, _ in seen]
    result = {}
    for path in itertools.product(model.mental_states, repeat=len(seen)):
        weight = 1.0
        for step, (key, signals) in enumerate(seen):
            weight *= observed(world, model, task, path[step], key, signals or {})
            if weight == 0:
                break
            weight *= probabilities(model, cues[: step + 1], path[:step], pressed)[path[step]]
        else:
            result[path] = weight
    return result


def branching_tree(
    belief: Any, state: Hashable, horizon: int, gamma: float = 1.0, outcomes: Any = None
) -> dict[Any, float]:
    """Q_h of every valid action, by the whole tree over key and every value of the discrete channels."""
    if horizon == 0:
        return {}
    world: World = belief.world
    outcomes = _outcomes(world, belief.model) if outcomes is None else outcomes
    values = {}
    for action in world.actions(state):
        reached = world.step(state, action)
        now = belief.mental_joint(reached).tolist()
        value = 0.0
        for pressed, signals, table in outcomes:
            probability = sum(
                p * q for row, other in zip(now, table, strict=True) for p, q in zip(row, other, strict=True)
            )
            if probability > 0:
                after = belief.update(reached, pressed, signals)
                future = branching_tree(after, reached, horizon - 1, gamma, outcomes)
                value += probability * (after.entropy() + gamma * min(future.values(), default=0.0))
        values[action] = value
    return values


def _outcomes(world: Any, model: TeacherModel) -> list[Any]:
    """Key, signals, and P(both | task, M) of everything that may be observed in a step."""
    discrete: dict[str, list[str]] = {}
    channels: dict[str, Any] = dict(model.observation.channels)
    for name, channel in channels.items():
        if channel.kind == "plain":
            discrete[name] = list(channel.values)
        elif channel.kind == "target":
            discrete[name] = [*world.roles(world.tasks[0]), "none"]
    found = []
    keys: list[Any] = [False, True]
    for pressed, *shown in itertools.product(keys, *discrete.values()):
        signals = dict(zip(discrete, shown, strict=True))
        table = [
            [observed(world, model, task, mental, pressed, signals) for mental in model.mental_states]
            for task in range(len(world.tasks))
        ]
        found.append((pressed, signals, table))
    return found
