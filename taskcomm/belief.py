"""The robot's exact belief over the task and the teacher's memory (MODEL.md, section 5)."""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from taskcomm.beliefrows import Rows, branched, merged, most_likely, pruned
from taskcomm.levels import Bools, Floats, advance, approval_probability
from taskcomm.observation import WAITING, Observer, Signals
from taskcomm.teacher import Parameters, TeacherModel
from taskcomm.world import World

NEVER = 1 << 40
FEW, MOST = 600.0, 700.0  # exp of more than MOST is not a number any more, of less than -MOST it is 0


class ImpossibleObservation(ValueError):
    """An observation of probability 0; it cannot happen while mistake > 0."""


@dataclass(frozen=True, eq=False)
class Belief:
    """A distribution over (task, memory), memory being the levels of the approval states.

    One row for each (task, memory) of positive weight: `task` (R,) indexes `world.tasks`, `weight`
    (R,) sums to 1, `level` and `on_time` are (R, M). `seen` (L, M, tasks) holds the cues of the last
    L steps, newest last, for delays; `since_press` counts steps since the last press. Histories of
    one task with equal memory are merged; nothing is approximated. So rows stay in the hundreds, except
    where a model has `decay`: there they grow with the presses since a cue came on; and where a reset may
    go unseen (a key that misses or was not recorded): there they grow in every step with a level above 0.

    With `prune` above 0, each update then drops the lightest rows, at most that weight together. `lost`
    (tasks,) bounds what has been dropped so far as it would weigh now beside the 1 that was kept, and
    `dropped` bounds the total variation from the exact belief. A belief is a value: `update` gives a new one.

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
    observer: Observer
    prune: float
    lost: Floats
    most_level: Floats
    since_press: int = NEVER

    @classmethod
    def initial(
        cls, world: World, model: TeacherModel, prior: ArrayLike | None = None, *, prune: float = 0.0
    ) -> Self:
        """The belief before the first step: levels 0, tasks as `prior` (uniform by default).

        Raises ValueError for a prior that is no distribution over `world.tasks` or a `prune` outside
        [0, 1), ModelError for a cue that the world does not have or a channel that does not fit it.
        """
        if not 0 <= prune < 1:
            raise ValueError(f"prune: must be at least 0 and below 1, not {prune!r}")
        parameters = model.parameters(world.cue_names)
        count, states = len(world.tasks), len(model.approvals)
        weight = np.full(count, 1 / count) if prior is None else np.array(prior, dtype=np.float64)
        if weight.shape != (count,) or not (weight >= 0).all() or abs(weight.sum() - 1) > 1e-6:
            raise ValueError(f"prior: must be {count} probabilities that sum to 1, one per task")
        task = np.flatnonzero(weight)
        zeros = np.zeros((len(task), states))
        kept = int(parameters.steps_late.max()) + 2
        seen = np.zeros((kept, states, count), dtype=np.bool_)
        start = task, weight[task] / weight.sum(), zeros, zeros, seen
        lost, most = np.zeros(count), np.zeros((count, states))
        return cls(world, model, parameters, *start, Observer(world, model), float(prune), lost, most)

    def _advanced(self, state: Hashable) -> tuple[Bools, Floats, Floats, Floats]:
        """What was seen, levels, on-times and P(M_t = m) at the end of a step in `state`."""
        p = self.parameters
        now = np.asarray(self.world.cues(state), dtype=np.bool_)[p.cue]
        seen = np.concatenate([self.seen[1:], now[None]])
        older, newer = _late(seen, p, self.task)
        level, on_time = advance(self.level, self.on_time, older, newer, p)
        return seen, level, on_time, approval_probability(level, on_time, self.resting, p)

    @property
    def resting(self) -> bool:
        """Whether the next step still lies within the model's `rest` after a press."""
        return self.since_press < self.parameters.rest_steps

    @property
    def dropped(self) -> float:
        """A bound on the total variation between this belief and the exact one; 0 without `prune`."""
        lost = float(self.lost.sum())
        return lost / (1.0 + lost)

    def press_probability(self, state: Hashable) -> float:
        """P(spacebar) in the coming step, if the world is in `state` then."""
        if not self.observer.exact:
            return float(self.mental_joint(state, True).sum())
        approval = self._advanced(state)[3]
        return float(self.parameters.mistake + self.weight @ approval.sum(axis=1))

    def press_joint(self, state: Hashable) -> Floats:
        """P(task, a press for this reason) in the coming step, if the world is in `state` then.

        Shape (tasks, 1 + M): a mistake, then the approval states in the model's order. A press while
        waiting, of a key that fires by itself, is not among them: see `mental_joint`.
        """
        if not self.observer.exact:
            return self.mental_joint(state, True)[:, 1:]
        approval = self.weight[:, None] * self._advanced(state)[3]
        joint = np.zeros((len(self.world.tasks), 1 + approval.shape[1]))
        joint[:, 0] = self.parameters.mistake * self.marginal()
        np.add.at(joint[:, 1:], self.task, approval)
        return joint

    def mental_joint(
        self, state: Hashable, pressed: bool | None = None, signals: Signals | None = None
    ) -> Floats:
        """P(task, M_t, observation) of the coming step, if the world is in `state` then.

        Shape (tasks, 2 + M), columns as `model.mental_states`; densities for continuous channels. What is
        None or missing is not observed, so `mental_joint(state)` is P(task, M_t).
        """
        approval = self.weight[:, None] * self._advanced(state)[3]
        joint = np.zeros((len(self.world.tasks), 2 + approval.shape[1]))
        joint[:, 1] = self.parameters.mistake * self.marginal()
        np.add.at(joint[:, 2:], self.task, approval)
        joint[:, WAITING] = self.marginal() - joint[:, 1:].sum(axis=1)
        return np.asarray(joint * self.observer.weights(pressed, signals))

    def reasons(self, state: Hashable, pressed: bool | None = None, signals: Signals | None = None) -> Floats:
        """P(M_t | observation) of the coming step, if the world is in `state` then, (2 + M,).

        Columns as `model.mental_states`. Raises ImpossibleObservation as `update` does.
        """
        reasons = (self.mental_joint(state) * self._told(state, pressed, signals)).sum(axis=0)
        if not reasons.sum() > 0:
            raise self._impossible(state, pressed, signals)
        return np.asarray(reasons / reasons.sum())

    def update(self, state: Hashable, pressed: bool | None, signals: Signals | None = None) -> Self:
        """The belief after a step that ended in `state`, with or without a press (None: not recorded).

            w(theta, e) P(M | e) P(o | M, theta)     for every M, with its reset

        `signals` are those of the model's channels that were observed; others are left aside. For the model's
        `rest`, a key that was not recorded counts as not pressed.

        Raises ImpossibleObservation, naming belief, world and observation, TypeError where `pressed` is
        neither True, False nor None, and SignalError naming the channel for a value that it cannot have.
        """
        if pressed is not None and not isinstance(pressed, (bool, np.bool_)):
            raise TypeError(f"pressed: must be True, False or None, not {pressed!r}")
        seen, level, on_time, approval = self._advanced(state)
        mistake, exact = self.parameters.mistake, pressed is not None and self.observer.exact
        told = self.observer.key[int(bool(pressed))] if exact else self._told(state, pressed, signals)
        rows = Rows(self.task, self.weight, level, on_time)
        if exact and not pressed:
            rows = rows._replace(weight=self.weight * (1 - mistake - approval.sum(axis=1)))
        else:
            rows = branched(rows, approval, mistake, told if exact else told[self.task])
        rows = merged(rows, self.parameters)
        total = float(rows.weight.sum())
        if not total > 0:
            raise self._impossible(state, pressed, signals)
        after = replace(
            self,
            task=rows.task,
            weight=rows.weight / total,
            level=rows.level,
            on_time=rows.on_time,
            seen=seen,
            since_press=0 if pressed else min(self.since_press + 1, NEVER),
        )
        return after if self.prune == 0 else after._pruned(self.resting, told / total)

    def _told(self, state: Hashable, pressed: bool | None, signals: Signals | None) -> Floats:
        """P(observation | M, task), (tasks, 2 + M), up to a common factor where there are numbers."""
        if not (signals and self.observer.model.continuous):
            return self.observer.weights(pressed, signals)
        logs = self.observer.log_weights(pressed, signals)
        most = float(logs[self.task].max())
        if not np.isfinite(most):
            raise self._impossible(state, pressed, signals)
        near = np.exp(np.clip(logs - most, -FEW, MOST))  # what is possible stays so
        return np.where(np.isfinite(logs), near, 0.0)

    def _pruned(self, rested: bool, told: Floats) -> Self:
        """This belief without its lightest rows, and the bound on what has been lost.

        What was dropped before has since grown by at most the likelihood of the observation, `told`
        (tasks, 2 + M) relative to that of what was kept, at any levels up to those without a reset.
        """
        p, every = self.parameters, np.arange(len(self.lost))
        most = advance(self.most_level, np.zeros_like(self.most_level), *_late(self.seen, p, every), p)[0]
        rows, light = pruned(Rows(self.task, self.weight, self.level, self.on_time), self.prune)
        share = float(rows.weight.sum())
        lost = self.lost * most_likely(told, p.peak * most * (not rested), p.mistake)
        lost += np.bincount(light.task, weights=light.weight, minlength=len(lost))
        return replace(
            self,
            task=rows.task,
            weight=rows.weight / share,
            level=rows.level,
            on_time=rows.on_time,
            lost=lost / share,
            most_level=most,
        )

    def _impossible(
        self, state: Hashable, pressed: bool | None, signals: Signals | None
    ) -> ImpossibleObservation:
        also = f" with {dict(signals)}" if signals else ""
        return ImpossibleObservation(
            f"pressed={pressed}{also} has probability 0 in {state} under {self.model} from {self.marginal()}"
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


def _late(seen: Bools, parameters: Parameters, task: NDArray[np.int64]) -> tuple[Bools, Bools]:
    """The cues of these tasks as seen late in the last step, older and newer, each (tasks, M)."""
    p = parameters
    if p.steps_late.any() or p.part_late.any():
        states, at = np.arange(len(p.cue)), len(seen) - 1 - p.steps_late
        return seen[at - 1, states].T[task], seen[at, states].T[task]
    now = seen[-1].T[task]
    return now, now
