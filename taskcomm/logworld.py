"""How a World, its tasks and its actions are written in a log, and found again."""

from collections.abc import Hashable
from typing import Any

import msgspec

from taskcomm.loglines import ActionPart, LineError, TaskPart
from taskcomm.tasks import Task
from taskcomm.world import Action, BallWorld, World

MOST_TASKS = 100_000


def world_part(world: World) -> dict[str, Any]:
    """`world.spec()` where it has one, else its name."""
    spec: Any = getattr(world, "spec", dict)()
    return {"name": type(world).__name__} | dict(msgspec.to_builtins(spec))


def task_part(task: Hashable) -> dict[str, Any]:
    """A task in a log: mov, wrt and dist of a Task, the name of any other."""
    return task._asdict() if isinstance(task, Task) else {"name": str(task)}


def action_part(action: Hashable) -> dict[str, Any]:
    """An action in a log: the fields that an Action has, the name of any other.

    >>> action_part(Action.parse("slide(1, 4, 2)"))
    {'name': 'slide', 'ball': 1, 'distance': 4, 'reference': 2}
    """
    if not isinstance(action, Action):
        return {"name": str(action)}
    fields = {name: getattr(action, name) for name in ("name", "ball", "distance", "reference")}
    return {name: value for name, value in fields.items() if value is not None}


def world_of(part: dict[str, Any], given: World | None) -> World:
    """The World of a log: `given`, if that is the one, or the BallWorld described.

    Raises LineError for a World that `given` is not, or that cannot be built from its description.
    """
    name = part.get("name", "BallWorld")
    if name == "BallWorld":
        built = _ball_world(part)
        if given is None or given == built:
            return given or built
        raise LineError(f"world: the log is of {built}, not of {given}")
    if given is None:
        raise LineError(f"world: the log is of a World named {name!r}, which must be given to read it")
    if world_part(given) != part:
        raise LineError(f"world: the log is of {part}, not of {world_part(given)}")
    return given


def _ball_world(part: dict[str, Any]) -> BallWorld:
    sizes = {name: part[name] for name in ("num_balls", "num_distances", "slide_unheld") if name in part}
    for name in ("num_balls", "num_distances"):
        if name not in sizes:
            raise LineError(f"world: {name} is missing")
    if type(sizes.get("slide_unheld", False)) is not bool:
        raise LineError(f"world: slide_unheld must be true or false, not {sizes['slide_unheld']!r}")
    try:
        world = BallWorld(**sizes)
    except ValueError as error:
        raise LineError(f"world: {error}") from None
    if world.num_balls * (world.num_balls - 1) * world.num_distances > MOST_TASKS:
        raise LineError(f"world: {world} has more than {MOST_TASKS} tasks")
    return world


class WorldIndex:
    """A World's tasks and steps, by what a log says of them. Steps are remembered, for speed."""

    def __init__(self, world: World) -> None:
        self.world = world
        self._tasks = {_text(task_part(task)): task for task in world.tasks}
        if len(self._tasks) != len(world.tasks):
            raise LineError(f"world: two tasks of {world} are written alike; str(task) must tell them apart")
        self._moves: dict[Hashable, dict[str, Any]] = {}
        self._steps: dict[tuple[Hashable, str], tuple[Any, Any]] = {}

    def task(self, part: TaskPart) -> Any:
        """The task, or LineError."""
        wanted = (
            {"name": part.name}
            if part.mov is part.wrt is part.dist is None
            else {
                "mov": part.mov,
                "wrt": part.wrt,
                "dist": part.dist,
            }
        )
        try:
            return self._tasks[_text(wanted)]
        except KeyError:
            raise LineError(f"{wanted} is none of the {len(self._tasks)} tasks of this world") from None

    def step(self, state: Hashable, part: ActionPart) -> tuple[Any, Any]:
        """The action and the state after it, or LineError where it is not valid in `state`."""
        values = [str(value) for value in (part.ball, part.distance, part.reference) if value is not None]
        text = f"{part.name}({', '.join(values)})" if values else part.name
        found = self._steps.get((state, text))
        if found is None:
            action = self._valid(state).get(text)
            if action is None:
                raise LineError(f"action: {text} is not valid in {state}")
            found = self._steps[state, text] = action, self.world.step(state, action)
        return found

    def _valid(self, state: Hashable) -> dict[str, Any]:
        if state not in self._moves:
            actions = self.world.actions(state)
            self._moves[state] = {str(action): action for action in actions}
            if len(self._moves[state]) != len(actions):
                raise LineError(f"world: two actions are written alike in {state}")
        return self._moves[state]


def _text(part: dict[str, Any]) -> str:
    return repr(sorted(part.items()))
