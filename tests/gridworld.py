"""A World without end: a walk on the plane, where each place shows something else."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MOVES = ((0, 0), (1, 0), (0, 1), (-1, -1), (1, -1))


@dataclass(frozen=True)
class Plane:
    """State: (x, y). Two to five moves are valid, by the place; at the start there are two."""

    num_tasks: int = 4
    num_cues: int = 3
    seed: int = 0

    @property
    def tasks(self) -> range:
        return range(self.num_tasks)

    @property
    def cue_names(self) -> tuple[str, ...]:
        return tuple(f"cue_{number}" for number in range(self.num_cues))

    def start(self) -> tuple[int, int]:
        return 0, 0

    def actions(self, state: tuple[int, int]) -> tuple[tuple[int, int], ...]:
        x, y = state
        return MOVES[: 2 + (3 * x * x + 5 * abs(y)) % 4]

    def step(self, state: tuple[int, int], action: tuple[int, int]) -> tuple[int, int]:
        return state[0] + action[0], state[1] + action[1]

    def cues(self, state: tuple[int, int]) -> NDArray[np.bool_]:
        rng = np.random.default_rng([self.seed, *(coordinate + 10**6 for coordinate in state)])
        shown = rng.random((self.num_cues, self.num_tasks)) < 0.3
        return np.asarray(shown[:, np.sort(rng.integers(0, self.num_tasks, self.num_tasks))])
