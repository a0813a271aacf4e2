"""A planner that decides once in every situation, for many trials with the same robot."""

import hashlib
from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from taskcomm.belief import Belief
from taskcomm.planner import EntropyPlanner
from taskcomm.teacher import TeacherModel
from taskcomm.world import World


class Remembered(NamedTuple):
    """A decision without its plan: how far it looked, and the wall time it took when it was made."""

    action: Any
    horizon: int
    seconds: float


@dataclass
class Remembering:
    """An EntropyPlanner that gives again what it decided in the same situation, in whatever trial.

    A situation is the world state and the belief, to the last bit. All trials begin alike, and go on so until
    the teachers' presses part them; the decisions are those of the planner itself, whose ties must go to the
    first. `made` are the decisions of the trial so far, `anew` is how many of them were not remembered. A
    decision with a deadline depends on the moment too, and is never remembered. Raises ValueError for
    a planner with random ties.
    """

    planner: EntropyPlanner
    made: list[Remembered] = field(default_factory=list)
    anew: int = 0
    _known: dict[tuple[Hashable, bytes], Remembered] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        if self.planner.ties != "first":
            raise ValueError(f"ties: {self.planner.ties!r} cannot be remembered, only 'first'")

    @property
    def world(self) -> World:
        """The world of the planner."""
        return self.planner.world

    @property
    def model(self) -> TeacherModel:
        """The teacher model of the planner."""
        return self.planner.model

    @property
    def horizon(self) -> int:
        """How many steps the planner looks ahead, or may with a deadline."""
        return self.planner.horizon

    def reset(self, _rng: object = None) -> None:
        """Begin a trial: forget what was made in the last one, not what was decided."""
        self.made, self.anew = [], 0

    def plan(self, belief: Belief, state: Hashable, deadline: float | None = None) -> Remembered:
        """The planner's decision, made now or before."""
        situation = state, fingerprint(belief)
        found = self._known.get(situation)
        if found is None:
            decision = self.planner.plan(belief, state, deadline=deadline)
            found = Remembered(decision.action, decision.horizon, decision.seconds)
            self.anew += 1
            if deadline is None:
                self._known[situation] = found
        self.made.append(found)
        return found


def fingerprint(belief: Belief) -> bytes:
    """Of all that a decision depends on in a belief, for one world and model."""
    rested = min(belief.since_press, belief.parameters.rest_steps)
    found = hashlib.blake2b(rested.to_bytes(8, "little"), digest_size=16)
    for array in (belief.task, belief.weight, belief.level, belief.on_time, belief.seen):
        found.update(array.tobytes())
    return found.digest()
