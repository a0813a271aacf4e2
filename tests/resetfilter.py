"""The likelihood of one trial under many parameter sets at once, over every tuple of last resets.

Plain and unmerged, from MODEL.md, sections 3 and 5: it shares no code with the learner.
"""

import numpy as np
from numpy.typing import NDArray

from taskcomm.trials import Trial

Floats = NDArray[np.float64]
Levels = dict[tuple[int, int], Floats]


def log_likelihoods(trial: Trial, cue_names: list[str], vectors: Floats) -> Floats:
    """Nats, shape (B,), for `vectors` (B, at least 1 + 4 M): mistake, peaks, rises, falls, delays."""
    states, dt, task = len(cue_names), trial.dt, list(trial.world.tasks).index(trial.task)
    rows = [list(trial.world.cue_names).index(name) for name in cue_names]
    cues = np.array([[trial.world.cues(state)[row, task] for row in rows] for state in trial.states])
    mistake, (peak, rise, fall, delay) = (
        vectors[:, 0],
        vectors[:, 1 : 1 + 4 * states].T.reshape(4, states, -1),
    )
    late = np.floor(delay / dt + 1e-9).astype(int)
    early = np.maximum(0.0, delay - late * dt)
    never = (-1,) * states
    weights = {never: np.ones(len(vectors))}
    levels: Levels = {(m, -1): np.zeros(len(vectors)) for m in range(states)}
    total = np.zeros(len(vectors))
    for t, pressed in enumerate(trial.presses):
        for (m, reset), level in levels.items():
            for back, seconds in ((late[m] + 1, early[m]), (late[m], dt - early[m])):
                on = np.where(t - back >= 0, cues[np.maximum(t - back, 0), m], False)
                up, down = np.minimum(1, level + seconds / rise[m]), np.maximum(0, level - seconds / fall[m])
                level = np.where(on, up, down)
            levels[m, reset] = level
        following: dict[tuple[int, ...], Floats] = {}
        for memory, weight in weights.items():
            approvals = [peak[m] * levels[m, memory[m]] for m in range(states)]
            if not pressed:
                following[memory] = weight * (1 - mistake - sum(approvals))
                continue
            following[memory] = following.get(memory, 0.0) + weight * mistake
            for m, approval in enumerate(approvals):
                if approval.any():
                    after = (*memory[:m], t, *memory[m + 1 :])
                    following[after] = following.get(after, 0.0) + weight * approval
        if pressed:
            levels |= {(m, t): np.zeros(len(vectors)) for m in range(states)}
        norm = np.sum(list(following.values()), axis=0)
        total += np.log(norm)
        weights = {memory: weight / norm for memory, weight in following.items()}
    return total
