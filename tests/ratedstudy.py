"""The simulated study of the paper's shape, with ratings made up for it."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

from taskcomm.logs import read_trials
from taskcomm.trials import Trial

DATA = Path(__file__).parents[1] / "datasets" / "simulated-study"


@cache
def unrated() -> tuple[Trial, ...]:
    return tuple(read_trials(DATA))


@cache
def rated(operator: tuple[int, ...] = (9,) * 22, pomdp: tuple[int, ...] = (8,) * 22) -> tuple[Trial, ...]:
    """The study with these ratings of intelligence by teacher, and their word on whether it was right."""
    given = {"operator": iter(operator), "pomdp": iter(pomdp)}
    return tuple(with_ratings(trial, next(given[trial.condition])) for trial in unrated())


def with_ratings(trial: Trial, value: int) -> Trial:
    right = {"item": "right", "value": "yes" if trial.correct else "no", "scale": ["yes", "no"]}
    return replace(trial, ratings=({"item": "intelligence", "value": value, "scale": [1, 10]}, right))


def of_condition(trials: Sequence[Trial], condition: str) -> list[Trial]:
    return [trial for trial in trials if trial.condition == condition]


def labelled(trial: Trial, *states: tuple[int, str, str]) -> Trial:
    """The trial without what its simulation notes, with labels (step, mental state, annotator)."""
    bare = replace(trial, steps=tuple(replace(step, mental_state=None) for step in trial.steps))
    return replace(
        bare,
        labels=tuple(
            {"press_seq": bare.step_seqs[step], "mental_state": state, "annotator": name}
            for step, state, name in states
        ),
    )
