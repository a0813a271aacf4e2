"""A logged trial under any model: the belief over its time, and why each press was believed to be made."""

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from taskcomm.belief import Belief, entropy
from taskcomm.observation import SignalError
from taskcomm.robot import PRUNE
from taskcomm.teacher import ModelError, TeacherModel
from taskcomm.trials import Step, Trial
from taskcomm.world import World

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class BeliefPath:
    """The belief before the first step and after each: `marginal` is (steps + 1, tasks), `time` in seconds.

    `pressed` is (steps,): press s falls in the step that ends at time[s + 1]; `recorded` is (steps,), False
    where the key was not recorded; `signals` are further observations by channel, None where missing.
    """

    world: World
    time: Floats
    marginal: Floats
    pressed: NDArray[np.bool_]
    recorded: NDArray[np.bool_]
    signals: Mapping[str, tuple[str | float | None, ...]]

    @property
    def entropy(self) -> Floats:
        """Entropy of the marginal over tasks in nats, shape (steps + 1,)."""
        return np.array([entropy(row) for row in self.marginal])

    @property
    def highest(self) -> Floats:
        """Probability of the likeliest task, shape (steps + 1,)."""
        return np.asarray(self.marginal.max(axis=1))

    @property
    def press_times(self) -> Floats:
        """Ends of the steps with a press, in seconds."""
        return self.time[1:][self.pressed]

    @property
    def fields(self) -> tuple[str, ...]:
        """The names of the parts of a task (mov, wrt, dist), or () where tasks have no named parts."""
        return tuple(getattr(self.world.tasks[0], "_fields", ()))

    def marginal_of(self, field: str) -> dict[Any, Floats]:
        """P(one part of the task), by its values, each of shape (steps + 1,)."""
        values = [getattr(task, field) for task in self.world.tasks]
        return {
            value: self.marginal[:, [other == value for other in values]].sum(axis=1)
            for value in sorted(set(values))
        }

    def to_json(self) -> dict[str, Any]:
        """Everything, as plain lists: of the parts of the task where it has them, else of every task."""
        marginals: Mapping[str, Mapping[Any, Floats]] = {
            field: self.marginal_of(field) for field in self.fields
        } or {
            "task": {
                str(task): column for task, column in zip(self.world.tasks, self.marginal.T, strict=True)
            }
        }
        return {
            "time": self.time.tolist(),
            "entropy": self.entropy.tolist(),
            "highest": self.highest.tolist(),
            "likeliest": [str(self.world.tasks[index]) for index in self.marginal.argmax(axis=1)],
            "marginals": {
                field: {str(value): column.tolist() for value, column in columns.items()}
                for field, columns in marginals.items()
            },
            "pressed": [
                bool(key) if recorded else None
                for key, recorded in zip(self.pressed, self.recorded, strict=True)
            ],
            **(
                {"signals": {name: list(seen) for name, seen in self.signals.items()}} if self.signals else {}
            ),
        }


def belief_path(trial: Trial, model: TeacherModel, prior: ArrayLike | None = None) -> BeliefPath:
    """The exact belief of a robot that has `model`, over the steps of `trial`.

    Signals count as far as the model has their channels. The task of the trial is not used. Raises ModelError
    if the model's dt is not the trial's or a channel does not fit its world, SignalError for a value that a
    channel cannot have.

    >>> from taskcomm.trials import Step
    >>> from taskcomm.world import Action, BallWorld
    >>> steps = (Step(Action.parse("light_on(1)"), pressed=True),)
    >>> path = belief_path(Trial("one", BallWorld(), None, steps), TeacherModel.intuitive())
    >>> path.marginal_of("mov")[1].round(4).tolist()
    [0.3333, 0.75]

    Source: the paper, section 5 (figures of the task marginals and of the entropy).
    """
    check_dt(trial, model)
    belief = _before(trial, model, prior)
    rows = [belief.marginal()]
    for step in range(trial.num_steps):
        belief = _after(belief, trial, step)
        rows.append(belief.marginal())
    time = np.arange(trial.num_steps + 1, dtype=np.float64) * trial.dt
    signals = {name: trial.signals(name) for name in model.observation.channels if name in trial.channels}
    return BeliefPath(trial.world, time, np.array(rows), trial.presses, trial.recorded, signals)


def situation(trial: Trial, model: TeacherModel, step: int) -> tuple[Belief, Hashable]:
    """The belief of a robot that has `model`, and the world state, before step `step` (0, 1, ...) of `trial`.

    Raises ModelError if the model's dt is not the trial's, ValueError if the trial has no such step.
    """
    check_dt(trial, model)
    if not 0 <= step < trial.num_steps:
        raise ValueError(
            f"trial {trial.trial_id} has {trial.num_steps} steps, from 0; there is no step {step}"
        )
    belief = _before(trial, model)
    for done in range(step):
        belief = _after(belief, trial, done)
    return belief, (trial.world.start(), *trial.states)[step]


def _after(belief: Belief, trial: Trial, step: int) -> Belief:
    """The belief after a step of a trial; an error names both."""
    seen = trial.steps[step]
    try:
        return belief.update(trial.states[step], seen.pressed, seen.signals)
    except SignalError as error:
        raise SignalError(f"trial {trial.trial_id}, step {step}: {error}") from None


def _before(trial: Trial, model: TeacherModel, prior: ArrayLike | None = None) -> Belief:
    """The belief before a trial, exact wherever that keeps memories few."""
    hides = model.observation.miss > 0 or not trial.recorded.all()
    return Belief.initial(trial.world, model, prior, prune=PRUNE if hides else 0.0)


@dataclass(frozen=True)
class PressReason:
    """Why a press happened: P(mental state), as believed just then, and with the whole trial known.

    `step` counts from 0; `time` is the end of that step in seconds; `noted` is the mental state that
    the log itself names, in simulated trials.
    """

    step: int
    time: float
    at_once: Mapping[str, float]
    at_end: Mapping[str, float]
    noted: str | None

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "step": self.step,
            "time": self.time,
            "at_once": dict(self.at_once),
            "at_end": dict(self.at_end),
            "noted": self.noted,
        }


def press_reasons(
    trial: Trial, model: TeacherModel, prior: ArrayLike | None = None
) -> tuple[PressReason, ...]:
    """The reason of every press as the robot that does not know the task sees it.

    Raises ModelError if the model's dt is not the trial's.

    Source: the paper, section 5 (figure of the accuracy of inference).
    """
    from taskcomm.smoother import smooth

    check_dt(trial, model)
    if not trial.presses.any():
        return ()
    unknown = replace(trial, task=None)
    smoothed = smooth(unknown, model, prior=prior)
    belief = _before(trial, model, prior)
    states = tuple(state for state in model.mental_states if state != "waiting" or _fires_by_itself(model))
    at_once = []
    for t, (step, state) in enumerate(zip(trial.steps, trial.states, strict=True)):
        if step.pressed:
            at_once.append(_reasons_of_a_press(belief, state, step, states))
        belief = _after(belief, trial, t)
    return tuple(
        PressReason(
            step=int(step),
            time=(int(step) + 1) * trial.dt,
            at_once=now,
            at_end={state: p for state, p in smoothed.of_press(press).items() if state in states},
            noted=trial.steps[step].mental_state,
        )
        for press, (step, now) in enumerate(zip(smoothed.steps, at_once, strict=True))
    )


def _fires_by_itself(model: TeacherModel) -> bool:
    """Whether a press may have no reason: it is put down to `waiting` then."""
    return model.observation.false_press > 0


def _reasons_of_a_press(
    belief: Belief, state: Hashable, step: Step, states: tuple[str, ...]
) -> dict[str, float]:
    """P(mental state | a press and the signals of the coming step, all before it)."""
    reasons = belief.reasons(state, True, step.signals).tolist()
    shares = dict(zip(belief.model.mental_states, reasons, strict=True))
    return {state: shares[state] for state in states}


def is_at_dt(trial: Trial, model: TeacherModel) -> bool:
    """Whether the model's step is the trial's."""
    return bool(np.isclose(model.dt, trial.dt, rtol=1e-9, atol=0.0))


def check_dt(trial: Trial, model: TeacherModel) -> None:
    """Raise ModelError unless the model's step is the trial's."""
    if not is_at_dt(trial, model):
        raise ModelError(
            f"dt: the model is for steps of {model.dt:g} s, trial {trial.trial_id} has {trial.dt:g} s;"
            " convert the model with with_dt()"
        )
