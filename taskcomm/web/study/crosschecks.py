"""What the keys of a design must be to one another."""

import math
from collections.abc import Iterable

from taskcomm.web.study.reading import nearest
from taskcomm.web.study.structure import Condition, Design, DesignError, Item

WIDEST = 11  # values of a scale that stand side by side


def check(design: Design) -> None:
    """Raise DesignError, key first, for the first thing that does not fit."""
    _check_conditions(design)
    _check_operators(design)
    _check_cards(design)
    for name, items in (("questionnaire", design.questionnaire), ("ratings", design.ratings)):
        for index, item in enumerate(items):
            _check_item(f"{name}[{index}]", item)
    _refuse_twice("questionnaire and ratings", [i.item for i in (*design.questionnaire, *design.ratings)])
    _refuse_twice("annotators", design.annotators)
    _check_timing(design)


def _check_conditions(design: Design) -> None:
    names = [condition.name for condition in design.conditions]
    _refuse_twice("conditions", names)
    if design.practice is not None and design.practice not in names:
        raise DesignError(f"practice: {design.practice!r} is no condition{nearest(design.practice, names)}")
    for index, condition in enumerate(design.conditions):
        as_is = Condition(name=condition.name, controller="operator")
        if condition.controller == "operator" and condition != as_is:
            raise DesignError(
                f"conditions[{index}]: model, horizon and threshold are a planner's; {condition.name!r} is an"
                " operator's"
            )


def _check_operators(design: Design) -> None:
    wanted = any(condition.controller == "operator" for condition in design.conditions)
    operators = design.operators
    if operators is None:
        if wanted:
            raise DesignError("operators: is missing, and a condition is controlled by an operator")
        return
    if not wanted:
        raise DesignError("operators: no condition is controlled by an operator")
    if operators.draw > design.teachers:
        raise DesignError(f"operators.draw: {operators.draw} for {design.teachers} teachers leaves some idle")
    if isinstance(operators.pool, tuple):
        _refuse_twice("operators.pool", operators.pool)
        if len(operators.pool) < operators.draw:
            raise DesignError(f"operators.draw: {operators.draw} from a pool of {len(operators.pool)}")
    elif operators.pool not in (None, design.teachers + operators.draw):
        raise DesignError(
            f"operators.pool: {operators.pool} people of whom {operators.draw} operate leave"
            f" {operators.pool - operators.draw} teachers, not {design.teachers}"
        )


def _check_cards(design: Design) -> None:
    if isinstance(design.cards, str):
        return
    if not design.cards:
        raise DesignError("cards: the list holds no card")
    tasks = set(design.ball_world.tasks)
    for index, card in enumerate(design.cards):
        if card not in tasks:
            balls, distances = design.world.balls, design.world.distances
            raise DesignError(
                f"cards[{index}]: [mov, wrt, dist] are two balls of 1 to {balls} and a distance of 1 to"
                f" {distances}, not {list(card)}"
            )
    _refuse_twice("cards", [str(list(card)) for card in design.cards])


def _check_item(where: str, item: Item) -> None:
    bounded = item.kind in ("integer", "scale")
    if bounded and (item.low is None or item.high is None or item.low >= item.high):
        raise DesignError(f"{where}: {item.item!r} needs whole numbers low < high")
    if not bounded and (item.low is not None or item.high is not None):
        raise DesignError(f"{where}: {item.item!r} is a {item.kind}, which has no low and high")
    if (item.kind == "choice") != bool(item.choices):
        says = "needs choices" if item.kind == "choice" else f"is a {item.kind}, which has no choices"
        raise DesignError(f"{where}: {item.item!r} {says}")
    _refuse_twice(f"{where}.choices", item.choices)
    if item.kind == "choice" and len(item.choices) < 2:
        raise DesignError(f"{where}: {item.item!r} needs two choices at least")
    if item.kind == "scale" and item.low is not None and item.high is not None:
        width = item.high - item.low + 1
        if width > WIDEST:
            raise DesignError(f"{where}: a scale has at most {WIDEST} values, {item.item!r} has {width}")


def _check_timing(design: Design) -> None:
    timing = design.timing
    steps = timing.limit / timing.step
    if not math.isclose(steps, round(steps), rel_tol=1e-9):
        raise DesignError(
            f"timing.limit: {timing.limit:g} s is no whole number of steps of {timing.step:g} s"
        )
    if timing.countdown != round(timing.countdown):
        raise DesignError(f"timing.countdown: {timing.countdown:g} s is no whole number of seconds")
    planned = any(condition.controller == "planner" for condition in design.conditions)
    if timing.countdown < 1 and planned and design.operators is not None and not design.simulated:
        raise DesignError(
            "timing.countdown: must be 1 s at least where a planner and operators take turns: it hides from"
            " the teacher which of them thinks before the first step"
        )


def _refuse_twice(where: str, names: Iterable[str]) -> None:
    seen = set[str]()
    for name in names:
        if name in seen:
            raise DesignError(f"{where}: {name} is there twice")
        seen.add(name)
