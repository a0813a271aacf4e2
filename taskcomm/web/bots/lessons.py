"""One trial as a simulated teacher lives it: what was shown, what went on in its mind."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from taskcomm.simulate import SimulatedTeacher
from taskcomm.tasks import Task
from taskcomm.teacher import TeacherModel
from taskcomm.web.bots.mirror import state_of, world_of
from taskcomm.web.protocol import Frame
from taskcomm.world import Action, BallState


class FrameError(ValueError):
    """A frame shows another world than its action leads to."""


@dataclass(frozen=True)
class Moment:
    """A step: the world as shown, whether the key was to be pressed, why; and the teacher before it."""

    state: BallState
    pressed: bool
    mental_state: str
    before: SimulatedTeacher


class Lesson:
    """A trial of a teacher drawn from `model`; `moments` are its steps so far.

    The random number of step t follows from `seed` and t alone: a step that is shown again, as after a crash
    of the server, is lived again, with the same luck. Who missed steps saw the world stand still in them.
    """

    def __init__(self, number: int, task: Task, model: TeacherModel, seed: Sequence[int]) -> None:
        self.number, self.task = number, task
        self.moments: list[Moment] = []
        self.final: Task | None = None
        self._model, self._seed = model, tuple(seed)

    @property
    def right(self) -> bool:
        """Whether the trial ended with the task shown."""
        return self.final == self.task

    def see(self, frame: Frame) -> bool:
        """Whether the key is to be pressed in the step that the frame shows.

        Raises FrameError where the frame is not what its action makes of the frame before.
        """
        if frame.final:
            self.final = Task(*frame.final)
        if frame.t < 0 or frame.state != "run":
            return False
        if frame.t < len(self.moments):
            self._teacher = self.moments[frame.t].before
            del self.moments[frame.t :]
        elif not self.moments:
            self._teacher = SimulatedTeacher(world_of(frame), self._model, self.task)
        missed = frame.t - len(self.moments)
        for _ in range(missed):
            self._live(self._last(frame))
        state = state_of(frame, self._last(frame))
        if not missed:
            _check(frame, self._last(frame), state)
        self._live(state)
        return self.moments[frame.t].pressed

    def _last(self, frame: Frame) -> BallState:
        return self.moments[-1].state if self.moments else world_of(frame).start()

    def _live(self, state: BallState) -> None:
        before = copy.copy(self._teacher)  # observing replaces what it holds, and changes nothing in place
        rng = np.random.default_rng([*self._seed, len(self.moments)])
        pressed = self._teacher.observe(state, rng)
        self.moments.append(Moment(state, pressed, str(self._teacher.mental_state), before))


def _check(frame: Frame, before: BallState, shown: BallState) -> None:
    expected = world_of(frame).step(before, Action.parse(frame.action))
    if shown != expected:
        raise FrameError(f"step {frame.t}: after {frame.action} the frame shows {shown}, not {expected}")
