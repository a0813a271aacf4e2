"""The way to a state in which a task's goal holds, in any World."""

from collections import deque
from collections.abc import Hashable
from typing import Any

from taskcomm.world import World, is_goal


class NoRoute(ValueError):
    """No state with `is_goal` could be reached; the message names the task and the state."""


def route(world: World, state: Hashable, task: Hashable, limit: int = 100_000) -> tuple[Any, ...]:
    """A shortest sequence of actions from `state` to `is_goal(state, task)`; () where it holds.

    `world.route` where the World has one, else breadth-first search in the order of
    `world.actions`, over at most `limit` states. Raises NoRoute.

    >>> from taskcomm.world import BallWorld
    >>> world = BallWorld()
    >>> route(world, world.start(), world.tasks[3])
    (pick_up(1), slide(1, 4, 2))
    """
    own = getattr(world, "route", None)
    if own is not None:
        return tuple(own(state, task))
    if is_goal(world, state, task):
        return ()
    came: dict[Hashable, tuple[Hashable, Any]] = {}
    waiting: deque[Hashable] = deque([state])
    while waiting and len(came) < limit:
        at = waiting.popleft()
        for action in world.actions(at):
            reached = world.step(at, action)
            if reached == state or reached in came:
                continue
            came[reached] = at, action
            if is_goal(world, reached, task):
                return _back(came, state, reached)
            waiting.append(reached)
    raise NoRoute(f"no way to the goal of {task} from {state} among {len(came) + 1} states")


def _back(came: dict[Hashable, tuple[Hashable, Any]], start: Hashable, goal: Hashable) -> tuple[Any, ...]:
    actions = []
    while goal != start:
        goal, action = came[goal]
        actions.append(action)
    return tuple(reversed(actions))
