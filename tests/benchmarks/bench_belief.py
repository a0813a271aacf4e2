"""One trial of 120 steps and 6 presses in the paper's world: the belief against plain loops."""

from collections.abc import Callable
from typing import Any

import numpy as np
import plainfilter
import pytest

from taskcomm.belief import Belief
from taskcomm.teacher import TeacherModel
from taskcomm.world import BallWorld

WORLD = BallWorld()
MODEL = TeacherModel.intuitive()


def trial() -> tuple[list[Any], list[bool]]:
    rng = np.random.default_rng(1)
    state, states = WORLD.start(), []
    for _ in range(120):
        actions = WORLD.actions(state)
        state = WORLD.step(state, actions[rng.integers(len(actions))])
        states.append(state)
    at = set(rng.choice(120, size=6, replace=False).tolist())
    return states, [step in at for step in range(120)]


def by_belief(states: list[Any], pressed: list[bool]) -> list[float]:
    belief = Belief.initial(WORLD, MODEL)
    for state, press in zip(states, pressed, strict=True):
        belief = belief.update(state, press)
    return list(belief.marginal())


def by_loops(states: list[Any], pressed: list[bool]) -> list[float]:
    return plainfilter.marginal(WORLD, MODEL, states, pressed)


@pytest.mark.benchmark(group="a trial of 120 steps")
@pytest.mark.parametrize("way", [by_belief, by_loops])
def bench_filter(benchmark: Any, way: Callable[..., list[float]]) -> None:
    benchmark.pedantic(way, args=trial(), rounds=3, warmup_rounds=1)
