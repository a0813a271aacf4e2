"""The robot: exact belief, planner, the rule that stops a trial, and the walk to the goal."""

import inspect
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from numbers import Real
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from taskcomm.belief import Belief
from taskcomm.branching import default_horizon
from taskcomm.observation import Signals
from taskcomm.routes import route
from taskcomm.teacher import TeacherModel
from taskcomm.world import World, is_goal

FAR = 10  # steps that a robot with a deadline looks ahead if time allows
PRUNE = 1e-9  # weight that its belief may leave out in a step


@dataclass(frozen=True, slots=True)
class Final:
    """The display that ends a trial: this is the task. It takes no time step."""

    task: Any


class Controller(Protocol):
    """What moves the robot in a trial. It keeps the world state by itself.

    `act(None)` gives the first action of a trial; `act(pressed)` the next one, given whether the
    spacebar was pressed in the step just done. `source` says who chose the last action
    (`planner`, `operator` or `default`), `description` what a log should say of the controller. A controller
    that makes use of further signals takes them by name: `act(pressed, signals={"gaze": "2"})`.
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

    A planner that draws random numbers may have `reset(rng)`, called at the start of a trial. One for
    robots with a deadline takes it by name: `plan(belief, state, deadline=0.4)`.
    """

    def plan(self, belief: Belief, state: Any, /) -> Any: ...


class Robot:
    """A controller that keeps an exact belief and shows Final when it knows the task.

    After every update: if the most probable task has more than `threshold` and its goal holds,
    Final; if it does not hold yet, the next action of a shortest way there; else the planner's
    action (EntropyPlanner at horizon 5 unless another is given). A belief that falls back, or
    moves to another task, changes the robot's course. `prior` is over `world.tasks`.

    With a `deadline` (s for one decision) the planner looks as far ahead as it gets by then, at most its
    own horizon, which is 10 unless a planner is given. The same trial may then go another way on another
    machine, or a busier one: `decision.horizon` says how far each decision looked.

    Unless a planner is given, the horizon is 5; 4 for a key that errs, 3 with signals. Under a key that
    misses, the belief leaves out memories that weigh 1e-9 together in a step; `belief.dropped` bounds what
    that does.

    `belief`, `state` and `decision` (the planner's last; None where it was not asked) are there
    to look at. Raises ValueError for a threshold outside (0, 1), a prior that is none, a planner made for
    another world or model, a deadline that is not positive or that the planner knows nothing of, or
    calls out of turn; NoRoute where a goal cannot be reached.

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
        deadline: float | None = None,
    ) -> None:
        if not 0 < threshold < 1:
            raise ValueError(f"threshold: must be between 0 and 1, not {threshold!r}")
        _check_deadline(deadline, planner)
        for name, own in (("world", world), ("model", model)):
            if getattr(planner, name, own) != own:
                raise ValueError(f"planner: made for another {name} than the robot's")
        self.world, self.model, self.threshold, self.deadline = world, model, threshold, deadline
        self._planner = planner
        self._initial = Belief.initial(world, model, prior, prune=PRUNE if model.observation.miss else 0.0)
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

            self._planner = EntropyPlanner(self.world, self.model, horizon=self._default_horizon)
        return self._planner

    @property
    def _default_horizon(self) -> int:
        return default_horizon(self.model) if self.deadline is None else FAR

    @property
    def description(self) -> dict[str, Any]:
        """What a log says of this robot: condition, robot_model, planner."""
        default = "intuitive" if self.model == TeacherModel.intuitive() else "unnamed"
        name = str(self.model.provenance.get("name", default))
        default_horizon = self._default_horizon if self._planner is None else None
        planner = {
            "horizon": getattr(self._planner, "horizon", default_horizon),
            "threshold": self.threshold,
            "seed": getattr(self._planner, "seed", None),
        }
        for setting, usual in (("gamma", 1.0), ("ties", "first")):
            if getattr(self._planner, setting, usual) != usual:
                planner[setting] = getattr(self._planner, setting)
        if self.deadline is not None:
            planner["deadline"] = self.deadline
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

    def act(self, pressed: bool | None, signals: Signals | None = None) -> Any:
        """The next action, or Final; `pressed` is None at the first call of a trial.

        `signals` are those of the model's channels that were observed in the step just done.
        """
        if self._over or (pressed is None) == self._begun:
            raise ValueError("a trial begins with act(None), goes on with act(pressed) and ends with Final")
        if pressed is not None:
            self.belief = self.belief.update(self.state, bool(pressed), signals)
        action = self.choose(self.belief, self.state)
        self._begun, self._over = True, isinstance(action, Final)
        if not self._over:
            self.state = self.world.step(self.state, action)
        return action

    def choose(self, belief: Belief, state: Any) -> Any:
        """What this robot does under `belief` in world `state`: an action, or Final.

        Neither is kept: it is `act` for whoever keeps belief and state, and tells what was in fact done.
        """
        self.decision = None
        marginal = belief.marginal()
        best = int(marginal.argmax())
        if not marginal[best] > self.threshold:
            plan: Callable[..., Any] = self.planner.plan
            in_time = {} if self.deadline is None else {"deadline": self.deadline}
            self.decision = plan(belief, state, **in_time)
            return self.decision.action
        task = self.world.tasks[best]
        return Final(task) if is_goal(self.world, state, task) else self._next_on_way(state, task)

    def _next_on_way(self, state: Any, task: Hashable) -> Any:
        if (state, task) not in self._ways:
            at = state
            for action in route(self.world, at, task):
                self._ways[at, task] = action
                at = self.world.step(at, action)
        return self._ways[state, task]


def _check_deadline(deadline: float | None, planner: Planner | None) -> None:
    if deadline is None:
        return
    if isinstance(deadline, bool) or not isinstance(deadline, Real) or not deadline > 0:
        raise ValueError(f"deadline: must be a positive number of seconds, not {deadline!r}")
    if planner is not None and not takes(planner.plan, "deadline"):
        raise ValueError(f"deadline: {type(planner).__name__}.plan(belief, state) takes none")


def takes(function: Callable[..., Any], name: str) -> bool:
    """Whether a function takes an argument of this name."""
    taken = inspect.signature(function).parameters.values()
    return any(p.name == name or p.kind is p.VAR_KEYWORD for p in taken)
