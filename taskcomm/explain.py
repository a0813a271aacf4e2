"""Why an action: the contingent plan behind a decision, what it expects, what it would tell apart."""

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any, NamedTuple, Protocol

from taskcomm.belief import Belief, entropy
from taskcomm.contingency import Branch, Choose, PlannedStep, contingent_plan, shifts
from taskcomm.wording import duration, plan_in_words

LEAST, MOST = 0.01, 12  # press branches less likely, or beyond that number, are left out of text and drawing


class Decided(Protocol):
    """What is explained: an action; the exact values (nats) of some actions, lower bounds of the others."""

    @property
    def action(self) -> Any: ...
    @property
    def value(self) -> float: ...
    @property
    def values(self) -> Mapping[Any, float]: ...
    @property
    def bounds(self) -> Mapping[Any, float]: ...
    @property
    def horizon(self) -> int: ...


class Alternative(NamedTuple):
    """An action not taken: its value in nats or, if not `exact`, a lower bound; `gap` above the best."""

    action: Any
    value: float
    exact: bool
    gap: float


@dataclass(frozen=True, eq=False)
class Explanation:
    """Why a decision was made: its contingent plan `root`, followed for `depth` of `horizon` steps.

    `expected_entropy` is E[C] after each of these steps, `remaining` the discounted sum of it from there
    to the horizon, both in nats; `alternatives` are the actions not taken, the best first; `dt` is in
    seconds. `str()` says it in words, `to_json()` gives all of it as plain values, and
    `learn.plan_figure.plan_tree` draws it.

    >>> from taskcomm import BallWorld, EntropyPlanner, TeacherModel
    >>> world, model = BallWorld(2, 1), TeacherModel.intuitive()
    >>> decision = EntropyPlanner(world, model, horizon=2).plan(Belief.initial(world, model), world.start())
    >>> print(decision.explain(depth=1))
    light_on(1) has the least expected entropy, summed over 2 steps (1 s): 1.363845 nats.
      Entropy: 0.693 nats now; expected after each step: 0.688; 0.676 in all in the steps beyond.
    Plan:
      1. light_on(1): a press has 3.0% under mov=1, 0.5% under the others
         if pressed (1.8%: that_mov 71%, mistake 29%): mov=1 0.50 -> 0.86, wrt=2 0.50 -> 0.86
      No press in 1 step (98%): the belief hardly moves.
    Other actions:
      light_on(2): a tie (1.363845)
      noa, pick_up(1), pick_up(2): at least 0.017196 more (1.381041)
    """

    tasks: Sequence[Any]
    dt: float
    gamma: float
    horizon: int
    depth: int
    root: PlannedStep
    alternatives: tuple[Alternative, ...]

    @property
    def expected_entropy(self) -> tuple[float, ...]:
        expected = [0.0] * self.depth
        for step, branch in self.root.branches():
            expected[self.horizon - step.left] += branch.reach * branch.entropy
        return tuple(expected)

    @property
    def remaining(self) -> float:
        ends = (branch for _, branch in self.root.branches() if branch.then is None)
        return self.gamma**self.depth * sum(branch.reach * branch.later for branch in ends)

    def text(self, least: float = LEAST, most: int = MOST) -> str:
        """The explanation in words, with the `most` likeliest presses of at least probability `least`."""
        expected = ", ".join(f"{value:.3f}" for value in self.expected_entropy)
        beyond = f"; {self.remaining:.3f} in all in the steps beyond" if self.depth < self.horizon else ""
        discount = f", each step worth {self.gamma:g} of the one before" if self.gamma < 1 else ""
        return "\n".join(
            [
                f"{self.root.action} has the least expected entropy,"
                f" summed over {duration(self.horizon, self.dt)}:"
                f" {self.root.value:.6f} nats{discount}.",
                f"  Entropy: {entropy(self.root.before):.3f} nats now;"
                f" expected after each step: {expected}{beyond}.",
                *plan_in_words(self.root, self.tasks, self.root.likely_presses(least, most)),
                *self._alternatives(),
            ]
        )

    __str__ = text

    def _alternatives(self) -> Iterator[str]:
        """Why not the others: a line for each value, with how much it lies above the best."""
        if self.alternatives:
            yield "Other actions:"
        for (exact, gap), alike in groupby(
            self.alternatives, key=lambda other: (other.exact, round(other.gap, 6))
        ):
            actions = list(alike)
            names = ", ".join(str(other.action) for other in actions)
            above = (
                "a tie" if gap == 0 and exact else f"{gap:.6f} more" if exact else f"at least {gap:.6f} more"
            )
            yield f"  {names}: {above} ({actions[0].value:.6f})"

    def to_json(self) -> dict[str, Any]:
        """Everything, as plain values; a `marginal` is in the order of `tasks`."""
        return {
            "action": str(self.root.action),
            "horizon": self.horizon,
            "depth": self.depth,
            "dt": self.dt,
            "gamma": self.gamma,
            "tasks": [str(task) for task in self.tasks],
            "entropy": entropy(self.root.before),
            "marginal": self.root.before.tolist(),
            "expected_entropy": list(self.expected_entropy),
            "remaining": self.remaining,
            "plan": self._step(self.root),
            "alternatives": [{**other._asdict(), "action": str(other.action)} for other in self.alternatives],
        }

    def _step(self, step: PlannedStep) -> dict[str, Any]:
        return {
            "step": self.horizon - step.left + 1,
            "action": str(step.action),
            "value": step.value,
            "tells_apart": [
                {**group._asdict(), "tasks": [str(task) for task in group.tasks]} for group in step.groups
            ],
            "if_pressed": {"reasons": dict(step.press.reasons), **self._branch(step, step.press)},
            "if_not": self._branch(step, step.silent),
        }

    def _branch(self, step: PlannedStep, branch: Branch) -> dict[str, Any]:
        moved = shifts(self.tasks, step.before, branch.marginal)
        return {
            "probability": branch.probability,
            "reach": branch.reach,
            "entropy": branch.entropy,
            "marginal": branch.marginal.tolist(),
            "shifts": [{**shift._asdict(), "value": str(shift.value)} for shift in moved],
            "later": branch.later,
            "then": None if branch.then is None else self._step(branch.then),
        }


def explanation(
    decision: Decided,
    belief: Belief,
    state: Hashable,
    choose: Choose,
    gamma: float = 1.0,
    depth: int | None = None,
) -> Explanation:
    """The explanation of a decision made in `state` under `belief`, to the horizon unless `depth` is less.

    `choose(belief, state, steps left)` gives the best action at each of the up to 2^depth points of the plan.

        Q_h(a) = sum_t gamma^(t - 1) E[C after step t]

    holds between the value of the decision and the entropies of the plan. Raises ValueError for a depth
    that is no whole number from 1.

    Source: MODEL.md, section 6.
    """
    if depth is not None and (isinstance(depth, bool) or not isinstance(depth, int) or depth < 1):
        raise ValueError(f"depth must be a whole number of steps from 1, not {depth!r}")
    depth = decision.horizon if depth is None else min(depth, decision.horizon)
    root = contingent_plan(belief, state, decision.action, decision.horizon, depth, choose, gamma)
    known = [(action, value, True) for action, value in decision.values.items()]
    known += [(action, value, False) for action, value in decision.bounds.items()]
    others = [
        Alternative(action, value, exact, max(0.0, value - decision.value))
        for action, value, exact in known
        if action != decision.action
    ]
    return Explanation(
        tasks=belief.world.tasks,
        dt=belief.model.dt,
        gamma=gamma,
        horizon=decision.horizon,
        depth=depth,
        root=root,
        alternatives=tuple(sorted(others, key=lambda other: other.value)),
    )
