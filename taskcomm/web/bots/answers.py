"""What a simulated teacher answers on the pages of a study. Nothing here tells anything about people."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

Value = str | int | float | bool | None
RIGHT, WRONG = 0.8, 0.35  # of a scale from 0 to 1: what a trial that ended right, or not, is worth
PATIENCE = 120  # steps after which a trial is worth no less
SLOWEST = 0.3  # taken off by then
NOISE = 0.12


def rating(low: int, high: int, right: bool | None, steps: int, rng: np.random.Generator) -> int:
    """A whole number from `low` to `high`: a stated rule, made up, so that ratings are there to work on.

    0.8 of the scale after a trial that ended right, else 0.35, less 0.3 in proportion to the steps it took
    (from 120 on no less), and a normal draw of spread 0.12.
    """
    worth = (RIGHT if right else WRONG) - SLOWEST * min(1.0, steps / PATIENCE)
    worth += NOISE * float(rng.standard_normal())
    return int(np.clip(round(low + (high - low) * worth), low, high))


def answers(
    items: Sequence[Mapping[str, Any]], right: bool | None, steps: int, rng: np.random.Generator
) -> dict[str, Value]:
    """A value for each item of a form, by its kind.

    `right` says whether the last trial ended with the teacher's task (None: there was none), `steps` how long
    it was. Of two choices after a trial the one is taken that says yes to `right`; a scale after a trial is a
    `rating`; all else is drawn uniformly, ages from 18 to 60.
    """
    return {str(item["item"]): _answer(item, right, steps, rng) for item in items}


def _answer(item: Mapping[str, Any], right: bool | None, steps: int, rng: np.random.Generator) -> Value:
    kind = item["kind"]
    if kind == "choice":
        return _chosen(list(item["choices"]), right, rng)
    if kind == "text":
        return "simulated"
    low, high = int(item.get("low") or 0), int(item.get("high") or 99)
    if kind == "scale" and right is not None:
        return rating(low, high, right, steps, rng)
    if kind == "integer":
        low, high = (max(low, 18), min(high, 60)) if low <= 18 and high >= 60 else (low, high)
    return int(rng.integers(low, high + 1))


def _chosen(choices: list[Any], right: bool | None, rng: np.random.Generator) -> Value:
    values = [choice["value"] if isinstance(choice, Mapping) else choice for choice in choices]
    if right is not None and {"yes", "no"} <= set(values):
        return "yes" if right else "no"
    value: Value = values[int(rng.integers(len(values)))]
    return value
