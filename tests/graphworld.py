"""A World that is a random graph: nothing in it has a meaning, and much in it is alike."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Bools = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class GraphWorld:
    """State s leads to `after[s][action]` and shows `shown[s]` (cues, tasks)."""

    tasks: tuple[int, ...]
    cue_names: tuple[str, ...]
    after: tuple[tuple[int, ...], ...]
    shown: tuple[Bools, ...]

    def start(self) -> int:
        return 0

    def actions(self, state: int) -> range:
        return range(len(self.after[state]))

    def step(self, state: int, action: int) -> int:
        return self.after[state][action]

    def cues(self, state: int) -> Bools:
        return self.shown[state]


def graph_world(
    rng: np.random.Generator, most_tasks: int = 6, most_actions: int = 5, num_cues: int = 4
) -> GraphWorld:
    """1 to `most_tasks` tasks and 1 to `most_actions` actions in each of 1 to 12 states.

    Tasks may show the same always, or in some states only; actions may lead to the same state.
    """
    states, tasks = int(rng.integers(1, 13)), int(rng.integers(1, most_tasks + 1))
    kinds = rng.integers(0, tasks, tasks)
    if rng.random() < 0.5:
        kinds.sort()  # tasks alike lie side by side
    often = rng.choice([0.15, 0.5, 0.85])
    tables = rng.random((states, num_cues, tasks)) < often
    tables[:] = tables[:, :, kinds]
    if rng.random() < 0.3:
        tables[:] = tables[rng.integers(0, states, states)]
    after = [
        tuple(int(to) for to in rng.integers(0, states, rng.integers(1, most_actions + 1)))
        for _ in range(states)
    ]
    names = tuple(f"cue_{number}" for number in range(num_cues))
    return GraphWorld(tuple(range(tasks)), names, tuple(after), tuple(tables))
