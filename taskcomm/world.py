"""The World protocol, and the ball world of the paper (MODEL.md, section 1)."""

import re
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple, Protocol, runtime_checkable

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
    - `spec() -> dict`: what a log needs to build the World again.
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

    def _allows(self, state: BallState, action: Action) -> bool:
        """Whether the action is one of `actions(state)`."""
        name, ball, distance, reference = action.name, action.ball, action.distance, action.reference
        if ball is None:
            return name == "noa"
        if ball > self.num_balls:
            return False
        if name == "light_on" or name == "light_off":
            return (ball in state.lit) == (name == "light_off")
        if name == "pick_up" or name == "release":
            return state.held == (None if name == "pick_up" else ball)
        if distance is None or reference is None or not reference <= self.num_balls or reference == ball:
            return False
        at = self.distance(state, ball, reference)
        rests = self.slide_unheld and at <= self.num_distances
        return (state.held == ball or rests) and distance <= self.num_distances and abs(distance - at) == 1

    def step(self, state: BallState, action: Action) -> BallState:
        """The state after `action`."""
        if not isinstance(action, Action) or not self._allows(state, action):
            raise InvalidAction(f"{action} is not valid in {state}")
        name, ball = action.name, action.ball
        lit, held, placements, _ = state
        if name == "noa" or ball is None:
            return BallState(lit, held, placements)
        if name == "light_on" or name == "light_off":
            return BallState(_toggled(lit, ball), held, placements)
        if name == "pick_up":
            return BallState(lit, ball, placements)
        if name == "release":
            return BallState(lit, None, placements)
        if action.distance is None or action.reference is None:  # a slide has both
            raise InvalidAction(f"{action} lacks a distance or a reference")
        change = action.distance - self.distance(state, ball, action.reference)
        moved = [None if p is not None and p[0] == ball else p for p in placements]
        moved[ball - 1] = (action.reference, action.distance)
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
    def _columns(self) -> tuple[NDArray[np.int64], ...]:
        table = np.array(self.tasks, dtype=np.int64)
        return table[:, 0], table[:, 1], table[:, 2]

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
    mov_lit, wrt_lit = _lit(world, state.lit)
    near, at_dist, gap = _placed(world, state.placements)
    mov = world._columns[0]
    table = np.zeros((len(world.cue_names), len(mov)), dtype=np.bool_)
    table[0], table[2], table[4], table[5] = mov_lit, at_dist, wrt_lit, near
    if state.held:
        np.equal(mov, state.held, out=table[3])
        np.logical_and(table[3], wrt_lit, out=table[1])
    if state.slid:
        slid, change = state.slid
        table[6] = near & (mov == slid) & (np.abs(gap) < np.abs(gap - change))
    table.setflags(write=False)
    return table


@lru_cache(maxsize=1 << 10)
def _lit(world: BallWorld, balls: frozenset[int]) -> tuple[NDArray[np.bool_], ...]:
    """Whether ball mov, and ball wrt, of each task is lit."""
    mov, wrt, _ = world._columns
    lit = np.zeros(world.num_balls + 1, dtype=np.bool_)
    lit[list(balls)] = True
    return lit[mov], lit[wrt]


@lru_cache(maxsize=1 << 10)
def _placed(
    world: BallWorld, placements: tuple[tuple[int, int] | None, ...]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.int64]]:
    """By task: whether ball mov is placed near wrt, whether at dist from it, and its distance less dist."""
    mov, wrt, dist = world._columns
    reference = np.array([0] + [p[0] if p else 0 for p in placements])
    gap = np.array([0] + [p[1] if p else 0 for p in placements])[mov] - dist
    near = reference[mov] == wrt
    return near, near & (gap == 0), gap


def is_goal(world: World, state: Hashable, task: Hashable) -> bool:
    """`world.is_goal(state, task)`, or True in a World where Final may be shown anywhere."""
    test = getattr(world, "is_goal", None)
    return True if test is None else bool(test(state, task))
