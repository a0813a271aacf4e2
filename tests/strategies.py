"""Hypothesis draws worlds, walks through them, presses and teacher models."""

from collections.abc import Hashable
from typing import Any

from hypothesis import strategies as st

from taskcomm.teacher import TableTop, TeacherModel
from taskcomm.world import BallWorld, World

CUES = BallWorld.cue_names


def worlds(max_balls: int = 4, max_distances: int = 4) -> st.SearchStrategy[BallWorld]:
    return st.builds(
        BallWorld,
        num_balls=st.integers(2, max_balls),
        num_distances=st.integers(1, max_distances),
        slide_unheld=st.booleans(),
    )


@st.composite
def walks(draw: st.DrawFn, world: World, max_steps: int) -> list[tuple[Any, Hashable]]:
    """(action, state reached) for each step of a random walk of 1 to `max_steps` valid actions.

    Every second action or so is the first in canonical order, `noa`, so that cues stay on a while.
    """
    state, walk = world.start(), []
    for _ in range(draw(st.integers(1, max_steps))):
        actions = world.actions(state)
        action = actions[max(0, draw(st.integers(-len(actions), len(actions) - 1)))]
        state = world.step(state, action)
        walk.append((action, state))
    return walk


def seconds(least: float, most: float) -> st.SearchStrategy[float]:
    """Times on and off the lattice of half-second steps."""
    return st.one_of(
        st.integers(int(2 * least), int(2 * most)).map(lambda n: n / 2),
        st.floats(least, most, allow_subnormal=False),
    )


def table_tops(dt: float = 0.5) -> st.SearchStrategy[TableTop]:
    return st.builds(
        TableTop,
        cue=st.sampled_from(CUES),
        peak=st.floats(0.0, 0.3, allow_subnormal=False),
        rise=seconds(dt, 4.0),
        fall=seconds(dt, 4.0),
        delay=st.one_of(st.just(0.0), seconds(0.0, 2.0)),
        decay=st.one_of(st.none(), st.floats(0.3, 5.0)),
        hold=seconds(0.0, 1.5),
    )


def models(max_states: int = 3, dt: float = 0.5) -> st.SearchStrategy[TeacherModel]:
    """Any structure: unequal rises and falls, whole and fractional delays, decay, rest."""
    return st.builds(
        TeacherModel,
        mistake=st.floats(1e-4, 0.05),
        approvals=st.lists(table_tops(dt), min_size=1, max_size=max_states).map(
            lambda tops: {f"that_{number}": top for number, top in enumerate(tops)}
        ),
        dt=st.just(dt),
        rest=st.one_of(st.just(0.0), seconds(0.0, 1.5)),
    )
