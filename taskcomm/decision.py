"""A decision of the planner: the action, what it costs, and what is known of the others."""

from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

from taskcomm.belief import Belief
from taskcomm.certificate import Certificate
from taskcomm.explain import Explanation, explanation

TIE = 1e-9


class Planned(Protocol):
    """The planner that a decision can be asked about."""

    @property
    def gamma(self) -> float: ...
    @property
    def over_key(self) -> bool: ...
    def best(self, belief: Belief, state: Hashable, horizon: int) -> "Decision": ...


class Asked(NamedTuple):
    """What a decision was made of, for its explanation."""

    planner: Planned
    belief: Belief
    state: Hashable


@dataclass(frozen=True)
class Decision:
    """What the planner chose, and what it knows of the other actions.

    `values` are exact expected costs Q_h in nats, by action in canonical order: all of them with
    `exact_values`, otherwise those that could not be ruled out early. `bounds` are lower bounds for
    the rest, `upper_bounds` upper ones. `ties` are the actions within 1e-9 of the least. `gap` is how far
    the next best action that is no tie lies above the least: exact where that action is in `values`, else
    at least this; infinite where there is none. `horizon` is how many steps were looked ahead; the action
    is proven to be the best at that horizon. `certificate` says how far from optimal it can be at the
    planner's own horizon, where a deadline left it unfinished. `nodes` counts beliefs whose actions were
    looked at in the last look; `seconds` is wall time.
    """

    action: Any
    values: dict[Any, float]
    bounds: dict[Any, float]
    ties: tuple[Any, ...]
    gap: float
    horizon: int
    nodes: int
    upper_bounds: dict[Any, float] = field(default_factory=dict)
    certificate: Certificate | None = None
    seconds: float = field(default=0.0, compare=False)
    asked: "Asked | None" = field(default=None, repr=False, compare=False)

    @property
    def value(self) -> float:
        """Q_h of the chosen action, in nats."""
        return self.values[self.action]

    def explain(self, depth: int | None = None) -> Explanation:
        """Why this action: the contingent plan, followed for `depth` steps, at most to the horizon (None).

        It plans anew at the up to 2^depth points that the steps may lead to. `print` it, or see
        `Explanation`. Raises ValueError for a bad depth, a decision that no
        planner made, or a model under which more than an exact key is observed.
        """
        if self.asked is None:
            raise ValueError(f"this decision for {self.action} was made by no planner: it has no plan")
        planner, belief, state = self.asked
        if not planner.over_key:
            raise ValueError(
                "explanations are of plans over an exact key; this model's teacher shows otherwise"
            )
        return explanation(self, belief, state, planner.best, planner.gamma, depth)
