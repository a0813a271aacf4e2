"""The robot: exact belief, planner, the rule that stops a trial, and the walk to the goal."""

from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from taskcomm.belief import Belief
from taskcomm.routes import route
from taskcomm.teacher import TeacherModel
from taskcomm.world import World, is_goal


@dataclass(frozen=True, slots=True)
class Final:
    """The display that ends a trial: this is the task. It takes no time step."""

    task: Any


class Controller(Protocol):
    """What moves the robot in a trial. It keeps the world state by itself.

    `act(None)` gives the first action of a trial; `act(pressed)` the next one, given whether the
    spacebar was pressed in the step just done. `source` says who chose the last action
    (`planner`, `operator` or `default`), `description` what a log should say of the controller.
    """

    @property
    def world(self) -> World: ...
    @property
    def dt(self) -> float: ...
    @property
    def source(self) -> str: ...
    @property
    def description(self) -> dict[str, Any]: ...
    def reset(self, rng: np.random.Generator | None = None) -> None: ...
    def act(self, pressed: bool | None) -> Any: ...


class Planner(Protocol):
    """Anything that chooses an action from a belief and a world state: `plan(...).action`.

    A planner that draws random numbers may have `reset(rng)`, called at the start of a trial.
    """

    def plan(self, belief: Belief, state: Any, /) -> Any: ...


class Robot:
    """A controller that keeps an exact belief and shows Final when it knows the task.

    After every update: if the most probable task has more than `threshold` and its goal holds,
    Final; if it does not hold yet, the next action of a shortest way there; else the planner's
    action (EntropyPlanner at horizon 5 unless another is given). A belief that falls back, or
    moves to another task, changes the robot's course. `prior` is over `world.tasks`.

    `belief`, `state` and `decision` (the planner's last; None where it was not asked) are there
    to look at. Raises ValueError for a threshold outside (0, 1), a prior that is none, or a
    planner made for another world or model, or calls out of turn; NoRoute where a goal cannot be reached.

    >>> from taskcomm.world import BallWorld
    >>> world = BallWorld()
    >>> robot = Robot(world, TeacherModel.intuitive(), prior=[0.99] + [0.01 / 23] * 23)
    >>> robot.act(None), robot.act(False)
    (pick_up(1), slide(1, 4, 2))

    Source: the paper, section 3.4; MODEL.md, section 6.
    """

    source = "planner"

    def __init__(
        self,
        world: World,
        model: TeacherModel,
        planner: Planner | None = None,
        threshold: float = 0.98,
        prior: ArrayLike | None = None,
    ) -> None:
        if not 0 < threshold < 1:
            raise ValueError(f"threshold: must be between 0 and 1, not {threshold!r}")
        for name, own in (("world", world), ("model", model)):
            if getattr(planner, name, own) != own:
                raise ValueError(f"planner: made for another {name} than the robot's")
        self.world, self.model, self.threshold = world, model, threshold
        self._planner = planner
        self._initial = Belief.initial(world, model, prior)
        self.reset()

    @property
    def dt(self) -> float:
        """Length of a time step in seconds."""
        return self.model.dt

    @property
    def planner(self) -> Planner:
        """The planner; the default one is made, and its kernels loaded, when first needed."""
        if self._planner is None:
            from taskcomm.planner import EntropyPlanner

            self._planner = EntropyPlanner(self.world, self.model)
        return self._planner

    @property
    def description(self) -> dict[str, Any]:
        """What a log says of this robot: condition, robot_model, planner."""
        default = "intuitive" if self.model == TeacherModel.intuitive() else "unnamed"
        name = str(self.model.provenance.get("name", default))
        planner = {
            "horizon": getattr(self._planner, "horizon", None) if self._planner is not None else 5,
            "threshold": self.threshold,
            "seed": getattr(self._planner, "seed", None),
        }
        robot_model = {"name": name, "sha256": self.model.sha256}
        return {"condition": "pomdp", "robot_model": robot_model, "planner": planner}

    def reset(self, rng: np.random.Generator | None = None) -> None:
        """Ready for the next trial: the prior, the start of the world; `rng` is for random ties."""
        reset_planner = getattr(self._planner, "reset", None)
        if rng is not None and reset_planner is not None:
            reset_planner(rng)
        self.belief = self._initial
        self.state: Any = self.world.start()
        self.decision: Any = None
        self._begun = self._over = False
        self._ways: dict[tuple[Hashable, Hashable], Any] = {}

    def act(self, pressed: bool | None) -> Any:
        """The next action, or Final; `pressed` is None at the first call of a trial."""
        if self._over or (pressed is None) == self._begun:
            raise ValueError("a trial begins with act(None), goes on with act(pressed) and ends with Final")
        if pressed is not None:
            self.belief = self.belief.update(self.state, bool(pressed))
        action = self._choice()
        self._begun, self._over = True, isinstance(action, Final)
        if not self._over:
            self.state = self.world.step(self.state, action)
        return action

    def _choice(self) -> Any:
        self.decision = None
        marginal = self.belief.marginal()
        best = int(marginal.argmax())
        if not marginal[best] > self.threshold:
            self.decision = self.planner.plan(self.belief, self.state)
            return self.decision.action
        task = self.world.tasks[best]
        if is_goal(self.world, self.state, task):
            return Final(task)
        return self._next_on_way(task)

    def _next_on_way(self, task: Hashable) -> Any:
        if (self.state, task) not in self._ways:
            at = self.state
            for action in route(self.world, at, task):
                self._ways[at, task] = action
                at = self.world.step(at, action)
        return self._ways[self.state, task]
