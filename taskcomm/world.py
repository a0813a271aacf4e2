"""The World protocol, and the ball world of the paper (MODEL.md, section 1)."""

import re
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple, Protocol, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from taskcomm.tasks import Task, enumerate_tasks


@runtime_checkable
class World(Protocol):
    """An observable, deterministic domain in which a task is communicated.

    A World has `tasks` (any hashable values; their order is the order of every marginal) and
    `cue_names`. `actions(state)` gives the valid actions in canonical order, `step` the next
    state, `cues(state)` a yes/no table of shape (cues, tasks): cue c is on under task theta.
    States and actions are any hashable values; `str(action)` must tell actions apart, since logs
    are written with it. A World may also have

    - `is_goal(state, task) -> bool`: the robot shows Final for `task` only where it is true
      (without it, anywhere);
    - `route(state, task) -> sequence of actions`: a shortest way to such a state (without it,
      breadth-first search finds one);
    - `spec() -> dict`: what a log needs to build the World again;
    - `alike(state) -> mapping`: for each thing in the world, the same ones in every state, a label: to
      exchange two with the same label does not change the state; and `exchanged(value, one, other)`: what
      becomes of a task or an action when two things are exchanged, which undoes itself. Tasks, actions,
      steps and cues must be those of the world with the two exchanged. Of actions that differ in nothing
      else, the planner over an exact key looks at one. A class that changes any of these must say anew what
      is alike, or the planner looks at all;
    - `roles(task) -> mapping`: the role under `task` of everything that a signal may be about (a look at a
      ball), by its name; the same names under every task.
    """

    @property
    def tasks(self) -> Sequence[Any]: ...
    @property
    def cue_names(self) -> Sequence[str]: ...
    def start(self) -> Any: ...
    def actions(self, state: Any) -> Sequence[Any]: ...
    def step(self, state: Any, action: Any) -> Any: ...
    def cues(self, state: Any) -> NDArray[np.bool_]: ...


class InvalidAction(ValueError):
    """An action that its state does not allow; the message names both."""


_ARGUMENTS = {
    "noa": (),
    "light_on": ("ball",),
    "light_off": ("ball",),
    "pick_up": ("ball",),
    "release": ("ball",),
    "slide": ("ball", "distance", "reference"),
}
_ACTION = re.compile(r"\s*([a-z_]+)\s*(?:\(\s*([\d\s,]*)\s*\))?\s*")


@dataclass(frozen=True, slots=True)
class Action:
    """One of the six actions of the paper.

    Raises ValueError for an unknown name or the wrong arguments.

    >>> Action.parse("slide(1, 4, 2)")
    slide(1, 4, 2)
    >>> Action.parse("noa") == Action("noa")
    True
    """

    name: str
    ball: int | None = None
    distance: int | None = None
    reference: int | None = None

    def __post_init__(self) -> None:
        if self.name not in _ARGUMENTS:
            raise ValueError(f"unknown action {self.name!r}; one of {', '.join(_ARGUMENTS)}")
        for field in ("ball", "distance", "reference"):
            value, wanted = getattr(self, field), field in _ARGUMENTS[self.name]
            if wanted and (type(value) is not int or value < 1):
                raise ValueError(f"{self.name}: {field} must be a whole number from 1, not {value!r}")
            if not wanted and value is not None:
                raise ValueError(f"{self.name} takes no {field}")

    @classmethod
    def parse(cls, text: str) -> "Action":
        """The action that prints as `text`."""
        match = _ACTION.fullmatch(text)
        if match is None:
            raise ValueError(f"not an action: {text!r}")
        name, inside = match[1], match[2] or ""
        parts = [part.strip() for part in inside.split(",")] if inside.strip() else []
        fields = _ARGUMENTS.get(name)
        if fields is None or len(parts) != len(fields) or not all(part.isdigit() for part in parts):
            raise ValueError(f"not an action: {text!r}")
        return cls(name, **dict(zip(fields, map(int, parts), strict=True)))

    def __str__(self) -> str:
        values = [str(getattr(self, field)) for field in _ARGUMENTS[self.name]]
        return f"{self.name}({', '.join(values)})" if values else self.name

    __repr__ = __str__


NOA = Action("noa")
_action = lru_cache(maxsize=1 << 14)(Action)  # an action that was made before needs no checks


class BallState(NamedTuple):
    """The world state: what is lit, held and placed, and the last action if it was a slide.

    `placements[b - 1]` is None or (reference ball, distance); `slid` is None or (ball, change of
    distance), which is all that the cue `mov_closing` needs of the last action.
    """

    lit: frozenset[int]
    held: int | None
    placements: tuple[tuple[int, int] | None, ...]
    slid: tuple[int, int] | None = None


TaskOrAction = TypeVar("TaskOrAction", Task, Action)


@dataclass(frozen=True)
class BallWorld:
    """Balls that can be lit, held and slid to a distance from one another.

    num_balls >= 2, num_distances >= 1. `slide_unheld` lets a ball slide that is not held but is
    placed, along its own reference, as the paper's text also allows. `cues(state)` has shape
    (7, tasks), rows as `cue_names`. Raises ValueError for sizes out of range and InvalidAction
    for an action that its state does not allow.

    >>> world = BallWorld()
    >>> state = world.step(world.start(), Action.parse("light_on(1)"))
    >>> world.actions(state)
    (noa, light_off(1), light_on(2), light_on(3), pick_up(1), pick_up(2), pick_up(3))

    Source: the paper, sections 3.1 (simulator) and 3.3 (actions).
    """

    num_balls: int = 3
    num_distances: int = 4
    slide_unheld: bool = False

    cue_names = (
        "mov_lit",
        "wrt_lit_while_mov_held",
        "mov_at_dist",
        "mov_held",
        "wrt_lit",
        "mov_near_wrt",
        "mov_closing",
    )

    def __post_init__(self) -> None:
        for field, least in (("num_balls", 2), ("num_distances", 1)):
            value = getattr(self, field)
            if type(value) is not int or value < least:
                raise ValueError(f"{field} must be a whole number of at least {least}, not {value!r}")

    @cached_property
    def tasks(self) -> tuple[Task, ...]:
        return enumerate_tasks(self.num_balls, self.num_distances)

    def spec(self) -> dict[str, Any]:
        """What a log says of this world; `BallWorld(**fields)` without the name builds it again."""
        spec = {"name": "BallWorld", "num_balls": self.num_balls, "num_distances": self.num_distances}
        return spec | ({"slide_unheld": True} if self.slide_unheld else {})

    def roles(self, task: Task) -> dict[str, str]:
        """What each ball ("1", "2", ...) is under `task`: mov, wrt or other."""
        named = {task.mov: "mov", task.wrt: "wrt"}
        return {str(ball): named.get(ball, "other") for ball in range(1, self.num_balls + 1)}

    def alike(self, state: BallState) -> dict[int, int]:
        """By ball, what others must have in common with it to be exchanged for it.

        Balls that are neither held nor placed nor placed at are alike if all are lit or none is.
        """
        lit, busy = state.lit, {state.held}
        for ball, placement in enumerate(state.placements, start=1):
            if placement:
                busy |= {ball, placement[0]}
        return {
            ball: ball if ball in busy else -1 if ball in lit else 0 for ball in range(1, self.num_balls + 1)
        }

    def exchanged(self, value: TaskOrAction, one: int, other: int) -> TaskOrAction:
        """A task or an action with two balls exchanged.

        >>> BallWorld().exchanged(Action.parse("slide(1, 4, 2)"), 2, 3)
        slide(1, 4, 3)
        """
        become = {one: other, other: one}
        if isinstance(value, Task):
            return Task(become.get(value.mov, value.mov), become.get(value.wrt, value.wrt), value.dist)
        ball, reference = (b and become.get(b, b) for b in (value.ball, value.reference))
        return _action(value.name, ball, value.distance, reference)

    def start(self) -> BallState:
        """Nothing lit, held or placed."""
        return BallState(frozenset(), None, (None,) * self.num_balls)

    def distance(self, state: BallState, ball: int, reference: int) -> int:
        """Distance of `ball` from `reference`: 1 to num_distances, or one more: off the scale."""
        placement = state.placements[ball - 1]
        return placement[1] if placement and placement[0] == reference else self.num_distances + 1

    def _slides(self, state: BallState, ball: int) -> list[Action]:
        placement, off = state.placements[ball - 1], self.num_distances + 1
        placed_at, at = placement if placement else (0, off)
        references = range(1, self.num_balls + 1)
        if ball != state.held:
            references = range(placed_at, placed_at + 1) if placement else range(0)
        return [
            _action("slide", ball, k, reference)
            for reference in references
            if reference != ball
            for now in (at if reference == placed_at else off,)
            for k in (now - 1, now + 1)
            if 1 <= k < off
        ]

    def actions(self, state: BallState) -> tuple[Action, ...]:
        """The valid actions in canonical order: noa, lights, pick_up or release, slides."""
        balls, lit = range(1, self.num_balls + 1), state.lit
        actions = [NOA, *(_action("light_off" if ball in lit else "light_on", ball) for ball in balls)]
        if state.held is None:
            actions += [_action("pick_up", ball) for ball in balls]
        else:
            actions.append(_action("release", state.held))
        for ball in balls if self.slide_unheld else [state.held] if state.held else []:
            actions += self._slides(state, ball)
        return tuple(actions)

    def step(self, state: BallState, action: Action) -> BallState:
        """The state after `action`."""
        after = self._after(state, action) if isinstance(action, Action) else None
        if after is None:
            raise InvalidAction(f"{action} is not valid in {state}")
        return after

    def _after(self, state: BallState, action: Action) -> BallState | None:
        """The state after `action`; None if it is not one of `actions(state)`."""
        name, ball = action.name, action.ball
        lit, held, placements, _ = state
        if ball is None:
            return BallState(lit, held, placements)
        if ball > self.num_balls:
            return None
        if name == "light_on" or name == "light_off":
            valid = (ball in lit) == (name == "light_off")
            return BallState(_toggled(lit, ball), held, placements) if valid else None
        if name == "slide":
            return self._slid(state, ball, action.distance or 0, action.reference or 0)
        if name == "pick_up":
            return BallState(lit, ball, placements) if held is None else None
        return BallState(lit, None, placements) if held == ball else None

    def _slid(self, state: BallState, ball: int, distance: int, reference: int) -> BallState | None:
        """The state after a slide, None if it is not valid."""
        lit, held, placements, _ = state
        off = self.num_distances + 1
        placement = placements[ball - 1]
        at = placement[1] if placement and placement[0] == reference else off
        change = distance - at
        if not (1 <= reference <= self.num_balls and reference != ball and 1 <= distance < off):
            return None
        if abs(change) != 1 or not (held == ball or (self.slide_unheld and at < off)):
            return None
        moved = [None if p and p[0] == ball else p for p in placements]
        moved[ball - 1] = (reference, distance)
        return BallState(lit, held, tuple(moved), (ball, change))

    def is_goal(self, state: BallState, task: Task) -> bool:
        """Ball `mov` is placed at (`wrt`, `dist`), held or not."""
        return state.placements[task.mov - 1] == (task.wrt, task.dist)

    def route(self, state: BallState, task: Task) -> tuple[Action, ...]:
        """A shortest sequence of actions to `is_goal(state, task)`; () where it holds already."""
        if self.is_goal(state, task):
            return ()
        actions = []
        at = self.distance(state, task.mov, task.wrt)
        slides_by_itself = self.slide_unheld and at <= self.num_distances
        if state.held != task.mov and not slides_by_itself:
            if state.held is not None:
                actions.append(Action("release", state.held))
            actions.append(Action("pick_up", task.mov))
        step = 1 if task.dist > at else -1
        return (
            *actions,
            *(Action("slide", task.mov, k, task.wrt) for k in range(at + step, task.dist + step, step)),
        )

    @cached_property
    def _movs_and_wrts(self) -> NDArray[np.int64]:
        return np.array([[task.mov for task in self.tasks], [task.wrt for task in self.tasks]])

    def cues(self, state: BallState) -> NDArray[np.bool_]:
        """Which cue is on under which task, shape (7, tasks), rows as `cue_names`; read-only."""
        return _cues(self, state)


@lru_cache(maxsize=1 << 14)
def _toggled(lit: frozenset[int], ball: int) -> frozenset[int]:
    """The balls lit when the light of one has changed; equal sets are one object, to save memory."""
    return _only(lit ^ {ball})


@lru_cache(maxsize=1 << 14)
def _only(lit: frozenset[int]) -> frozenset[int]:
    return lit


@lru_cache(maxsize=1 << 12)
def _cues(world: BallWorld, state: BallState) -> NDArray[np.bool_]:
    lit, held, placements, slid = state
    table = _cues_of_hand_and_lights(world, lit, held).copy()
    distances = world.num_distances
    for ball, placement in enumerate(placements, start=1):
        if placement:
            reference, distance = placement
            others = (ball - 1) * (world.num_balls - 1) + reference - 1 - (reference > ball)
            first = others * distances  # the tasks of a ball and a reference ball stand together
            table[2, first + distance - 1] = table[5, first : first + distances] = True
            if slid and slid[0] == ball:
                table[6, first : first + distances] = _closing(distances, distance, slid[1])
    table.setflags(write=False)
    return table


@lru_cache(maxsize=1 << 10)
def _cues_of_hand_and_lights(world: BallWorld, lit: frozenset[int], held: int | None) -> NDArray[np.bool_]:
    mov, wrt = world._movs_and_wrts
    on = np.zeros(world.num_balls + 1, dtype=np.bool_)
    on[list(lit)] = True
    is_held, off = mov == (held or 0), np.zeros(len(mov), dtype=np.bool_)
    return np.stack([on[mov], is_held & on[wrt], off, is_held, on[wrt], off, off])


@lru_cache(maxsize=1 << 10)
def _closing(distances: int, distance: int, change: int) -> NDArray[np.bool_]:
    """By the distance asked for: whether a slide to `distance` by `change` came nearer to it."""
    gap = distance - np.arange(1, distances + 1)
    return np.asarray(np.abs(gap) < np.abs(gap - change))


def is_goal(world: World, state: Hashable, task: Hashable) -> bool:
    """`world.is_goal(state, task)`, or True in a World where Final may be shown anywhere."""
    test = getattr(world, "is_goal", None)
    return True if test is None else bool(test(state, task))
