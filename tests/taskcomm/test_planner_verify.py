"""The decisions of the study: as the whole tree makes them, and within the step."""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plaintree import PlainTree
from trees import assert_decides_as

from learn import fit
from taskcomm.belief import Belief
from taskcomm.logs import read_trials
from taskcomm.planner import EntropyPlanner
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial

pytestmark = pytest.mark.verify
STUDY = Path(__file__).parents[2] / "datasets" / "simulated-study"
STEP = 0.5


@pytest.fixture(scope="module")
def trials() -> list[Trial]:
    found = read_trials(STUDY / "trials.jsonl")
    assert len(found) == 44
    return found


@pytest.fixture(scope="module", params=["intuitive", "learned"])
def model(request: pytest.FixtureRequest, trials: list[Trial]) -> TeacherModel:
    if request.param == "intuitive":
        return TeacherModel.intuitive()
    return fit(trials, world=trials[0].world, initial=TeacherModel.intuitive()).model


def situations(model: TeacherModel, trial: Trial) -> Iterator[tuple[Belief, Any]]:
    """What is decided on before each step of a logged trial, under the model."""
    belief, state = Belief.initial(trial.world, model), trial.world.start()
    for reached, step in zip(trial.states, trial.steps, strict=True):
        yield belief, state
        belief, state = belief.update(reached, step.pressed), reached


def test_decisions_of_the_study_are_those_of_the_whole_tree(trials: list[Trial], model: TeacherModel) -> None:
    """Every decision three steps deep that is the fifth of its trial, the tenth and so on; some four deep."""
    tops = {horizon: EntropyPlanner(trials[0].world, model, horizon) for horizon in (3, 4)}
    trees = {horizon: PlainTree(trials[0].world, model, horizon) for horizon in tops}
    compared = dict.fromkeys(tops, 0)
    for trial in trials:
        for number, (belief, state) in enumerate(situations(model, trial)):
            for horizon, every in ((3, 5), (4, 60)):
                if number % every == every - 1:
                    oracle = trees[horizon].values(belief, state)
                    assert assert_decides_as(oracle, tops[horizon], belief, state)
                    compared[horizon] += 1
    assert compared[3] >= 500
    assert compared[4] >= 40


def test_every_decision_of_the_study_is_made_within_the_step(
    trials: list[Trial], model: TeacherModel
) -> None:
    planner = EntropyPlanner(trials[0].world, model, horizon=5)
    planner.warm_up()
    spent = []
    for trial in trials:
        for belief, state in situations(model, trial):
            started = time.perf_counter()
            planner.plan(belief, state)
            spent.append(time.perf_counter() - started)
    shares = np.array(spent) / STEP
    print(
        f"{len(shares)} decisions, share of the step used:"
        f" median {np.median(shares):.3f}, p99 {np.quantile(shares, 0.99):.3f}, max {shares.max():.3f}"
    )
    assert shares.max() < 1
