"""The smoother against enumeration, against the filter, and what its lattice may not do."""

from dataclasses import replace

import numpy as np
import oracles
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import models, walks
from taught import WORLD, by_hand, operator_trials, teacher

from taskcomm.belief import Belief
from taskcomm.lattice import Extent, LatticeTooLarge, build_unit, join
from taskcomm.smoother import Chain, cue_tables, smooth
from taskcomm.tasks import Task
from taskcomm.teacher import ModelError, TeacherModel
from taskcomm.trials import Step, Trial
from taskcomm.world import BallWorld

SMALL = BallWorld(num_balls=2, num_distances=2)


@st.composite
def short_trials(draw: st.DrawFn) -> Trial:
    """Up to 10 steps and 4 presses, the task known or not."""
    walk = draw(walks(SMALL, 10))
    steps = st.integers(0, len(walk) - 1)
    presses = draw(st.sets(steps, max_size=4))
    task = draw(st.one_of(st.none(), st.sampled_from(SMALL.tasks)))
    return Trial(
        "short", SMALL, task, tuple(Step(action, t in presses) for t, (action, _) in enumerate(walk))
    )


@given(short_trials(), models())
def test_reasons_tasks_and_likelihood_equal_enumeration(trial: Trial, model: TeacherModel) -> None:
    smoothed = smooth(trial, model)
    tasks = range(len(SMALL.tasks)) if trial.task is None else [list(SMALL.tasks).index(trial.task)]
    joint = np.zeros(len(SMALL.tasks))
    reasons = np.zeros_like(smoothed.reasons)
    for task in tasks:
        cues = oracles.cue_columns(SMALL, model, trial.states, task)
        for path, weight in oracles.paths(model, cues, list(trial.presses)).items():
            joint[task] += weight / len(tasks)
            for row, step in enumerate(smoothed.steps):
                reasons[row, model.mental_states.index(path[step])] += weight / len(tasks)
    np.testing.assert_allclose(smoothed.reasons, reasons / joint.sum(), rtol=0, atol=1e-12)
    np.testing.assert_allclose(smoothed.task, joint / joint.sum(), rtol=0, atol=1e-12)
    assert smoothed.log_likelihood == pytest.approx(np.log(joint.sum()), rel=1e-12, abs=1e-12)


@given(models(), st.sampled_from([None, *SMALL.tasks]))
def test_a_trial_without_steps_says_nothing(model: TeacherModel, task: Task | None) -> None:
    smoothed = smooth(Trial("begun", SMALL, task, ()), model)
    assert smoothed.reasons.shape == (0, 2 + len(model.approvals))
    assert smoothed.log_likelihood == pytest.approx(0.0, abs=1e-12)
    prior = [1 / len(SMALL.tasks) if task is None else float(task == other) for other in SMALL.tasks]
    np.testing.assert_allclose(smoothed.task, prior, rtol=0, atol=1e-12)


@given(short_trials(), models(), st.integers(0, 2**32 - 1))
def test_a_lattice_for_wide_bounds_gives_the_same_as_one_for_the_model_alone(
    trial: Trial, model: TeacherModel, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    parameters = model.parameters(SMALL.cue_names)
    own = Extent.of(parameters)
    wide = replace(
        own,
        rise=own.rise + rng.uniform(0, 3, len(own.rise)),
        fall=own.fall + rng.uniform(0, 3, len(own.fall)),
        least_late=np.maximum(own.least_late - rng.integers(0, 3, len(own.rise)), 0),
        most_late=own.most_late + rng.integers(0, 3, len(own.rise)),
    )
    cues = cue_tables(trial, SMALL, parameters.cue)[:, :, 0]
    narrow, broad = (
        Chain(join([build_unit(cues, trial.presses, extent, model.dt)])) for extent in (own, wide)
    )
    assert len(narrow.lattice.memory_next) <= len(broad.lattice.memory_next)
    np.testing.assert_allclose(narrow.run(parameters), broad.run(parameters), rtol=1e-12, atol=1e-12)
    for chain in (narrow, broad):
        chain.smooth(np.ones(1))
    np.testing.assert_allclose(narrow.reasons(0), broad.reasons(0), rtol=0, atol=1e-12)


def test_the_likelihood_of_long_trials_is_what_the_filter_predicts_step_by_step() -> None:
    model = teacher(delays=(0.3, 0.5, 0.0))
    for trial in operator_trials(4, model):
        predicted = 0.0
        belief = Belief.initial(WORLD, model)
        for state, pressed in zip(trial.states, trial.presses, strict=True):
            p = belief.press_probability(state)
            predicted += np.log(p if pressed else 1 - p)
            belief = belief.update(state, bool(pressed))
        smoothed = smooth(replace(trial, task=None), model)
        assert smoothed.log_likelihood == pytest.approx(predicted, rel=1e-10)
        np.testing.assert_allclose(smoothed.task, belief.marginal(), rtol=0, atol=1e-10)


def test_reasons_sum_to_one_and_nothing_is_pressed_while_waiting() -> None:
    trial = operator_trials(1, teacher())[0]
    smoothed = smooth(trial, teacher())
    assert smoothed.reasons.shape == (trial.presses.sum(), 5)
    np.testing.assert_allclose(smoothed.reasons.sum(axis=1), 1, atol=1e-12)
    assert (smoothed.reasons[:, 0] == 0).all()


def test_a_press_with_every_cue_off_is_a_mistake_for_sure() -> None:
    trial = by_hand(["noa", "noa", "light_on(2)", "noa"], presses=[1])
    assert smooth(trial, TeacherModel.intuitive()).of_press(0)["mistake"] == 1.0


def test_a_trial_without_a_press_has_no_reasons_and_still_a_likelihood() -> None:
    smoothed = smooth(by_hand(["noa"] * 3, presses=[]), TeacherModel.intuitive())
    assert smoothed.reasons.shape == (0, 5)
    assert smoothed.log_likelihood == pytest.approx(3 * np.log(0.995), rel=1e-14)


def test_a_prior_on_tasks_shifts_the_reasons_of_presses() -> None:
    trial = replace(by_hand(["light_on(1)", "noa", "noa", "light_off(1)"], presses=[2]), task=None)
    model = TeacherModel.intuitive()
    on_ball_1 = np.array([task.mov == 1 for task in WORLD.tasks]) / 8
    assert smooth(trial, model, prior=on_ball_1).of_press(0)["that_mov"] > 0.9
    assert smooth(trial, model, prior=(1 / 24 - on_ball_1 / 3) * 1.5).of_press(0)["that_mov"] == 0.0


def test_ten_thousand_steps_with_500_presses_are_smoothed_or_refused_by_a_stated_bound() -> None:
    rng = np.random.default_rng(0)
    presses = set(rng.choice(10_000, 500, replace=False).tolist())
    quiet = by_hand(["light_on(1)"] + ["noa"] * 9_999, sorted(presses))
    assert np.isfinite(smooth(quiet, TeacherModel.intuitive()).log_likelihood)
    held = ["pick_up(1)", "slide(1, 4, 2)"]
    cycle = ["light_on(1)", "light_on(2)", "light_off(1)", "light_off(2)"]
    restless = by_hand(held + cycle * 2_499 + ["noa"] * 2, sorted(presses), task=3)
    slow = teacher(rises=(9.0, 9.0, 9.0), falls=(9.0, 9.0, 9.0))
    with pytest.raises(LatticeTooLarge, match="more than 200000 memories by event"):
        smooth(restless, slow)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"dt": 0.25}, "dt = 0.25 s, but the model's is 0.5 s"),
        ({"task": "elsewhere"}, "elsewhere is not a task of its world"),
    ],
)
def test_a_trial_that_does_not_fit_is_one_error(change: dict[str, object], message: str) -> None:
    trial = replace(by_hand(["noa"], presses=[]), **change)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=message):
        smooth(trial, TeacherModel.intuitive())


def test_a_cue_that_the_world_lacks_is_an_error() -> None:
    model = TeacherModel.intuitive()
    tops = {"that_mov": replace(model.approvals["that_mov"], cue="whistled")}
    with pytest.raises(ModelError, match="unknown cue 'whistled'"):
        smooth(by_hand(["noa"], presses=[]), replace(model, approvals=tops))
