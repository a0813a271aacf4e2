"""The input-blind HMM: its likelihood is the exact one, and it knows nothing but the presses."""

import itertools
from importlib import import_module

import numpy as np
import pytest

from learn.blind import BlindModel, _pomegranate, fit_blind
from taskcomm.trials import Step, Trial
from taskcomm.world import NOA, Action, BallWorld

WORLD = BallWorld(2, 2)


def pressing(name: str, presses: list[bool]) -> Trial:
    return Trial(name, WORLD, WORLD.tasks[0], tuple(Step(NOA, bool(pressed)) for pressed in presses))


def bursts(seed: int, trials: int = 12) -> list[Trial]:
    """Trials of different lengths whose press rate switches between two values."""
    rng, made = np.random.default_rng(seed), []
    for number in range(trials):
        busy, presses = False, []
        for _ in range(int(rng.integers(40, 90))):
            busy = busy != (rng.random() < 0.06)
            presses.append(bool(rng.random() < (0.5 if busy else 0.02)))
        made.append(pressing(str(number), presses))
    return made


def test_score_is_the_sum_over_all_paths_of_hidden_states() -> None:
    model = BlindModel(
        start=np.array([0.7, 0.3]),
        transition=np.array([[0.9, 0.1], [0.25, 0.75]]),
        press=np.array([0.05, 0.4]),
        log_likelihood=0.0,
        iterations=0,
        converged=True,
    )
    presses = [False, True, True, False, False, True]
    total = 0.0
    for path in itertools.product((0, 1), repeat=len(presses)):
        weight = model.start[path[0]]
        for t, (state, pressed) in enumerate(zip(path, presses, strict=True)):
            weight *= model.press[state] if pressed else 1 - model.press[state]
            weight *= model.transition[state, path[t + 1]] if t + 1 < len(path) else 1.0
        total += weight
    assert model.score([pressing("a", presses)])[0] == pytest.approx(np.log(total), abs=1e-12)


def test_pomegranate_reports_the_likelihood_that_the_score_computes() -> None:
    trials = bursts(1)
    for states in (1, 2, 3):
        model = fit_blind(trials, states)
        assert model.log_likelihood == pytest.approx(model.score(trials).sum(), abs=1e-8)
        np.testing.assert_allclose(model.transition.sum(axis=1), 1.0, atol=1e-12)
        assert model.start.sum() == pytest.approx(1.0)


def test_fit_of_one_state_is_the_press_rate_with_one_pseudo_step() -> None:
    trials = bursts(2)
    presses, steps = sum(int(t.presses.sum()) for t in trials), sum(t.num_steps for t in trials)
    model = fit_blind(trials, 1)
    assert model.converged
    assert model.press[0] == pytest.approx((presses + (presses + 0.5) / (steps + 1)) / (steps + 1), rel=1e-9)


def test_two_rates_are_found_where_there_are_two_and_foresee_new_trials_better() -> None:
    train, test = bursts(3, 30), bursts(4, 20)
    two, one = fit_blind(train, 2), fit_blind(train, 1)
    assert two.press[0] < 0.08
    assert 0.35 < two.press[1] < 0.65
    assert two.score(test).sum() > one.score(test).sum() + 20


def test_what_the_robot_did_changes_nothing() -> None:
    trials = bursts(5, 4)
    lit = [
        Trial(t.trial_id, WORLD, None, (Step(Action("light_on", 1), t.steps[0].pressed), *t.steps[1:]))
        for t in trials
    ]
    one, two = fit_blind(trials), fit_blind(lit)
    np.testing.assert_array_equal(one.press, two.press)


def test_trials_without_a_press_leave_every_press_possible() -> None:
    quiet = [pressing(str(n), [False] * 20) for n in range(3)]
    model = fit_blind(quiet)
    assert (model.press > 0).all()
    assert np.isfinite(model.score([pressing("new", [True])])).all()


def test_nothing_to_fit_is_refused() -> None:
    with pytest.raises(ValueError, match="an HMM of 2 states from 0 trials"):
        fit_blind([])
    with pytest.raises(ValueError, match="no steps"):
        fit_blind([pressing("empty", [])])


def test_loading_pomegranate_leaves_the_compiler_on() -> None:
    config = import_module("numba").config
    _pomegranate()
    assert not config.DISABLE_JIT
