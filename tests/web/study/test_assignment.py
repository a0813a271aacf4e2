"""Who does what: balanced, random, and the same for the same design."""

from collections import Counter
from collections.abc import Iterable
from itertools import permutations

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskcomm.web.study.assignment import Participant, assign, drawn_people, operator_ids
from taskcomm.web.study.design import Condition, Design, Operators, WorldDesign, parsed
from taskcomm.web.study.folder import template
from taskcomm.web.study.structure import HUMAN, ROBOT

PAPER = parsed(template())
THIRD = Condition(name="quick", controller="planner", horizon=2)


@st.composite
def designs(draw: st.DrawFn) -> Design:
    """Designs of any size with one to four conditions, one of them an operator's."""
    teachers = draw(st.integers(1, 50))
    more = tuple(Condition(name=f"c{n}", controller="planner") for n in range(draw(st.integers(0, 3))))
    return Design(
        name="a",
        seed=draw(st.integers(0, 10**6)),
        teachers=teachers,
        operators=Operators(draw=draw(st.integers(1, min(6, teachers)))),
        world=WorldDesign(balls=draw(st.integers(2, 4)), distances=draw(st.integers(1, 4))),
        conditions=(HUMAN, *more),
        practice=draw(st.sampled_from([None, "operator"])),
    )


def spread(counted: Iterable[object], among: Iterable[object]) -> int:
    """How many times more often the most frequent of `among` comes than the least frequent."""
    counts = Counter(counted)
    numbers = [counts[each] for each in among]
    assert sum(numbers) == counts.total()
    return max(numbers) - min(numbers)


def order(participant: Participant) -> tuple[str, ...]:
    return tuple(trial.condition for trial in participant.trials if not trial.practice)


@given(designs())
def test_the_same_design_gives_the_same_assignment_and_survives_json(design: Design) -> None:
    participants = assign(design)
    assert assign(design) == participants
    decoded = msgspec.json.decode(msgspec.json.encode(participants), type=tuple[Participant, ...])
    assert decoded == participants


@given(designs())
def test_operators_orders_and_cards_are_balanced(design: Design) -> None:
    participants = assign(design)
    names = [condition.name for condition in design.conditions]
    orders, tasks = list(permutations(names)), design.ball_world.tasks
    assert spread((p.operator for p in participants), operator_ids(design)) <= 1
    assert spread(map(order, participants), orders) <= 1
    for operator in operator_ids(design):
        assert spread((order(p) for p in participants if p.operator == operator), orders) <= 1
    counted = [trial for p in participants for trial in p.trials if not trial.practice]
    assert spread((trial.task for trial in counted), tasks) <= 1
    for name in names:
        assert spread((trial.task for trial in counted if trial.condition == name), tasks) <= 1


@given(designs())
def test_nobody_has_a_card_twice_while_there_are_cards_enough(design: Design) -> None:
    enough = len(design.ball_world.tasks) > len(design.conditions)
    for participant in assign(design):
        tasks = [trial.task for trial in participant.trials]
        assert len(set(tasks)) == len(tasks) or not enough


@given(designs())
def test_trials_say_whose_they_are(design: Design) -> None:
    participants = assign(design)
    seen = [trial.trial_id for participant in participants for trial in participant.trials]
    assert len(set(seen)) == len(seen)
    for participant in participants:
        practice = [trial for trial in participant.trials if trial.practice]
        counted = [trial for trial in participant.trials if not trial.practice]
        assert participant.trials == (*practice, *counted)
        assert [trial.condition for trial in practice] == ([design.practice] if design.practice else [])
        assert [trial.index for trial in counted] == list(range(len(design.conditions)))
        for trial in participant.trials:
            assert (trial.participant_id, trial.operator_id) == (participant.id, participant.operator)
            assert trial.controller == design.condition(trial.condition).controller


def test_the_papers_draw_makes_26_people_4_operators_and_22_teachers() -> None:
    participants, drawn = assign(PAPER), drawn_people(PAPER)
    assert operator_ids(PAPER) == ("O1", "O2", "O3", "O4")
    assert [participant.id for participant in participants] == [f"P{n:02}" for n in range(1, 23)]
    assert sorted([*drawn, *(p.person or 0 for p in participants)]) == list(range(1, 27))
    assert Counter(map(order, participants)) == {("pomdp", "operator"): 11, ("operator", "pomdp"): 11}
    assert {trial.trial_id for trial in participants[0].trials} == {"P01-practice", "P01-1", "P01-2"}


def test_a_pool_of_ids_only_operates() -> None:
    pool = tuple(f"staff-{n}" for n in range(6))
    design = msgspec.structs.replace(PAPER, operators=Operators(pool=pool, draw=3))
    participants = assign(design)
    assert len(participants) == 22
    assert drawn_people(design) == ()
    assert set(operator_ids(design)) < set(pool)
    assert {participant.operator for participant in participants} == set(operator_ids(design))
    assert all(participant.person is None for participant in participants)


def chosen(seed: int) -> list[Participant]:
    design = msgspec.structs.replace(PAPER, seed=seed, teachers=4, operators=Operators(draw=2))
    return list(assign(design))


def test_every_draw_is_uniform_over_seeds() -> None:
    """Each outcome as often as it should be, within 4.5 standard deviations of the binomial."""
    seeds = 2000
    studies = [chosen(seed) for seed in range(seeds)]
    drawn = Counter(
        person
        for seed in range(seeds)
        for person in drawn_people(
            msgspec.structs.replace(PAPER, seed=seed, teachers=4, operators=Operators(draw=2))
        )
    )
    first_orders = Counter(order(study[0]) for study in studies)
    operators = Counter(study[0].operator for study in studies)
    cards = Counter(study[0].trials[1].task for study in studies)
    for counts, chance, kinds in (
        (drawn, 1 / 3, 6),
        (first_orders, 1 / 2, 2),
        (operators, 1 / 2, 2),
        (cards, 1 / 24, 24),
    ):
        assert len(counts) == kinds
        sigma = (seeds * chance * (1 - chance)) ** 0.5
        assert max(abs(count - seeds * chance) for count in counts.values()) < 4.5 * sigma


def test_drawing_cards_or_conditions_anew_leaves_the_operators_as_they_are() -> None:
    other = msgspec.structs.replace(PAPER, cards="random", conditions=(ROBOT, HUMAN, THIRD))
    assert drawn_people(other) == drawn_people(PAPER)
    assert [p.operator for p in assign(other)] == [p.operator for p in assign(PAPER)]


def test_a_fixed_order_is_that_of_the_design_and_listed_cards_are_the_only_ones() -> None:
    design = msgspec.structs.replace(PAPER, order="fixed", cards=((1, 2, 4), (3, 1, 1)))
    participants = assign(design)
    assert set(map(order, participants)) == {("pomdp", "operator")}
    assert {tuple(trial.task) for p in participants for trial in p.trials} == {(1, 2, 4), (3, 1, 1)}
    for participant in participants:
        counted = [trial.task for trial in participant.trials if not trial.practice]
        assert len(set(counted)) == 2


@pytest.mark.parametrize("teachers", [99, 100, 1000])
def test_ids_sort_as_they_count(teachers: int) -> None:
    design = Design(name="a", teachers=teachers, cards="random")
    names = [participant.id for participant in assign(design)]
    assert names == sorted(names)
    assert len(set(names)) == teachers
