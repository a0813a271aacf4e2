"""The planner: the action that minimises the sum of expected entropy (MODEL.md, section 6)."""

import math
import time
import warnings
from collections.abc import Hashable, Sequence
from copy import copy
from dataclasses import replace
from numbers import Real

import numpy as np

from taskcomm.belief import Belief
from taskcomm.branching import BranchingTree, default_horizon, looks_beyond_the_key
from taskcomm.branching import Looked as Branched
from taskcomm.certificate import Floats, Looked, certificate, enclosed, most_told
from taskcomm.decision import TIE, Asked, Decision
from taskcomm.garbage import no_collections, undisturbed
from taskcomm.searching import Search, Workspace, row_bytes
from taskcomm.symmetry import Reduced, ReducedWorld, says_what_is_alike
from taskcomm.teacher import TeacherModel
from taskcomm.world import World
from taskcomm.worldgraph import WorldGraph

_SLACK = 2 * TIE
_IN_HAND = 0.02  # share of a deadline for the last slice of a search and for what follows it
MEMORY = 512 << 20  # bytes that a planner's graph of the world may take, and as many the rows of a search
ROWS = 1 << 15  # that a search may have whatever the memory
MOST_STEPS = 100


class UnplannedChannel(UserWarning):
    """A model has a continuous channel: belief and learning use it, the planner looks ahead without it."""


class EntropyPlanner:
    """Exact closed-loop look-ahead over `horizon` steps, 1 to 100.

    Where it is None: 5 steps; 4 for a key that errs, 3 with signals.

        Q_h(b, w, a) = sum_o P(o | b, a) (C(b_ao) + gamma min_a' Q_{h-1}(b_ao, w_a, a')),  Q_0 = 0

    with C the entropy of the marginal over tasks. `ties` is "first" (in canonical order) or
    "random" (drawn with `seed`). A planner keeps only what it has seen of the world, the nearest of it where
    that is more than `memory` bytes; the beliefs of one search may take as much again. It may be used for any
    number of beliefs and trials, from one thread at a time.

    Where the model's key errs or it has channels of signals, the tree branches over all that may be observed
    (`taskcomm.branching`), which takes much longer; a continuous channel is left aside, with an
    UnplannedChannel warning. With `signals=False` all channels are: the planner looks ahead over the key
    alone, further in the same time, under beliefs that know the signals all the same.

    Raises ValueError for a bad horizon, gamma, ties or memory, and ModelError for a cue or a role that the
    world does not have.

    >>> from taskcomm.world import BallWorld
    >>> world, model = BallWorld(), TeacherModel.intuitive()
    >>> decision = EntropyPlanner(world, model, horizon=2).plan(Belief.initial(world, model), world.start())
    >>> decision.action, round(decision.value, 6), decision.ties
    (light_on(1), 6.333974, (light_on(1), light_on(2), light_on(3)))

    Source: the paper, section 3.4 (action selection).
    """

    def __init__(
        self,
        world: World,
        model: TeacherModel,
        horizon: int | None = None,
        *,
        gamma: float = 1.0,
        ties: str = "first",
        seed: int | None = None,
        memory: int = MEMORY,
        signals: bool = True,
    ) -> None:
        planned = model
        if not signals:
            planned = replace(model, observation=replace(model.observation, channels={}))
        horizon = default_horizon(planned) if horizon is None else horizon
        if isinstance(horizon, bool) or not isinstance(horizon, int) or not 1 <= horizon <= MOST_STEPS:
            raise ValueError(
                f"horizon must be a whole number of steps from 1 to {MOST_STEPS}, not {horizon!r}"
            )
        if not (_is_number(gamma) and 0 < gamma <= 1):
            raise ValueError(f"gamma must lie in (0, 1], not {gamma!r}")
        if ties not in ("first", "random"):
            raise ValueError(f"ties must be 'first' or 'random', not {ties!r}")
        self.world, self.model, self.horizon = world, model, horizon
        self.gamma, self.ties = float(gamma), ties
        self._random = np.random.default_rng(seed)
        if planned.observation.continuous:
            named = ", ".join(planned.observation.continuous)
            warnings.warn(UnplannedChannel(f"planning leaves aside {named}: continuous"), stacklevel=2)
        self._tree = BranchingTree(world, planned) if looks_beyond_the_key(planned) else None
        parameters = model.parameters(world.cue_names)
        worth = parameters.peak * parameters.dt / parameters.rise
        self._memory, self._capacity = memory, ROWS
        self._workspace = Workspace()
        self._reduced = ReducedWorld(world) if says_what_is_alike(world) else None
        self._graph = WorldGraph(self._reduced or world, parameters.cue, worth, horizon, memory)

    def reset(self, rng: np.random.Generator | None = None) -> None:
        """Take `rng` for random ties from now on."""
        if rng is not None:
            self._random = rng

    def warm_up(self) -> None:
        """Load the compiled search, so that the first decision takes no longer than the others.

        From the cache it takes a moment; on a new machine it compiles for up to a minute, and says so.
        """
        quick = copy(self)
        quick.horizon, quick.ties = 1, "first"
        quick.plan(Belief.initial(self.world, self.model), self.world.start())

    def plan(
        self, belief: Belief, state: Hashable, exact_values: bool = False, deadline: float | None = None
    ) -> Decision:
        """The decision in world `state` under `belief`.

        With a `deadline` (s from now), the decision at the longest horizon, up to the planner's, whose
        search ends by then; `Decision.horizon` says which, and the decision is exact at it. One step ahead is
        always looked, and that takes no time to speak of. Raises TypeError for what is no Belief, ValueError
        for one over other tasks or under another model, or a deadline that is not positive, and MemoryError
        where the worlds or beliefs within the horizon do not fit into the planner's memory; a deadline looks
        less far then.
        """
        if deadline is not None and not (_is_number(deadline) and deadline > 0):
            raise ValueError(f"deadline must be a positive number of seconds, not {deadline!r}")
        started = time.perf_counter()
        if not isinstance(belief, Belief):
            raise TypeError(f"belief must be a taskcomm.Belief, not {belief!r}")
        if not _same_models(belief.model, self.model) or not _same_tasks(belief.world, self.world):
            raise ValueError("the belief was made with another model or world than the planner")
        slack = np.inf if exact_values else _SLACK
        with no_collections() if deadline is None else undisturbed():
            until = started + (1.0 - _IN_HAND) * (math.inf if deadline is None else deadline)
            at = self._at(belief, state)
            looked: list[Looked] = []
            done = None
            for horizon in self._horizons(deadline, exact_values):
                end = math.inf if horizon == 1 else until
                search, ended = self._searched(belief, at, horizon, slack, end, done)
                if search is not None and deadline is not None:
                    looked.append(_looked(search))
                if not ended:
                    break
                done = search
            assert done is not None  # the first horizon has no deadline
            return self._decision(done, looked, Asked(self, belief, state), at, started)

    def _horizons(self, deadline: float | None, exact_values: bool) -> Sequence[int]:
        """The looks taken: each says of the next which action to search first."""
        if deadline is not None:
            return range(1, self.horizon + 1)
        if self.horizon < 6 or exact_values or self._tree is not None:
            return [self.horizon]
        return [self.horizon - 2, self.horizon]

    def _decision(
        self, search: Search | Branched, looked: list[Looked], asked: Asked, at: Hashable, started: float
    ) -> Decision:
        """The decision of the last search that ended, certified by all that began."""
        actions = tuple(self.world.actions(asked.state))
        instead = self._instead(at, len(actions))
        lower, upper = search.bound[instead], search.at_most[instead]
        bound, exact, at_most = lower.tolist(), search.exact[instead].tolist(), upper.tolist()
        least = min(value for value, known in zip(bound, exact, strict=True) if known)
        tied = [a for a, value in enumerate(bound) if exact[a] and value <= least + TIE]
        others = [value for a, value in enumerate(bound) if a not in tied]
        chosen = tied[0] if self.ties == "first" else tied[int(self._random.integers(len(tied)))]
        if search.horizon < self.horizon:
            lower, upper = (limit[instead] for limit in self._enclosed(looked, asked.belief))
        same = [a for a, other in enumerate(instead) if other == instead[chosen]]
        proof = certificate(actions, chosen, self.horizon, lower, upper, TIE, same)
        return Decision(
            action=actions[chosen],
            values={action: bound[a] for a, action in enumerate(actions) if exact[a]},
            bounds={action: bound[a] for a, action in enumerate(actions) if not exact[a]},
            upper_bounds={action: at_most[a] for a, action in enumerate(actions) if not exact[a]},
            ties=tuple(actions[a] for a in tied),
            gap=min(others, default=math.inf) - least,
            horizon=search.horizon,
            nodes=search.nodes,
            certificate=proof,
            seconds=time.perf_counter() - started,
            asked=asked,
        )

    def _at(self, belief: Belief, state: Hashable) -> Hashable:
        """The state in the world that is searched, in which one is looked at of what is alike."""
        if self._reduced is None or self._tree is not None:
            return state
        return self._reduced.reduced(belief, state)

    def _instead(self, at: Hashable, actions: int) -> list[int]:
        """By action, the number of the one that was searched for it."""
        if self._reduced is not None and isinstance(at, Reduced) and at.pairs:
            return self._reduced.instead(at)
        return list(range(actions))

    def _enclosed(self, looked: list[Looked], belief: Belief) -> tuple[Floats, Floats]:
        """Lower and upper bounds on Q at the planner's horizon, which lies further than was looked."""
        if self._tree is not None:
            told = self._tree.capacity
        else:
            parameters = belief.parameters
            told = most_told(parameters.mistake, parameters.peak, float(belief.marginal().max()))
        return enclosed(looked, np.full(self.horizon, told), self.gamma)

    @property
    def over_key(self) -> bool:
        """Whether an exact key is all that is planned over."""
        return self._tree is None

    def best(self, belief: Belief, state: Hashable, horizon: int) -> Decision:
        """The decision at another, shorter horizon, the first of the ties: a step of a contingent plan."""
        shorter = copy(self)  # shares the graph
        shorter.horizon, shorter.ties = horizon, "first"
        decision = shorter.plan(belief, state)
        self._capacity = shorter._capacity
        return decision

    def _searched(
        self,
        belief: Belief,
        at: Hashable,
        horizon: int,
        slack: float,
        until: float,
        before: Search | Branched | None,
    ) -> tuple[Search | Branched | None, bool]:
        """The search and whether it ended; none where `until` came before it began."""
        if self._tree is not None:
            branched = self._tree.search(belief, at, horizon, self.gamma, until)
            return branched, branched is not None
        known = None if before is None else before.bound
        root = self._graph.grow(at, horizon, until)
        if root is None or time.perf_counter() >= until:
            return None, False
        least = len(belief.task) * (len(belief.parameters.peak) + 2)  # its own, and a first step's
        rows = self._capacity if self._capacity >= least else self._room(belief, least - 1, least)
        while rows is not None:
            search = Search(
                belief, self._graph, root, horizon, slack, self.gamma, rows, known, self._workspace
            )
            ended = search.run(until)
            if search.fits:
                self._capacity = rows
                return search, ended
            rows = self._room(belief, rows, 4 * rows)
        if math.isinf(until):
            raise MemoryError(
                f"the beliefs {horizon} steps from one of {len(belief.task)} rows do not fit into"
                f" {self._memory} bytes: take a shorter horizon, a deadline, or more memory"
            )
        return None, False

    def _room(self, belief: Belief, few: int, wanted: int) -> int | None:
        """`wanted` rows or as many as there is room for; None where those are no more than `few`."""
        most = max(ROWS, self._memory // row_bytes(belief))
        return min(wanted, most) if most > few else None


def _is_number(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


def _same_models(one: TeacherModel, other: TeacherModel) -> bool:
    """Whether they are equal, and so is the order of what a belief knows of each approval."""
    return one is other or (one == other and list(one.approvals) == list(other.approvals))


def _same_tasks(one: World, other: World) -> bool:
    return one is other or list(one.tasks) == list(other.tasks)


def _looked(search: Search | Branched) -> Looked:
    """What a search that began says, without its arrays."""
    told = search.told if search.horizon > 2 else np.full(search.horizon, np.inf)  # it needs none before
    return Looked(search.horizon, search.bound.copy(), search.at_most, search.expected.copy(), told.copy())
