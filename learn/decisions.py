"""What another teacher model would have the planner do, in the situations that logs recorded."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from learn.bootstrap import Interval, ratio_interval
from taskcomm.belief import Belief
from taskcomm.parallel import map_in_order
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial
from taskcomm.world import World


@dataclass(frozen=True)
class Disagreement:
    """Decisions at logged moments under a model and a reference, one entry a decision.

    `differs`: the model's action is none of the reference's ties. `loss`: expected total entropy over
    the horizon, in nats and under the reference, of the model's action minus the least. `walking`
    counts the sampled moments left out, since one of the two would be past the threshold.
    """

    people: tuple[str, ...]
    differs: NDArray[np.bool_]
    loss: NDArray[np.float64]
    walking: int
    horizon: int

    @property
    def share(self) -> Interval:
        """Share of the decisions that differ."""
        return ratio_interval(self.differs, np.ones(len(self.differs)), self.people)

    @property
    def mean_loss(self) -> Interval:
        """Mean loss over all decisions, in nats."""
        return ratio_interval(self.loss, np.ones(len(self.loss)), self.people)

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "decisions": len(self.differs),
            "walking": self.walking,
            "horizon": self.horizon,
            "share_that_differ": self.share.to_json(),
            "expected_loss_nats": self.mean_loss.to_json(),
        }


@dataclass
class _Replanner:
    """Plans anew at some steps of one trial; planners are kept, since trials share their models."""

    world: World
    horizon: int
    threshold: float
    planners: dict[str, Any] = field(default_factory=dict)

    def _planner(self, model: TeacherModel) -> Any:
        from taskcomm.planner import EntropyPlanner

        if model.sha256 not in self.planners:
            self.planners[model.sha256] = EntropyPlanner(self.world, model, horizon=self.horizon)
        return self.planners[model.sha256]

    def __call__(
        self, item: tuple[Trial, TeacherModel, TeacherModel, frozenset[int]]
    ) -> list[tuple[bool, float] | None]:
        trial, model, reference, moments = item
        beliefs = [Belief.initial(self.world, m) for m in (model, reference)]
        state: Any = self.world.start()
        found = []
        for t, step in enumerate(trial.steps):
            if t in moments:
                found.append(self._decide(beliefs, state))
            state = trial.states[t]
            beliefs = [belief.update(state, step.pressed, step.signals) for belief in beliefs]
        return found

    def _decide(self, beliefs: list[Belief], state: Any) -> tuple[bool, float] | None:
        if any(belief.marginal().max() > self.threshold for belief in beliefs):
            return None
        model, reference = beliefs
        action = self._planner(model.model).plan(model, state).action
        judged = self._planner(reference.model).plan(reference, state, exact_values=True)
        return action not in judged.ties, max(0.0, judged.values[action] - min(judged.values.values()))


def disagreement(
    trials: Sequence[Trial],
    people: Sequence[str],
    model: Callable[[int], TeacherModel],
    reference: Callable[[int], TeacherModel],
    *,
    horizon: int = 3,
    sample: int | None = 300,
    threshold: float = 0.98,
    seed: int = 0,
    jobs: int = 1,
    progress: Callable[[int], None] | None = None,
) -> Disagreement:
    """Plan at logged moments under two models; `model(n)` and `reference(n)` are those of trial n.

    Beliefs follow the log from its start, whoever moved the robot. `sample` moments are drawn from
    all steps of all trials (None takes every one).
    """
    moments = [(n, t) for n, trial in enumerate(trials) for t in range(trial.num_steps)]
    if sample is not None and sample < len(moments):
        drawn = np.random.default_rng(seed).choice(len(moments), size=sample, replace=False)
        moments = [moments[place] for place in np.sort(drawn)]
    at: dict[int, list[int]] = {}
    for n, t in moments:
        at.setdefault(n, []).append(t)
    items = [(trials[n], model(n), reference(n), frozenset(steps)) for n, steps in at.items()]
    replanner = _Replanner(trials[0].world, horizon, threshold)
    if jobs > 1 and items:
        from taskcomm.planner import EntropyPlanner

        EntropyPlanner(trials[0].world, items[0][1]).warm_up()  # compiled here, once, not in every process
    results = map_in_order(replanner, items, jobs, progress)
    whose = [people[n] for n, found in zip(at, results, strict=True) for one in found if one is not None]
    decided = [one for found in results for one in found if one is not None]
    return Disagreement(
        people=tuple(whose),
        differs=np.array([differs for differs, _ in decided], dtype=np.bool_),
        loss=np.array([loss for _, loss in decided], dtype=np.float64),
        walking=len(moments) - len(decided),
        horizon=horizon,
    )
