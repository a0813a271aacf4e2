"""pomegranate as an independent engine: the transition into M, and a dense HMM of the same chain."""

from dataclasses import dataclass, replace
from importlib import import_module
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from taught import WORLD, operator_trials, teacher

from learn import log_likelihood, responsibilities
from learn.conditional import table_top_transition, transitions
from learn.coordinates import Bounds, Coordinates, vector_of
from learn.estep import Evidence
from learn.exposure import expose
from learn.mstep import Objective, maximise
from taskcomm.teacher import TableTop, TeacherModel
from taskcomm.trials import Step, Trial

OFF_LATTICE = teacher((0.2, 0.15, 0.1), (1.13, 1.71, 0.93), (1.37, 1.19, 1.83), (0.21, 0.43, 0.0), 0.02)


def _trials() -> tuple[Trial, ...]:
    """The first 40 steps of four trials."""
    return tuple(replace(trial, steps=trial.steps[:40]) for trial in operator_trials(4, teacher()))


def _evidence(trials: tuple[Trial, ...], model: TeacherModel) -> tuple[Evidence, Coordinates]:
    space = Coordinates(model, Bounds(), np.arange(19) < 10)
    extent = space.extent(model.parameters(WORLD.cue_names))
    return Evidence(expose(trials, WORLD, model, extent)), space


@pytest.mark.parametrize("decay", [None, 1.7])
def test_weighted_transitions_have_the_expected_log_likelihood_of_the_e_step(decay: float | None) -> None:
    tops = {state: replace(top, decay=decay, hold=0.3) for state, top in OFF_LATTICE.approvals.items()}
    model = replace(OFF_LATTICE, approvals=tops)
    X, weight = transitions(_trials(), WORLD, model)
    evidence, _ = _evidence(_trials(), model)
    parameters = model.parameters(WORLD.cue_names)
    expected, _ = evidence.expected_log_likelihood(parameters, evidence.expect(parameters))
    log_probability = table_top_transition(model).log_probability(X).numpy()
    assert weight @ log_probability == pytest.approx(expected, rel=1e-10)
    assert weight.sum() == pytest.approx(sum(trial.num_steps for trial in _trials()))


def test_the_probabilities_of_the_five_mental_states_sum_to_one() -> None:
    X, _ = transitions(_trials()[:1], WORLD, OFF_LATTICE)
    distribution = table_top_transition(OFF_LATTICE)
    rows = np.repeat(np.unique(X[:, :-1], axis=0), 5, axis=0)
    outcomes = np.tile(np.arange(5), len(rows) // 5)[:, None]
    each = distribution.probability(np.hstack([rows, outcomes])).numpy()
    np.testing.assert_allclose(each.reshape(-1, 5).sum(axis=1), 1, rtol=1e-12)


def test_from_summaries_is_the_m_step() -> None:
    trials = _trials()
    X, weight = transitions(trials, WORLD, OFF_LATTICE)
    distribution = table_top_transition(OFF_LATTICE, steps=3)
    half = len(X) // 2
    distribution.summarize(X[:half], sample_weight=weight[:half])
    distribution.summarize(X[half:], sample_weight=weight[half:])
    distribution.from_summaries()
    evidence, space = _evidence(trials, OFF_LATTICE)
    objective = Objective(evidence, OFF_LATTICE.parameters(WORLD.cue_names), space, None)
    point = space.point(vector_of(OFF_LATTICE))
    point, _ = maximise(objective, point, objective.expect(point), None, steps=3)
    np.testing.assert_allclose(vector_of(distribution.model), space.vector(point), rtol=1e-7)
    assert np.abs(vector_of(distribution.model)[:10] / vector_of(OFF_LATTICE)[:10] - 1).max() > 0.1


def test_em_with_the_distribution_alone_never_lets_the_likelihood_fall() -> None:
    trials, distribution = _trials(), table_top_transition(OFF_LATTICE, steps=4)
    values = [log_likelihood(trials, WORLD, distribution.model)]
    for _ in range(4):
        distribution.summarize(*transitions(trials, WORLD, distribution.model))
        distribution.from_summaries()
        values.append(log_likelihood(trials, WORLD, distribution.model))
    assert np.diff(values).min() >= -1e-9
    assert values[-1] - values[0] > 1


def test_a_frozen_distribution_and_one_without_data_stay_as_they_are() -> None:
    X, weight = transitions(_trials()[:1], WORLD, OFF_LATTICE)
    frozen = table_top_transition(OFF_LATTICE).freeze()
    frozen.summarize(X, weight)
    frozen.from_summaries()
    empty = table_top_transition(OFF_LATTICE)
    empty.from_summaries()
    assert frozen.model == empty.model == OFF_LATTICE


def test_a_press_free_interval_is_refused() -> None:
    with pytest.raises(ValueError, match="rest: a press-free interval depends on more"):
        table_top_transition(replace(OFF_LATTICE, rest=1.0))


@dataclass(frozen=True)
class Lamp:
    """One task, one cue, always on."""

    tasks: tuple[str, ...] = ("watch",)
    cue_names: tuple[str, ...] = ("lit",)

    def start(self) -> str:
        return "on"

    def actions(self, state: str) -> tuple[str, ...]:
        return ("shine",)

    def step(self, state: str, action: str) -> str:
        return state

    def cues(self, state: str) -> NDArray[np.bool_]:
        return np.ones((1, 1), dtype=np.bool_)


def _dense_hmm(mistake: float, peak: float, full: int) -> Any:
    """The chain with the level, in quarters, and M in its hidden states: (level, M), M of three."""
    config: Any = import_module("numba").config
    compiling, config.DISABLE_JIT = config.DISABLE_JIT, True
    try:
        from pomegranate.distributions import Categorical
        from pomegranate.hmm import DenseHMM
    finally:
        config.DISABLE_JIT = compiling
    chances = [
        (1 - mistake - peak * level / full, mistake, peak * level / full) for level in range(1, full + 1)
    ]
    emissions = [
        Categorical([[1.0, 0.0] if reason == 0 else [0.0, 1.0]]) for _ in chances for reason in range(3)
    ]
    edges = np.zeros((3 * full, 3 * full))
    for level in range(1, full + 1):
        for reason in range(3):
            after = 1 if reason == 2 else min(level + 1, full)
            edges[3 * (level - 1) + reason, 3 * (after - 1) : 3 * after] = chances[after - 1]
    starts = np.zeros(3 * full)
    starts[:3] = chances[0]
    model = DenseHMM(emissions, edges=edges, starts=starts, ends=np.ones(3 * full))
    return model.double()


def test_a_dense_hmm_in_float64_gives_the_same_likelihood_and_reasons() -> None:
    world, mistake, peak = Lamp(), 0.02, 0.25
    model = TeacherModel(mistake, {"that_lit": TableTop("lit", peak, rise=2.0, fall=2.0)})
    presses = np.random.default_rng(0).random(60) < 0.15
    trial = Trial("lamp", world, "watch", tuple(Step("shine", bool(pressed)) for pressed in presses))
    torch: Any = import_module("torch")
    X = torch.tensor(presses.astype(np.int64)[None, :, None])
    hmm = _dense_hmm(mistake, peak, full=4)
    expected = float(hmm.log_probability(X)[0])
    assert log_likelihood([trial], world, model) == pytest.approx(expected, rel=1e-9)
    posterior = hmm.predict_proba(X)[0].numpy().reshape(60, 4, 3).sum(axis=1)
    np.testing.assert_allclose(responsibilities(trial, world, model), posterior[presses], rtol=0, atol=1e-9)
