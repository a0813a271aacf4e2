"""A log against the robot that it names: world and planner run again, step by step."""

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from taskcomm.belief import Belief, ImpossibleObservation
from taskcomm.observation import SignalError
from taskcomm.planner import EntropyPlanner
from taskcomm.replay import is_at_dt
from taskcomm.robot import Final, Robot
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Step, Trial
from taskcomm.world import is_goal


class UnverifiableTrial(ValueError):
    """A trial that cannot be run again: its model is not at hand, or its planner not described."""


@dataclass(frozen=True, slots=True)
class Difference:
    """The first step that differs, from 0 (the end: the number of steps): what is logged, what was due."""

    step: int
    logged: str
    due: str

    def __str__(self) -> str:
        return f"step {self.step}: logged {self.logged}, but {self.due}"


@dataclass(frozen=True)
class Verification:
    """What running a trial again showed.

    `decisions` counts the choices of the planner or of the operator that were compared, Final among them;
    `defaults` the steps for which none came in time. `unverified` says what could not be compared.
    """

    trial_id: str
    controller: str
    steps: int
    decisions: int
    defaults: int
    difference: Difference | None
    unverified: tuple[str, ...]

    @property
    def same(self) -> bool:
        """Whether nothing that was compared differs."""
        return self.difference is None

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        names = ("trial_id", "controller", "same", "steps", "decisions", "defaults")
        found = self.difference
        where = None if found is None else {"step": found.step, "logged": found.logged, "due": found.due}
        plain = {name: getattr(self, name) for name in names}
        return {**plain, "difference": where, "unverified": list(self.unverified)}


def verify(trial: Trial, models: Iterable[TeacherModel] = ()) -> Verification:
    """Run a trial again and compare every choice, Final and its task included.

    The planner is the one that the log describes, and believes what it says of the key. Its model is the one
    of `models`, or the intuitive one, whose sha256 is in the log, converted to the log's step if need be. A
    `default` action stands, and the run goes on from it. Where an operator controlled the robot, its actions
    are compared with what the world allows and the task displayed with what the world shows.

    Raises UnverifiableTrial.

    >>> import numpy as np
    >>> from taskcomm.simulate import SimulatedTeacher, run_trial
    >>> from taskcomm.world import BallWorld
    >>> world, model = BallWorld(), TeacherModel.intuitive()
    >>> robot = Robot(world, model, EntropyPlanner(world, model, horizon=1))
    >>> trial = run_trial(robot, SimulatedTeacher(world, model, world.tasks[0]), np.random.default_rng(0))
    >>> verify(trial).same
    True
    """
    if trial.planner is None and trial.robot_model is None:
        return _OperatorRun(trial).verification()
    return _PlannerRun(trial, _model_of(trial, models)).verification()


def _model_of(trial: Trial, models: Iterable[TeacherModel]) -> TeacherModel:
    """The model of the trial's robot: one of these, or converted to the trial's step."""
    named = trial.robot_model or {}
    wanted = named.get("sha256")
    for model in (*models, TeacherModel.intuitive()):
        for candidate in (model, model.with_dt(trial.dt)):
            if candidate.sha256 == wanted and is_at_dt(trial, candidate):
                return candidate
    raise UnverifiableTrial(
        f"trial {trial.trial_id}: the robot had the model {named.get('name')!r} with sha256"
        f" {wanted or 'unknown'} and steps of {trial.dt:g} s; it takes that model's file"
    )


class _Run(ABC):
    """A trial gone through once."""

    controller = ""

    def __init__(self, trial: Trial) -> None:
        self.trial, self.state = trial, trial.world.start()
        self.decisions = self.defaults = 0
        self.unverified: list[str] = []

    def verification(self) -> Verification:
        """Until the first difference or the end."""
        trial = self.trial
        return Verification(
            trial_id=trial.trial_id,
            controller=self.controller,
            steps=trial.num_steps,
            difference=self._first(),
            decisions=self.decisions,
            defaults=self.defaults,
            unverified=tuple(self.unverified),
        )

    def _first(self) -> Difference | None:
        for t, step in enumerate(self.trial.steps):
            logged = str(step.action)
            due = self._wrong_source(step)
            if due is None and step.action_source == "default":
                self.defaults += 1
            elif due is None:
                due = self._due(step.action)
            if due is not None:
                return Difference(t, logged, due)
            self.state = self.trial.states[t]
            due = self._observed(step)
            if due is not None:
                return Difference(t, "a press" if step.pressed else "no press", due)
        return self._end()

    def _wrong_source(self, step: Step) -> str | None:
        if step.action_source in (self.controller, "default"):
            return None
        return f"chosen by the {step.action_source}, where the {self.controller} controls the robot"

    def _end(self) -> Difference | None:
        trial = self.trial
        if trial.reason != "final":
            due = self._no_final()
            logged = "no Final" if trial.reason is None else f"{trial.reason}, no Final"
        else:
            due = self._due(Final(trial.displayed))
            logged = f"Final for {trial.displayed}"
        return None if due is None else Difference(trial.num_steps, logged, due)

    @abstractmethod
    def _due(self, logged: Any) -> str | None:
        """Count and compare one choice: what was due instead, None where it was this."""

    def _observed(self, step: Step) -> str | None:
        """Take in the key; what speaks against it."""
        return None

    def _no_final(self) -> str | None:
        """What was due at the end of a trial that was not ended by Final."""
        return None


class _OperatorRun(_Run):
    """The world alone: reading the log has shown that it allows every action."""

    controller = "operator"

    def _due(self, logged: Any) -> str | None:
        self.decisions += 1
        if not isinstance(logged, Final) or is_goal(self.trial.world, self.state, logged.task):
            return None
        return f"the world does not show this task: {self.state}"


class _PlannerRun(_Run):
    """World, belief and planner."""

    controller = "planner"

    def __init__(self, trial: Trial, model: TeacherModel) -> None:
        super().__init__(trial)
        settings = dict(trial.planner or {})
        horizon, threshold = settings.get("horizon"), settings.get("threshold")
        try:
            if not isinstance(horizon, int):
                raise ValueError(f"its horizon is {horizon!r}")
            gamma = settings.get("gamma", 1.0)
            planner = EntropyPlanner(trial.world, model, horizon, gamma=gamma)
            self.robot = Robot(trial.world, model, planner, threshold)  # type: ignore[arg-type]
        except (ValueError, TypeError) as error:
            raise UnverifiableTrial(
                f"trial {trial.trial_id}: the log does not describe a planner that can be run again: {error}"
            ) from None
        self.belief: Belief = self.robot.belief
        self._drawn = settings.get("ties", "first") != "first"
        self._timed = settings.get("deadline") is not None
        if self._drawn:
            self.unverified.append("which of equally good actions was drawn")
        if self._timed:
            self.unverified.append("what the planner chose: with a deadline that depends on the machine")

    def _due(self, logged: Any) -> str | None:
        if self._timed and not self._knows():
            return f"the robot is not sure of {logged.task}" if isinstance(logged, Final) else None
        self.decisions += 1
        choice = self.robot.choose(self.belief, self.state)
        if choice == logged:
            return None
        decision = self.robot.decision
        if isinstance(choice, Final):
            return f"the robot shows Final for {choice.task}"
        if decision is None:
            return f"the robot does {choice}, on its way to the task that it is sure of"
        if logged in decision.ties:
            return None if self._drawn else f"the planner does {choice}, the first of those as good"
        exact = logged in decision.values
        above = decision.values.get(logged, decision.bounds.get(logged, decision.value)) - decision.value
        cost = (
            "" if isinstance(logged, Final) else f", by {'' if exact else 'at least '}{above:.3g} nats better"
        )
        return f"the planner does {choice}{cost}"

    def _knows(self) -> bool:
        return bool(self.belief.marginal().max() > self.robot.threshold)

    def _observed(self, step: Step) -> str | None:
        try:
            self.belief = self.belief.update(self.state, step.pressed, step.signals)
        except (ImpossibleObservation, SignalError) as error:
            return f"the robot's model does not allow that: {error}"
        return None

    def _no_final(self) -> str | None:
        if self.trial.reason != "timeout" or not self._knows():
            return None
        choice = self.robot.choose(self.belief, self.state)
        if not isinstance(choice, Final):
            return None
        if self.trial.steps and self.trial.steps[-1].timing is not None:
            self.unverified.append("the end: Final was due, and may have been too late at the limit of time")
            return None
        return f"the robot shows Final for {choice.task}"
