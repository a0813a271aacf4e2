"""Where a plateau has decayed, a reset makes presses likelier; the planner decides as the whole tree does."""

import numpy as np
import pytest
from graphworld import graph_world
from plaintree import PlainTree
from trees import assert_decides_as

from taskcomm.belief import Belief
from taskcomm.planner import EntropyPlanner
from taskcomm.teacher import TableTop, TeacherModel
from taskcomm.world import BallWorld, World

Random = np.random.Generator


def decaying(rng: Random, world: World) -> TeacherModel:
    """Cues that are on tell little after a second, until their level is reset."""

    def top(peak: float) -> TableTop:
        return TableTop(
            cue=str(rng.choice(world.cue_names)),
            peak=peak,
            rise=float(rng.choice([0.5, 1.0])),
            fall=float(rng.choice([0.5, 2.0, 1000.0])),
            delay=float(rng.choice([0.0, 0.0, 0.3, 0.5])),
            decay=float(rng.choice([0.1, 0.3, 0.5])),
            hold=float(rng.choice([0.0, 0.5, 1.0])),
        )

    peaks = rng.dirichlet(np.ones(rng.integers(1, 4))) * rng.choice([0.3, 0.6, 0.95])
    approvals = {f"that_{number}": top(float(peak)) for number, peak in enumerate(peaks)}
    return TeacherModel(mistake=0.005, approvals=approvals)


@pytest.mark.parametrize("horizon", [2, 3])
def test_cues_on_for_long_are_decided_as_by_the_whole_tree(horizon: int) -> None:
    decisions = 0
    for seed in range(60):
        rng = np.random.default_rng([horizon, seed])
        world: World = BallWorld(2, 2) if seed % 2 else graph_world(rng, most_tasks=4, most_actions=3)
        model = decaying(rng, world)
        planner, tree = EntropyPlanner(world, model, horizon), PlainTree(world, model, horizon)
        belief, state = Belief.initial(world, model), world.start()
        for _ in range(6):  # as many cues on as can be
            after = [world.step(state, action) for action in world.actions(state)]
            state = after[int(np.argmax([world.cues(at)[belief.parameters.cue].sum() for at in after]))]
            belief = belief.update(state, bool(rng.random() < 0.1))
            if len(belief.task) <= 40:
                assert_decides_as(tree.values(belief, state), planner, belief, state)
                decisions += 1
    assert decisions > 300
