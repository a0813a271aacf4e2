"""A World without balls: a waiter points at dishes until it knows which one the guest wants."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taskcomm.teacher import TableTop, TeacherModel

MENU_CUES = ("pointed_at", "served", "neighbour_pointed_at", "anything_pointed_at", "nothing_served")


@dataclass(frozen=True)
class Menu:
    """State: (dish pointed at, dish served), "" for none. Tasks, states and actions are text and tuples."""

    tasks: tuple[str, ...] = ("soup", "pizza", "paella", "crêpe")
    cue_names: tuple[str, ...] = MENU_CUES

    def start(self) -> tuple[str, str]:
        return "", ""

    def actions(self, state: tuple[str, str]) -> list[str]:
        pointed, served = state
        serve = [f"serve {pointed}"] if pointed and served != pointed else []
        return ["wait", *(f"point at {dish}" for dish in self.tasks if dish != pointed), *serve]

    def step(self, state: tuple[str, str], action: str) -> tuple[str, str]:
        verb, _, dish = action.partition(" ")
        if verb == "point":
            return dish.removeprefix("at "), state[1]
        return (state[0], dish) if verb == "serve" else state

    def cues(self, state: tuple[str, str]) -> NDArray[np.bool_]:
        pointed, served = (np.array([dish == at for dish in self.tasks]) for at in state)
        anything, nothing = (
            np.full(len(self.tasks), pointed.any()),
            np.full(len(self.tasks), not served.any()),
        )
        return np.stack([pointed, served, np.roll(pointed, 1), anything, nothing])[: len(self.cue_names)]

    def is_goal(self, state: tuple[str, str], task: str) -> bool:
        return state[1] == task


def menu(num_cues: int = 1) -> tuple[Menu, TeacherModel]:
    """The menu with its first cues, and a teacher with one approval state for each of the first three."""
    tops = {
        f"approves_{cue}": TableTop(cue, peak=0.3 / (row + 1), rise=1.0 + row, fall=1.5)
        for row, cue in enumerate(MENU_CUES[: min(num_cues, 3)])
    }
    return Menu(cue_names=MENU_CUES[:num_cues]), TeacherModel(mistake=0.01, approvals=tops)
