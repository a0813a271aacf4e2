"""Seeded random worlds, by their size, and random teacher models for them."""

import numpy as np
from graphworld import graph_world
from tinyworld import MENU_CUES, Menu

from taskcomm.teacher import TableTop, TeacherModel
from taskcomm.world import BallWorld, World

Random = np.random.Generator
DISHES = ("soup", "pizza", "paella", "crêpe", "salad")


def tiny_world(rng: Random) -> World:
    """Few tasks and actions: whole trees of four and five steps are quick."""
    kind = rng.integers(3)
    if kind == 0:
        return BallWorld(2, int(rng.integers(1, 3)))
    if kind == 1:
        return Menu(DISHES[: rng.integers(1, 4)], MENU_CUES[: rng.integers(1, 6)])
    return graph_world(rng, most_tasks=4, most_actions=3)


def small_world(rng: Random) -> World:
    kind = rng.integers(4)
    if kind == 0:
        return BallWorld(2, int(rng.integers(1, 6)), slide_unheld=bool(rng.integers(2)))
    if kind == 1:
        return BallWorld(3, int(rng.integers(1, 3)))
    if kind == 2:
        return Menu(DISHES[: rng.integers(2, 6)], MENU_CUES[: rng.integers(1, 6)])
    return graph_world(rng)


def large_world(rng: Random) -> World:
    if rng.integers(4) == 0:
        return graph_world(rng, most_tasks=30, most_actions=12, num_cues=8)
    return BallWorld(int(rng.integers(3, 5)), int(rng.integers(1, 6)), slide_unheld=bool(rng.integers(2)))


def paper_world(rng: Random) -> World:
    return BallWorld()


def wide_world(rng: Random) -> World:
    """As many cues as a model may have approval states, and a model that `random_model` gives them all."""
    return graph_world(rng, num_cues=16)


def _seconds(rng: Random, least: float, most: float, dt: float) -> float:
    """On the lattice of steps or off it."""
    if rng.random() < 0.5:
        return float(least + dt * rng.integers(0, int((most - least) / dt) + 1))
    return float(rng.uniform(least, most))


def random_model(rng: Random, world: World, slow: bool = False) -> TeacherModel:
    """Any structure: 1 to 3 approval states (6 to 16 where there are 16 cues), delays, decay, rest.

    Levels that jump, creep or never reach the top; peaks of 0; approvals up to 0.98 in all, mistakes
    down to 1e-9; steps of a quarter, a half or a whole second. With `slow`, levels that remember many
    presses.
    """
    dt, cues = float(rng.choice([0.25, 0.5, 0.5, 0.5, 1.0])), list(world.cue_names)
    states = int(rng.integers(6, 17)) if len(cues) == 16 else int(rng.integers(1, 4))
    peaks = rng.dirichlet(np.ones(states)) * rng.choice([0.02, 0.3, 0.6, 0.98])
    peaks[rng.random(states) < 0.1] = 0.0
    late, fading = rng.random() < 0.4, rng.random() < 0.25

    def top(peak: float) -> TableTop:
        speeds = [dt, _seconds(rng, dt, 4.0, dt), _seconds(rng, dt, 4.0, dt), 1000.0]
        rise, fall = (float(rng.choice(speeds, p=[0.1, 0.4, 0.4, 0.1])) for _ in range(2))
        if slow:
            rise, fall = (float(rng.uniform(4.0, 20.0)) for _ in range(2))
        return TableTop(
            cue=str(rng.choice(cues)),
            peak=float(peak),
            rise=rise,
            fall=fall,
            delay=_seconds(rng, 0.0, 4.0 if rng.random() < 0.2 else 1.5, dt) if late else 0.0,
            decay=float(rng.uniform(0.3, 5.0)) if fading and rng.random() < 0.7 else None,
            hold=_seconds(rng, 0.0, 1.5, dt),
        )

    return TeacherModel(
        mistake=float(rng.choice([1e-9, 1e-3, 0.005, 0.015])),
        approvals={f"that_{number}": top(peak) for number, peak in enumerate(peaks)},
        dt=dt,
        rest=0.0 if slow else float(rng.choice([0.0, 0.0, _seconds(rng, dt, 1.5, dt)])),
    )
