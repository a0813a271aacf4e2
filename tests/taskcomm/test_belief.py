"""The belief against enumeration of every mental-state path, and the laws of exact filtering."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import plainfilter
import pytest
from hypothesis import given
from hypothesis import strategies as st
from oracles import joint
from strategies import models, walks

from taskcomm.belief import Belief, ImpossibleObservation, entropy
from taskcomm.tasks import Task
from taskcomm.teacher import ModelError, TableTop, TeacherModel
from taskcomm.world import Action, BallWorld

SMALL = BallWorld(num_balls=2, num_distances=2)
PAPER = BallWorld()


def followed(belief: Belief, states: Sequence[Any], pressed: Sequence[bool]) -> tuple[Belief, float]:
    """The belief after these steps, and the probability that it gave to these presses."""
    probability = 1.0
    for state, press in zip(states, pressed, strict=True):
        p = belief.press_probability(state)
        probability *= p if press else 1 - p
        belief = belief.update(state, press)
    return belief, probability


@st.composite
def short_trials(draw: st.DrawFn, world: BallWorld, max_steps: int) -> tuple[list[Any], list[bool]]:
    """World states and presses of a trial, at most three of them, so that paths stay countable."""
    states = [state for _, state in draw(walks(world, max_steps))]
    steps = st.integers(0, len(states) - 1)
    at = draw(st.sets(steps, max_size=3))
    return states, [step in at for step in range(len(states))]


def priors(count: int) -> st.SearchStrategy[list[float]]:
    weights = st.lists(st.floats(0.01, 1.0) | st.just(0.0), min_size=count, max_size=count)
    return weights.filter(any).map(lambda drawn: [weight / math.fsum(drawn) for weight in drawn])


@given(models(), short_trials(SMALL, 9), priors(len(SMALL.tasks)))
def test_the_belief_is_that_of_enumeration(
    model: TeacherModel, trial: tuple[list[Any], list[bool]], prior: list[float]
) -> None:
    weights = np.array(joint(SMALL, model, *trial, prior))
    belief, probability = followed(Belief.initial(SMALL, model, prior), *trial)
    np.testing.assert_allclose(belief.marginal(), weights / weights.sum(), rtol=0, atol=1e-12)
    assert probability == pytest.approx(weights.sum(), rel=1e-11)


SHOWN = (
    *("light_on(1)", "noa", "noa", "pick_up(1)", "light_off(1)", "light_on(2)", "slide(1, 4, 2)"),
    *("slide(1, 3, 2)", "noa", "slide(1, 4, 2)"),
)


def shown(*actions: str, world: BallWorld = PAPER) -> list[Any]:
    state, states = world.start(), []
    for action in actions:
        state = world.step(state, Action.parse(action))
        states.append(state)
    return states


@pytest.mark.parametrize("delay", [0.0, 0.2, 0.5, 0.8, 1.3])
@pytest.mark.parametrize(("rise", "fall"), [(2.0, 2.0), (0.7, 1.9)])
def test_the_papers_world_is_that_of_enumeration(delay: float, rise: float, fall: float) -> None:
    model = TeacherModel(
        mistake=0.005,
        approvals={
            state: replace(top, rise=rise, fall=fall, delay=delay)
            for state, top in TeacherModel.intuitive().approvals.items()
        },
    )
    states = shown(*SHOWN)
    pressed = [step in (2, 5, 9) for step in range(len(states))]
    weights = np.array(joint(PAPER, model, states, pressed, [1 / 24] * 24))
    belief, _ = followed(Belief.initial(PAPER, model), states, pressed)
    np.testing.assert_allclose(belief.marginal(), weights / weights.sum(), rtol=0, atol=1e-12)


@given(models(), st.data())
def test_a_long_trial_is_that_of_the_plain_filter(model: TeacherModel, data: st.DataObject) -> None:
    walk = data.draw(walks(SMALL, 40))
    at = data.draw(st.sets(st.integers(0, len(walk) - 1), max_size=7))
    states, pressed = [state for _, state in walk], [step in at for step in range(len(walk))]
    belief, _ = followed(Belief.initial(SMALL, model), states, pressed)
    expected = plainfilter.marginal(SMALL, model, states, pressed)
    np.testing.assert_allclose(belief.marginal(), expected, rtol=0, atol=1e-12)


def test_a_press_under_a_light_asks_for_that_ball() -> None:
    """By hand: after one step of light the level is 1/4, P(press) is 0.005 + 0.1/4 or 0.005."""
    belief = Belief.initial(PAPER, TeacherModel.intuitive())
    (state,) = shown("light_on(2)")
    assert belief.press_probability(state) == pytest.approx((0.03 + 2 * 0.005) / 3, rel=1e-12)
    assert belief.update(state, pressed=True).marginal_of("mov") == pytest.approx(
        {1: 0.125, 2: 0.75, 3: 0.125}, rel=1e-12
    )
    total = 0.97 + 2 * 0.995
    assert belief.update(state, pressed=False).marginal_of("mov") == pytest.approx(
        {1: 0.995 / total, 2: 0.97 / total, 3: 0.995 / total}, rel=1e-12
    )


@given(models(), st.data())
def test_a_step_lowers_entropy_on_average(model: TeacherModel, data: st.DataObject) -> None:
    belief = Belief.initial(PAPER, model)
    for _, state in data.draw(walks(PAPER, 10)):
        p = belief.press_probability(state)
        yes, no = belief.update(state, pressed=True), belief.update(state, pressed=False)
        assert p * yes.entropy() + (1 - p) * no.entropy() <= belief.entropy() + 1e-12
        mixed = p * yes.marginal() + (1 - p) * no.marginal()
        np.testing.assert_allclose(mixed, belief.marginal(), rtol=0, atol=1e-12)
        belief = yes if data.draw(st.booleans()) else no
        assert belief.marginal().sum() == pytest.approx(1, abs=1e-12)
        assert belief.weight.min() > 0


@given(models(), short_trials(PAPER, 12), priors(len(PAPER.tasks)))
def test_a_prior_weighs_the_likelihood_of_each_task(
    model: TeacherModel, trial: tuple[list[Any], list[bool]], prior: list[float]
) -> None:
    uniform, _ = followed(Belief.initial(PAPER, model), *trial)
    belief, _ = followed(Belief.initial(PAPER, model, prior), *trial)
    expected = uniform.marginal() * prior
    np.testing.assert_allclose(belief.marginal(), expected / expected.sum(), rtol=0, atol=1e-12)


@given(models(), short_trials(PAPER, 12), st.permutations([1, 2, 3]))
def test_renaming_the_balls_renames_the_belief(
    model: TeacherModel, trial: tuple[list[Any], list[bool]], order: list[int]
) -> None:
    new: dict[Any, Any] = {None: None} | dict(zip((1, 2, 3), order, strict=True))

    def renamed(state: Any) -> Any:
        placements: list[Any] = [None, None, None]
        for ball, placement in enumerate(state.placements, start=1):
            placements[new[ball] - 1] = placement and (new[placement[0]], placement[1])
        slid = state.slid and (new[state.slid[0]], state.slid[1])
        return type(state)(frozenset(new[b] for b in state.lit), new[state.held], tuple(placements), slid)

    states, pressed = trial
    belief, _ = followed(Belief.initial(PAPER, model), states, pressed)
    other, _ = followed(Belief.initial(PAPER, model), [renamed(state) for state in states], pressed)
    tasks = [PAPER.tasks.index(Task(new[i], new[j], k)) for i, j, k in PAPER.tasks]
    np.testing.assert_allclose(other.marginal()[tasks], belief.marginal(), rtol=0, atol=1e-12)


@given(models(), short_trials(PAPER, 12))
def test_the_order_of_mental_states_does_not_matter(
    model: TeacherModel, trial: tuple[list[Any], list[bool]]
) -> None:
    backwards = replace(model, approvals=dict(reversed(list(model.approvals.items()))))
    belief, probability = followed(Belief.initial(PAPER, model), *trial)
    other, same = followed(Belief.initial(PAPER, backwards), *trial)
    np.testing.assert_allclose(other.marginal(), belief.marginal(), rtol=0, atol=1e-12)
    assert same == pytest.approx(probability, rel=1e-11)


def test_an_update_leaves_the_old_belief_as_it_was() -> None:
    model = replace(TeacherModel.intuitive(), rest=0.5)
    belief = Belief.initial(PAPER, model)
    for state, press in zip(shown(*SHOWN), [False, True] * 5, strict=True):
        fields = {
            name: np.copy(getattr(belief, name)) for name in ("task", "weight", "level", "on_time", "seen")
        }
        since = belief.since_press
        after = belief.update(state, press)
        assert after is not belief
        for name, before in fields.items():
            np.testing.assert_array_equal(getattr(belief, name), before)
        assert belief.since_press == since
        belief = after


@given(models(), short_trials(PAPER, 15))
def test_no_two_rows_share_task_and_memory(model: TeacherModel, trial: tuple[list[Any], list[bool]]) -> None:
    belief, _ = followed(Belief.initial(PAPER, model), *trial)
    decaying = np.isfinite(belief.parameters.decay)
    rows = np.column_stack([belief.task, belief.level, belief.on_time[:, decaying]])
    assert len(np.unique(rows, axis=0)) == len(rows)


def test_histories_that_time_has_made_equal_are_one() -> None:
    """Once every cue has been off for a fall, it no longer matters why anything was pressed."""
    model = TeacherModel.intuitive()
    lit = shown("light_on(1)", "noa", "noa", "light_off(1)")
    belief, _ = followed(Belief.initial(PAPER, model), lit, [False, True, True, False])
    assert len(belief.task) > 24
    for _ in range(4):
        belief = belief.update(lit[-1], pressed=False)
    assert belief.task.tolist() == list(range(24))
    assert not belief.level.any()


@pytest.mark.parametrize("rises_and_falls", [(2.0, 2.0), (math.pi, math.e)])
def test_ten_thousand_steps_with_many_presses_stay_finite_and_small(
    rises_and_falls: tuple[float, float],
) -> None:
    rise, fall = rises_and_falls
    rng = np.random.default_rng(5)
    approvals = {
        state: TableTop(top.cue, peak=0.2, rise=rise, fall=fall, delay=0.7)
        for state, top in TeacherModel.intuitive().approvals.items()
    }
    belief = Belief.initial(PAPER, TeacherModel(0.01, approvals))
    state, most, presses = PAPER.start(), 0, 0
    for _ in range(10_000):
        actions = PAPER.actions(state)
        state = PAPER.step(state, actions[rng.integers(len(actions))])
        press = bool(rng.random() < belief.press_probability(state))
        belief = belief.update(state, press)
        most, presses = max(most, len(belief.task)), presses + press
    assert presses > 500
    assert most < 500
    assert np.isfinite(belief.weight).all()
    assert belief.marginal().sum() == pytest.approx(1, abs=1e-12)


def test_an_impossible_observation_prints_belief_world_and_observation() -> None:
    belief = Belief.initial(PAPER, TeacherModel.intuitive())
    unerring = replace(belief, parameters=replace(belief.parameters, mistake=0.0))
    with pytest.raises(ImpossibleObservation) as error:
        unerring.update(PAPER.start(), pressed=True)
    message = str(error.value)
    for part in ("pressed=True", str(PAPER.start()), str(belief.model), str(belief.marginal())):
        assert part in message


@pytest.mark.parametrize(
    "prior",
    [
        [0.5, 0.5],
        [1 / 24] * 23 + [1.0],
        [-0.5, 1.5] + [0.0] * 22,
        [math.nan] * 24,
        [0.0] * 24,
        [[1 / 24] * 24],
    ],
)
def test_a_prior_that_is_no_distribution_over_the_tasks_is_an_error(prior: Any) -> None:
    with pytest.raises(ValueError, match="prior: must be 24 probabilities that sum to 1"):
        Belief.initial(PAPER, TeacherModel.intuitive(), prior)


def test_a_model_with_a_cue_that_the_world_lacks_is_an_error() -> None:
    model = TeacherModel(0.005, {"that_colour": TableTop("mov_is_red", 0.1, 2.0, 2.0)})
    with pytest.raises(ModelError, match=r"approvals\.that_colour\.cue: unknown cue 'mov_is_red'"):
        Belief.initial(PAPER, model)


@pytest.mark.parametrize("pressed", [1.0, "spacebar"])
def test_an_observation_that_is_neither_a_press_nor_none_is_an_error(pressed: Any) -> None:
    belief = Belief.initial(BallWorld(), TeacherModel.intuitive())
    with pytest.raises(TypeError, match=f"^pressed: must be True, False or None, not {pressed!r}$"):
        belief.update(BallWorld().start(), pressed)


def test_entropy_is_in_nats_and_0_ln_0_is_0() -> None:
    assert entropy([0.25] * 4) == pytest.approx(math.log(4), rel=1e-15)
    assert entropy([1.0, 0.0]) == 0.0
    assert Belief.initial(PAPER, TeacherModel.intuitive()).entropy() == pytest.approx(math.log(24), rel=1e-14)
