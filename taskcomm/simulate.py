"""Simulated teachers, and trials with them."""

import hashlib
import json
from collections.abc import Hashable, Mapping

import numpy as np

from taskcomm.levels import advance, approval_probability
from taskcomm.observation import Observer, Signals
from taskcomm.robot import Controller, Final, takes
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Step, Trial
from taskcomm.world import InvalidAction, World


class SimulatedTeacher:
    """A teacher whose mental state is drawn from a TeacherModel, one uniform number a step.

    The number u in [0, 1) picks M_t by the cumulative sum in the order mistake, approval states as
    in the model, waiting; so the spacebar is pressed where u < P(press), and two robots or two
    models met with the same seed meet the same luck. A key that errs takes one more number a step, and
    so does every channel of the model; what channels show is in `signals` (None without any). `forced` maps
    a step (from 0) to the mental state it shall have, come what may.

    Raises ValueError for a task or a forced mental state that does not exist, ModelError for a cue
    or a role that the world does not have.

    >>> from taskcomm.world import BallWorld
    >>> world = BallWorld()
    >>> teacher = SimulatedTeacher(world, TeacherModel.intuitive(), world.tasks[0], forced={0: "mistake"})
    >>> teacher.observe(world.start(), np.random.default_rng(0)), teacher.mental_state
    (True, 'mistake')

    Source: MODEL.md, sections 3 and 4.
    """

    def __init__(
        self,
        world: World,
        model: TeacherModel,
        task: Hashable,
        *,
        forced: Mapping[int, str] | None = None,
    ) -> None:
        if task not in world.tasks:
            raise ValueError(f"task: {task} is none of the {len(world.tasks)} tasks of this world")
        for state in (forced or {}).values():
            if state not in model.mental_states:
                raise ValueError(f"forced: unknown mental state {state!r}; one of {model.mental_states}")
        self.world, self.model, self.task = world, model, task
        self.forced = dict(forced or {})
        self._column = list(world.tasks).index(task)
        self._parameters = model.parameters(world.cue_names)
        self._order = ("mistake", *model.approvals, "waiting")
        self._observer = Observer(world, model)
        self.reset()

    def reset(self) -> None:
        """Before the first step: levels 0, nothing seen, nothing pressed."""
        p = self._parameters
        self.mental_state: str | None = None
        self.signals: Signals | None = None
        self.step = 0
        self._level = np.zeros(len(p.cue))
        self._on_time = np.zeros(len(p.cue))
        self._seen = np.zeros((int(p.steps_late.max()) + 2, len(p.cue)), dtype=np.bool_)
        self._last_press: int | None = None

    def observe(self, state: Hashable, rng: np.random.Generator) -> bool:
        """Whether the spacebar is pressed in the step that ends in `state`; once a step."""
        p = self._parameters
        states = np.arange(len(p.cue))
        now = self.world.cues(state)[p.cue, self._column]
        self._seen = np.concatenate([self._seen[1:], now[None]])
        at = len(self._seen) - 1 - p.steps_late
        newer, older = self._seen[at, states], self._seen[at - 1, states]
        self._level, self._on_time = advance(self._level, self._on_time, older, newer, p)
        resting = self._last_press is not None and self.step - self._last_press <= p.rest_steps
        approval = approval_probability(self._level, self._on_time, resting, p)
        bounds = np.cumsum([p.mistake, *approval])
        drawn = self._order[int(np.searchsorted(bounds, rng.random(), side="right"))]
        self.mental_state = self.forced.get(self.step, drawn)
        if self.mental_state in self.model.approvals:
            reset = self._order.index(self.mental_state) - 1
            self._level[reset] = self._on_time[reset] = 0.0
        pressed = self._show(self.mental_state, rng)
        if pressed:
            self._last_press = self.step
        self.step += 1
        return pressed

    def _show(self, mental_state: str, rng: np.random.Generator) -> bool:
        """Whether the key is pressed; signals are drawn where the model has channels."""
        if self._observer.exact:
            return mental_state != "waiting"
        at = self.model.mental_states.index(mental_state)
        pressed, signals = self._observer.draw(self._column, at, rng)
        self.signals = signals or None
        return pressed


def run_trial(
    controller: Controller,
    teacher: SimulatedTeacher,
    rng: np.random.Generator,
    *,
    max_steps: int = 600,
    trial_id: str | None = None,
    participant_id: str | None = None,
    operator_id: str | None = None,
    session: str | None = None,
    trial_index: int = 0,
    condition: str | None = None,
) -> Trial:
    """One trial, from reset to Final, or to `max_steps` steps: then `timeout`, not correct.

    Two generators are spawned from `rng`, one for the controller, one for the teacher, so a
    teacher meets the same numbers whatever the controller draws. The same seed gives the same
    trial, to the byte of its log; `trial_id` is derived from the seed unless given.

    Raises ValueError where controller and teacher live in different worlds or time steps, InvalidAction
    where the controller does what its state does not allow, and TypeError for an `rng` that is a seed.
    """
    if not isinstance(rng, np.random.Generator):
        raise TypeError(f"rng: must be a numpy.random.Generator, such as default_rng({rng!r}), not {rng!r}")
    world, dt = teacher.world, teacher.model.dt
    if controller.world != world:
        raise ValueError("run_trial: controller and teacher are in different worlds")
    if controller.dt != dt:
        raise ValueError(f"run_trial: dt is {controller.dt:g} s for the controller, {dt:g} s for the teacher")
    if max_steps < 1:
        raise ValueError(f"max_steps: must be at least 1, not {max_steps!r}")
    trial_id = trial_id or _id_of(rng)
    controller_rng, teacher_rng = rng.spawn(2)
    controller.reset(controller_rng)
    teacher.reset()
    state, displayed, reason = world.start(), None, "final"
    steps: list[Step] = []
    action, hears_signals = controller.act(None), takes(controller.act, "signals")
    while not isinstance(action, Final):
        if len(steps) == max_steps:
            reason = "timeout"
            break
        if action not in world.actions(state):
            raise InvalidAction(f"step {len(steps)}: {action} is not valid in {state}")
        source = controller.source
        state = world.step(state, action)
        pressed = teacher.observe(state, teacher_rng)
        steps.append(Step(action, pressed, source, teacher.mental_state, signals=teacher.signals))
        heard = {"signals": teacher.signals} if hears_signals else {}
        action = controller.act(pressed, **heard)
    else:
        displayed = action.task
    description = dict(controller.description)
    if condition is not None:
        description["condition"] = condition
    return Trial(
        trial_id=trial_id,
        world=world,
        task=teacher.task,
        steps=tuple(steps),
        dt=dt,
        reason=reason,
        displayed=displayed,
        participant_id=participant_id,
        operator_id=operator_id,
        session=session,
        trial_index=trial_index,
        source="simulated",
        taskcomm_version=_version(),
        **description,
    )


def _id_of(rng: np.random.Generator) -> str:
    """A name for what `rng` will give next: its seed and how often it has been spawned."""
    seed = rng.bit_generator.seed_seq
    key = [getattr(seed, name, None) for name in ("entropy", "spawn_key", "n_children_spawned")]
    text = json.dumps([type(rng.bit_generator).__name__, *key], default=str)
    return f"sim-{hashlib.sha256(text.encode()).hexdigest()[:12]}"


def _version() -> str:
    from taskcomm import __version__

    return __version__
