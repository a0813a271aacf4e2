"""Who does what: operators, orders of conditions and cards, drawn once from the seed of the design."""

from collections.abc import Sequence
from itertools import permutations
from typing import Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from taskcomm.tasks import Task
from taskcomm.web.study.structure import Condition, Design, Id

Indices = NDArray[np.int64]


class TrialPlan(msgspec.Struct, frozen=True, kw_only=True):
    """One trial before it is run. `index` counts a participant's trials from 0; that of a practice is 0.

    `operator_id` is who sits at the operator's page, whichever the condition: None in a study without.
    """

    trial_id: Id
    participant_id: Id
    operator_id: Id | None
    index: int
    condition: str
    controller: Literal["planner", "operator"]
    task: Task
    practice: bool


class Participant(msgspec.Struct, frozen=True, kw_only=True):
    """A teacher, the operator of all of the teacher's trials, and these in their order, a practice first.

    `person` is the teacher's number in a pool of everybody, from 1.
    """

    id: Id
    person: int | None
    operator: Id | None
    trials: tuple[TrialPlan, ...]


def assign(design: Design) -> tuple[Participant, ...]:
    """Every teacher's trials; the same for the same design.

    Operators, orders of conditions (also among the teachers of one operator) and, in each condition and in
    all, cards are dealt so that none comes up twice more than another; within that, everything is drawn
    uniformly. No teacher has a card twice while there are cards enough.
    """
    rngs = [np.random.default_rng(seed) for seed in np.random.SeedSequence(design.seed).spawn(4)]
    names = _numbered("P", design.teachers)
    operators = operator_ids(design)
    of_teacher, seats = _operators(design, len(operators), rngs[1])
    orders = _orders(design, seats, rngs[2])
    cards = _cards(design, rngs[3])
    drawn = set(drawn_people(design))
    teaching = [number for number in range(1, design.teachers + len(drawn) + 1) if number not in drawn]
    return tuple(
        _participant(
            design,
            name,
            teaching[row] if drawn else None,
            operators[of_teacher[row]] if operators else None,
            [design.conditions[place] for place in orders[row]],
            [cards[row][place] for place in orders[row]],
            cards[row][-1],
        )
        for row, name in enumerate(names)
    )


def operator_ids(design: Design) -> tuple[str, ...]:
    """The operators: ids of the pool, or O1, O2, ... where the pool is everybody."""
    if design.operators is None:
        return ()
    if isinstance(design.operators.pool, tuple):
        return tuple(design.operators.pool[place] for place in _draw(design, len(design.operators.pool)))
    return tuple(_numbered("O", design.operators.draw))


def drawn_people(design: Design) -> tuple[int, ...]:
    """Numbers, from 1, of those of everybody who operate, in the order of `operator_ids`; () for a list."""
    if design.operators is None or isinstance(design.operators.pool, tuple):
        return ()
    return tuple(place + 1 for place in _draw(design, design.teachers + design.operators.draw))


def _draw(design: Design, pool: int) -> list[int]:
    assert design.operators is not None
    rng = np.random.default_rng(np.random.SeedSequence(design.seed).spawn(1)[0])
    return sorted(int(place) for place in rng.choice(pool, design.operators.draw, replace=False))


def _numbered(letter: str, count: int) -> list[str]:
    width = max(2 if letter == "P" else 1, len(str(count)))
    return [f"{letter}{number:0{width}}" for number in range(1, count + 1)]


def _operators(design: Design, count: int, rng: np.random.Generator) -> tuple[Indices, Indices]:
    """The operator of each teacher, as evenly as may be; and the teachers, those of one operator together."""
    teachers = rng.permutation(design.teachers)
    count = max(count, 1)
    dealt = rng.permutation(count)[np.arange(design.teachers) % count]
    of_teacher = np.empty(design.teachers, dtype=np.int64)
    of_teacher[teachers] = dealt
    return of_teacher, teachers[np.argsort(dealt, kind="stable")]


def _orders(design: Design, seats: Indices, rng: np.random.Generator) -> dict[int, tuple[int, ...]]:
    """The order of conditions of each teacher. Any run of one cycle over all orders is balanced, so those of
    an operator are, and all are."""
    count = len(design.conditions)
    if design.order == "fixed":
        return {int(teacher): tuple(range(count)) for teacher in seats}
    cycle = rng.permutation(list(permutations(range(count))))
    return {int(t): tuple(map(int, cycle[at % len(cycle)])) for at, t in enumerate(seats)}


def _cards(design: Design, rng: np.random.Generator) -> list[list[Task]]:
    """The cards of each teacher, by condition as listed, then that of a practice.

    A deck for each condition goes on where the one before ended in one cycle over all tasks, so that every
    deck and all of them together are balanced.
    """
    tasks = (
        design.ball_world.tasks if isinstance(design.cards, str) else [Task(*card) for card in design.cards]
    )
    shape = design.teachers, len(design.conditions) + 1
    if design.cards == "random":
        hands = np.array([np.resize(rng.permutation(len(tasks)), shape[1]) for _ in range(shape[0])])
    else:
        hands = _dealt(shape, len(tasks), rng)
    return [[tasks[place] for place in hand] for hand in hands]


def _dealt(shape: tuple[int, int], count: int, rng: np.random.Generator) -> Indices:
    """Balanced decks of `count` cards as columns: who gets which card of a deck is drawn among those
    dealings in which fewest come twice to anyone."""
    teachers, decks = shape
    cycle = rng.permutation(count)
    slots = cycle[np.arange(decks * teachers) % count].reshape(decks, teachers)
    hands = np.full(shape, -1, dtype=np.int64)
    for number, deck in enumerate(slots):
        twice = (hands[:, :number, None] == deck).any(axis=1)
        cost = rng.random((teachers, teachers)) + teachers * twice
        hands[:, number] = deck[linear_sum_assignment(cost)[1]]
    return hands


def _participant(
    design: Design,
    name: str,
    person: int | None,
    operator: str | None,
    conditions: Sequence[Condition],
    tasks: Sequence[Task],
    practice: Task,
) -> Participant:
    def plan(index: int, condition: Condition, task: Task, practice: bool = False) -> TrialPlan:
        return TrialPlan(
            trial_id=f"{name}-practice" if practice else f"{name}-{index + 1}",
            participant_id=name,
            operator_id=operator,
            index=index,
            condition=condition.name,
            controller=condition.controller,
            task=task,
            practice=practice,
        )

    first = [plan(0, design.condition(design.practice), practice, True)] if design.practice else []
    counted = [plan(n, c, task) for n, (c, task) in enumerate(zip(conditions, tasks, strict=True))]
    return Participant(id=name, person=person, operator=operator, trials=(*first, *counted))


def written(participants: Sequence[Participant]) -> list[dict[str, Any]]:
    """The assignment as plain values, for participants.json; a card is [mov, wrt, dist]."""
    plain: list[dict[str, Any]] = msgspec.to_builtins(participants)
    return plain
