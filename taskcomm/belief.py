"""The robot's exact belief over the task and the teacher's memory (MODEL.md, section 5)."""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from taskcomm.levels import Bools, Floats, advance, approval_probability
from taskcomm.teacher import Parameters, TeacherModel
from taskcomm.world import World

NEVER = 1 << 40


class ImpossibleObservation(ValueError):
    """An observation of probability 0; it cannot happen while mistake > 0."""


@dataclass(frozen=True, eq=False)
class Belief:
    """A distribution over (task, memory), memory being the levels of the approval states.

    One row for each (task, memory) of positive weight: `task` (R,) indexes `world.tasks`, `weight`
    (R,) sums to 1, `level` and `on_time` are (R, M). `seen` (L, M, tasks) holds the cues of the last
    L steps, newest last, for delays; `since_press` counts steps since the last press. Histories of
    one task with equal memory are merged; nothing is approximated. So rows stay in the hundreds, except
    where a model has `decay`: there they grow with the presses since a cue came on. A belief is a
    value: `update` gives a new one.

    >>> from taskcomm.world import Action, BallWorld
    >>> world = BallWorld()
    >>> belief = Belief.initial(world, TeacherModel.intuitive())
    >>> state = world.step(world.start(), Action.parse("light_on(1)"))
    >>> belief = belief.update(state, pressed=True)
    >>> {ball: round(p, 4) for ball, p in belief.marginal_of("mov").items()}
    {1: 0.75, 2: 0.125, 3: 0.125}

    Source: the paper, section 3.3 (state); MODEL.md, section 5.
    """

    world: World
    model: TeacherModel
    parameters: Parameters
    task: NDArray[np.int64]
    weight: Floats
    level: Floats
    on_time: Floats
    seen: Bools
    since_press: int = NEVER

    @classmethod
    def initial(cls, world: World, model: TeacherModel, prior: ArrayLike | None = None) -> Self:
        """The belief before the first step: levels 0, tasks as `prior` (uniform by default).

        Raises ValueError for a prior that is no distribution over `world.tasks`, ModelError for a
        cue that the world does not have.
        """
        parameters = model.parameters(world.cue_names)
        count, states = len(world.tasks), len(model.approvals)
        weight = np.full(count, 1 / count) if prior is None else np.array(prior, dtype=np.float64)
        if weight.shape != (count,) or not (weight >= 0).all() or abs(weight.sum() - 1) > 1e-6:
            raise ValueError(f"prior: must be {count} probabilities that sum to 1, one per task")
        task = np.flatnonzero(weight)
        zeros = np.zeros((len(task), states))
        kept = int(parameters.steps_late.max()) + 2
        seen = np.zeros((kept, states, count), dtype=np.bool_)
        return cls(world, model, parameters, task, weight[task] / weight.sum(), zeros, zeros, seen)

    def _advanced(self, state: Hashable) -> tuple[Bools, Floats, Floats, Floats]:
        """What was seen, levels, on-times and P(M_t = m) at the end of a step in `state`."""
        p = self.parameters
        now = np.asarray(self.world.cues(state), dtype=np.bool_)[p.cue]
        seen = np.concatenate([self.seen[1:], now[None]])
        if p.steps_late.any() or p.part_late.any():
            states, at = np.arange(len(p.cue)), len(seen) - 1 - p.steps_late
            newer, older = seen[at, states].T[self.task], seen[at - 1, states].T[self.task]
        else:
            newer = older = now.T[self.task]
        level, on_time = advance(self.level, self.on_time, older, newer, p)
        return seen, level, on_time, approval_probability(level, on_time, self.resting, p)

    @property
    def resting(self) -> bool:
        """Whether the next step still lies within the model's `rest` after a press."""
        return self.since_press < self.parameters.rest_steps

    def press_probability(self, state: Hashable) -> float:
        """P(spacebar) in the coming step, if the world is in `state` then."""
        approval = self._advanced(state)[3]
        return float(self.parameters.mistake + self.weight @ approval.sum(axis=1))

    def press_joint(self, state: Hashable) -> Floats:
        """P(task, a press for this reason) in the coming step, if the world is in `state` then.

        Shape (tasks, 1 + M): a mistake, then the approval states in the model's order.
        """
        approval = self.weight[:, None] * self._advanced(state)[3]
        joint = np.zeros((len(self.world.tasks), 1 + approval.shape[1]))
        joint[:, 0] = self.parameters.mistake * self.marginal()
        np.add.at(joint[:, 1:], self.task, approval)
        return joint

    def update(self, state: Hashable, pressed: bool) -> Self:
        """The belief after a step that ended in `state`, with or without a press.

        Raises ImpossibleObservation, naming belief, world and observation, and TypeError where `pressed` is
        neither True nor False.
        """
        if not isinstance(pressed, (bool, np.bool_)):
            raise TypeError(f"pressed: must be True or False, not {pressed!r}")
        seen, level, on_time, approval = self._advanced(state)
        mistake = self.parameters.mistake
        if pressed:
            states = level.shape[1]
            task = np.tile(self.task, states + 1)
            weight = np.concatenate([self.weight * mistake, (self.weight[:, None] * approval).T.ravel()])
            level, on_time = np.tile(level, (states + 1, 1)), np.tile(on_time, (states + 1, 1))
            for m in range(states):
                reset = slice((m + 1) * len(self.task), (m + 2) * len(self.task))
                level[reset, m] = on_time[reset, m] = 0.0
        else:
            task, weight = self.task, self.weight * (1 - mistake - approval.sum(axis=1))
        task, weight, level, on_time = _merged(task, weight, level, on_time, self.parameters)
        total = weight.sum()
        if not total > 0:
            raise ImpossibleObservation(
                f"pressed={pressed} has probability 0 in {state} under {self.model} from {self.marginal()}"
            )
        since = 0 if pressed else min(self.since_press + 1, NEVER)
        return replace(
            self, task=task, weight=weight / total, level=level, on_time=on_time, seen=seen, since_press=since
        )

    def marginal(self) -> Floats:
        """P(task), in the order of `world.tasks`."""
        counted = np.bincount(self.task, weights=self.weight, minlength=len(self.world.tasks))
        return np.asarray(counted, dtype=np.float64)

    def marginal_of(self, field: str) -> dict[Any, float]:
        """P(one attribute of the task), for example `mov`, by its values."""
        marginal: dict[Any, float] = {}
        for task, probability in zip(self.world.tasks, self.marginal(), strict=True):
            value = getattr(task, field)
            marginal[value] = marginal.get(value, 0.0) + float(probability)
        return marginal

    def entropy(self) -> float:
        """Entropy of the marginal over tasks, in nats: the cost C(b)."""
        return entropy(self.marginal())


def entropy(probabilities: Sequence[float] | Floats) -> float:
    """-sum p ln p in nats, with 0 ln 0 = 0."""
    p = np.asarray(probabilities, dtype=np.float64)
    p = p[p > 0]
    return max(0.0, float(-(p * np.log(p)).sum()))


def _merged(
    task: NDArray[np.int64], weight: Floats, level: Floats, on_time: Floats, parameters: Parameters
) -> tuple[NDArray[np.int64], Floats, Floats, Floats]:
    """Rows of weight 0 dropped, rows of equal task and memory added up, sorted by task."""
    if not weight.all():
        kept = weight > 0
        task, weight, level, on_time = task[kept], weight[kept], level[kept], on_time[kept]
    if len(task) < 2 or (task[1:] > task[:-1]).all():
        return task, weight, level, on_time
    memory = level
    if parameters.decays:
        memory = np.concatenate([level, on_time * np.isfinite(parameters.decay)], axis=1)
    order = np.lexsort((*memory.T, task))
    task, memory = task[order], memory[order]
    first = np.ones(len(task), dtype=np.bool_)
    first[1:] = (task[1:] != task[:-1]) | (memory[1:] != memory[:-1]).any(axis=1)
    starts = np.flatnonzero(first)
    rows = order[starts]
    return task[starts], np.add.reduceat(weight[order], starts), level[rows], on_time[rows]
