"""A contingent plan: the best action at every point that the coming observations may lead to."""

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from taskcomm.belief import Belief

Floats = NDArray[np.float64]
ALIKE = 1e-9


class Choice(Protocol):
    """An action and its expected cost in nats."""

    @property
    def action(self) -> Any: ...
    @property
    def value(self) -> float: ...


Choose = Callable[[Belief, Hashable, int], Choice]


class Shift(NamedTuple):
    """How P(one part of the task) moves over a step; `part` is "task" where tasks have no named parts."""

    part: str
    value: Any
    before: float
    after: float


class Group(NamedTuple):
    """Tasks that make a press in a step equally likely, and their share of the belief before it."""

    press_probability: float
    share: float
    tasks: tuple[Any, ...]


@dataclass(frozen=True, eq=False)
class Branch:
    """One of the two things that may be observed in a step, and the plan from there.

    `probability` is given all before the step, `reach` as seen from the decision. `reasons` is P(mental
    state) of a press. `entropy` (nats) and `marginal` (tasks) are the belief's afterwards; `later` is the
    discounted sum of expected entropy from there to the horizon, in nats. `then` is None where the plan
    ends or is followed no further.
    """

    pressed: bool
    probability: float
    reach: float
    reasons: Mapping[str, float]
    entropy: float
    marginal: Floats
    later: float
    then: "PlannedStep | None"


@dataclass(frozen=True, eq=False)
class PlannedStep:
    """The action at one point of the plan, `left` steps before the horizon, and what may follow.

    `value` is its Q_left in nats, added up from the branches; `before` is the marginal over tasks;
    `groups` are the tasks that the step tells apart, the likeliest to be pressed for first.
    """

    action: Any
    left: int
    value: float
    before: Floats
    groups: tuple[Group, ...]
    silent: Branch
    press: Branch

    def chain(self) -> Iterator["PlannedStep"]:
        """This step, and those that follow as long as nothing is pressed."""
        step: PlannedStep | None = self
        while step is not None:
            yield step
            step = step.silent.then

    def branches(self) -> Iterator[tuple["PlannedStep", Branch]]:
        """Every branch with the step that it follows; a step comes before what follows it."""
        for branch in (self.silent, self.press):
            yield self, branch
            if branch.then is not None:
                yield from branch.then.branches()

    def is_same_plan(self, other: "PlannedStep") -> bool:
        """Whether both hold the same action at every point."""
        if self.action != other.action:
            return False
        for own, its in ((self.silent.then, other.silent.then), (self.press.then, other.press.then)):
            if own is None or its is None:
                if own is not its:
                    return False
            elif not own.is_same_plan(its):
                return False
        return True

    def likely_presses(self, least: float, most: int) -> list[Branch]:
        """The first step's press branch, then up to `most` in all of at least `least`, the likeliest first.

        None is given without those that lead to it.
        """
        presses = [branch for _, branch in self.branches() if branch.pressed and branch is not self.press]
        presses = sorted(presses, key=lambda branch: -branch.reach)  # stable: causes stay before effects
        return [self.press, *(branch for branch in presses[: most - 1] if branch.reach >= least)]


def contingent_plan(
    belief: Belief,
    state: Hashable,
    action: Any,
    left: int,
    depth: int,
    choose: Choose,
    gamma: float = 1.0,
    reach: float = 1.0,
) -> PlannedStep:
    """The plan that begins with `action`, `left` steps before the horizon, followed for `depth` steps.

    After that, every action is the one that `choose(belief, state, steps left)` finds best.

        Q_left = sum over observations o of P(o) (C(b_o) + gamma min_a Q_{left-1}(b_o, a))

    Source: MODEL.md, section 6.
    """
    reached = belief.world.step(state, action)
    joint = belief.press_joint(reached)
    press = float(joint.sum())
    reasons = dict(zip(belief.model.mental_states[1:], (joint.sum(axis=0) / press).tolist(), strict=True))
    branches = []
    for pressed, probability in ((False, 1 - press), (True, press)):
        after, then, later = belief.update(reached, pressed), None, 0.0
        if left > 1:
            best = choose(after, reached, left - 1)
            later = best.value
            if depth > 1:
                then = contingent_plan(
                    *(after, reached, best.action, left - 1, depth - 1),
                    *(choose, gamma, reach * probability),
                )
                later = then.value
        branches.append(
            Branch(
                pressed=pressed,
                probability=probability,
                reach=reach * probability,
                reasons=reasons if pressed else {},
                entropy=after.entropy(),
                marginal=after.marginal(),
                later=later,
                then=then,
            )
        )
    value = sum(branch.probability * (branch.entropy + gamma * branch.later) for branch in branches)
    return PlannedStep(action, left, value, belief.marginal(), _groups(belief, joint), *branches)


def _groups(belief: Belief, joint: Floats) -> tuple[Group, ...]:
    """The tasks of a belief by how likely each makes a press, `joint` being P(task, reason of a press)."""
    share = belief.marginal()
    press = joint.sum(axis=1) / np.where(share > 0, share, 1.0)
    groups: list[list[int]] = []
    for task in sorted(np.flatnonzero(share).tolist(), key=lambda task: -press[task]):
        if groups and press[groups[-1][0]] - press[task] <= ALIKE:
            groups[-1].append(task)
        else:
            groups.append([task])
    return tuple(
        Group(
            float(press[group[0]]),
            float(share[group].sum()),
            tuple(belief.world.tasks[task] for task in sorted(group)),
        )
        for group in groups
    )


def parts_of(tasks: Sequence[Any]) -> tuple[str, ...]:
    """The names of the parts of a task (mov, wrt, dist), or "task" where tasks have none.

    >>> parts_of(["soup", "pizza"])
    ('task',)
    """
    return tuple(getattr(tasks[0], "_fields", ())) or ("task",)


def part_of(task: Any, part: str) -> Any:
    """One part of a task; the whole of it where tasks have none."""
    return getattr(task, part) if part in getattr(task, "_fields", ()) else task


def shifts(tasks: Sequence[Any], before: Floats, after: Floats) -> tuple[Shift, ...]:
    """How the marginals of the tasks' parts move, the greatest rise first and the greatest fall last.

    >>> shifts(["soup", "pizza"], np.array([0.5, 0.5]), np.array([0.25, 0.75]))[0]
    Shift(part='task', value='pizza', before=0.5, after=0.75)
    """
    found = []
    for part in parts_of(tasks):
        values = [part_of(task, part) for task in tasks]
        for value in dict.fromkeys(values):
            of_it = np.array([other == value for other in values])
            found.append(Shift(part, value, float(before[of_it].sum()), float(after[of_it].sum())))
    return tuple(sorted(found, key=lambda shift: shift.before - shift.after))
