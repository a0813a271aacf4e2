"""A World of cues alone: what a cue table says of a trial, so that it needs no World of its own."""

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taskcomm.teacher import TableTop, TeacherModel
from taskcomm.world import InvalidAction

MOST_LISTED = 12
STEP = 0.5  # the step, in s, that the intuitive model's probabilities are stated for


@dataclass(frozen=True, slots=True)
class Show:
    """The action of showing these cues, and no others, until the next action.

    >>> Show(frozenset({"tone", "light"}))
    show(light, tone)
    """

    cues: frozenset[str]

    def __str__(self) -> str:
        return f"show({', '.join(sorted(self.cues))})"

    __repr__ = __str__


@dataclass(frozen=True)
class CueWorld:
    """Cues that are on or off, in any combination, and one task.

    The state is the set of cues that are on, at first none; the action `Show(cues)` sets it. `cues(state)`
    has shape (cues, 1), rows as `cue_names`. A trial of anybody's data is a trial in this world: its
    steps show what was on when. There is nothing to find out here, so no planner has a use for it.

    Raises ValueError for cue names that are none or that actions could not be written with,
    InvalidAction for a cue that the world does not have.

    >>> world = CueWorld(("light", "tone"))
    >>> world.cues(world.step(world.start(), world.show(["tone"]))).ravel().tolist()
    [False, True]
    """

    cue_names: tuple[str, ...]

    tasks = ("the one task",)

    def __post_init__(self) -> None:
        names = tuple(self.cue_names)
        if not names:
            raise ValueError("cue_names: at least one cue")
        for name in names:
            if not isinstance(name, str) or not name or name != name.strip() or set(name) & set(",()\n"):
                raise ValueError(
                    f"cue_names: {name!r} cannot name a cue: no comma, parenthesis or blank at its ends"
                )
            if names.count(name) > 1:
                raise ValueError(f"cue_names: {name!r} is there twice")
        object.__setattr__(self, "cue_names", names)

    def spec(self) -> dict[str, Any]:
        """What a log says of this world."""
        return {"name": "CueWorld", "cue_names": list(self.cue_names)}

    def show(self, cues: Iterable[str]) -> Show:
        """The action that shows these cues."""
        return Show(frozenset(cues))

    def start(self) -> frozenset[str]:
        """Nothing is on."""
        return frozenset()

    def actions(self, state: Hashable) -> Sequence[Show]:
        """Every combination of cues, the fewest first; ValueError where they are too many to list."""
        if len(self.cue_names) > MOST_LISTED:
            raise ValueError(f"{len(self.cue_names)} cues have too many combinations to list")
        sizes = range(len(self.cue_names) + 1)
        return [self.show(chosen) for size in sizes for chosen in combinations(self.cue_names, size)]

    def step(self, state: Hashable, action: Show) -> frozenset[str]:
        """The cues that are on after `action`, whatever was on before."""
        if not isinstance(action, Show) or not action.cues <= set(self.cue_names):
            raise InvalidAction(f"{action} is not valid in a world of the cues {', '.join(self.cue_names)}")
        return action.cues

    def cues(self, state: frozenset[str]) -> NDArray[np.bool_]:
        """Which cue is on, shape (cues, 1)."""
        return np.array([[name in state] for name in self.cue_names])


def intuitive_for(world: CueWorld, dt: float) -> TeacherModel:
    """A model set from intuition for a cue table with steps of `dt` seconds: where a fit may start.

    Each cue drives one approval state, `that_` and its name. As in the paper's model, in half a second a
    mistake has probability 0.005 and each peak is 0.1, or less where there are more than three cues, so
    that together they stay at 0.3; rise and fall are 2 s. Another `dt` is a conversion, see
    `TeacherModel.with_dt`.

    >>> intuitive_for(CueWorld(("light",)), 0.5).approvals["that_light"].peak
    0.1
    """
    peak = min(0.1, 0.3 / len(world.cue_names))
    tops = {f"that_{name}": TableTop(name, peak=peak, rise=2.0, fall=2.0) for name in world.cue_names}
    note = {"made_by": "taskcomm.cueworld.intuitive_for"}
    model = TeacherModel(mistake=0.005, approvals=tops, dt=STEP, provenance=note)
    return model if dt == STEP else model.with_dt(dt)
