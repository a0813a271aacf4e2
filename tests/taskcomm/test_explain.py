"""Why an action: its plan is the best everywhere, and its entropies add up to the decision's value."""

import json
from collections.abc import Hashable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import full_tree
from tinyworld import menu
from trees import situations

from taskcomm.belief import Belief
from taskcomm.contingency import PlannedStep
from taskcomm.decision import TIE
from taskcomm.planner import EntropyPlanner
from taskcomm.teacher import TeacherModel
from taskcomm.wording import percent, plan_in_words
from taskcomm.world import Action, BallWorld

WORLD, MODEL = BallWorld(), TeacherModel.intuitive()
SECOND_QUESTION = ("light_on(1)", "noa", "noa!", "noa!", "pick_up(1)", "light_on(2)", "noa!", "noa")
Situation = tuple[Belief, Hashable]


def after(*script: str) -> Situation:
    """Where a script of actions leads, a step being pressed for where its action ends in `!`."""
    belief, state = Belief.initial(WORLD, MODEL), WORLD.start()
    for text in script:
        state = WORLD.step(state, Action.parse(text.rstrip("!")))
        belief = belief.update(state, text.endswith("!"))
    return belief, state


@settings(max_examples=40)
@given(situations(), st.integers(1, 4), st.sampled_from([1.0, 0.9]), st.one_of(st.none(), st.integers(1, 4)))
def test_the_entropies_of_the_plan_add_up_to_the_value_of_the_decision(
    situation: Situation, horizon: int, gamma: float, depth: int | None
) -> None:
    belief, state = situation
    decision = EntropyPlanner(belief.world, belief.model, horizon, gamma=gamma).plan(belief, state)
    why = decision.explain(depth)
    assert why.depth == len(why.expected_entropy) == min(depth or horizon, horizon)
    discounted = sum(gamma**t * expected for t, expected in enumerate(why.expected_entropy))
    assert discounted + why.remaining == pytest.approx(decision.value, abs=1e-9)
    assert why.root.value == pytest.approx(decision.value, abs=1e-9)
    assert (why.remaining == 0.0) == (why.depth == horizon or decision.value == 0.0)


@settings(max_examples=25)
@given(situations(max_balls=2, max_steps=5), st.integers(1, 3))
def test_at_every_point_the_plan_holds_the_best_action_of_the_whole_tree(
    situation: Situation, horizon: int
) -> None:
    belief, state = situation
    why = EntropyPlanner(belief.world, belief.model, horizon).plan(belief, state).explain()

    def check(step: PlannedStep, belief: Belief, state: Hashable, left: int) -> None:
        oracle = full_tree(belief, state, left)
        assert step.left == left
        assert step.value == pytest.approx(oracle[step.action], abs=1e-9)
        assert step.value <= min(oracle.values()) + TIE + 1e-12
        reached = belief.world.step(state, step.action)
        for branch in (step.silent, step.press):
            learned = belief.update(reached, branch.pressed)
            np.testing.assert_allclose(branch.marginal, learned.marginal(), atol=1e-12)
            assert (branch.then is None) == (left == 1)
            if branch.then is not None:
                check(branch.then, learned, reached, left - 1)

    check(why.root, belief, state, horizon)


@settings(max_examples=40)
@given(situations(), st.integers(1, 3))
def test_branches_share_out_all_probability_and_the_belief_is_kept_on_average(
    situation: Situation, horizon: int
) -> None:
    belief, state = situation
    why = EntropyPlanner(belief.world, belief.model, horizon).plan(belief, state).explain()
    ends = [branch for _, branch in why.root.branches() if branch.then is None]
    assert len(ends) == 2**horizon
    assert sum(branch.reach for branch in ends) == pytest.approx(1.0)
    for step, branch in why.root.branches():
        assert sum(branch.reasons.values()) == pytest.approx(1.0 if branch.pressed else 0.0)
        mixed = sum(one.probability * one.marginal for one in (step.silent, step.press))
        np.testing.assert_allclose(mixed, step.before, atol=1e-12)
        assert sum(group.share for group in step.groups) == pytest.approx(1.0)
        press = sum(group.share * group.press_probability for group in step.groups)
        assert press == pytest.approx(step.press.probability)
        grouped = [task for group in step.groups for task in group.tasks]
        assert sorted(grouped) == [task for task, p in zip(why.tasks, step.before, strict=True) if p > 0]


@given(situations())
def test_the_joint_of_task_and_reason_is_the_belief_after_a_press(situation: Situation) -> None:
    belief, state = situation
    joint = belief.press_joint(state)
    assert joint.sum() == pytest.approx(belief.press_probability(state), abs=1e-14)
    posterior = joint.sum(axis=1) / joint.sum()
    np.testing.assert_allclose(posterior, belief.update(state, True).marginal(), atol=1e-12)


def test_alternatives_are_all_other_actions_with_their_value_or_bound_and_gap() -> None:
    belief, state = after("light_on(1)", "noa!", "pick_up(1)")
    planner = EntropyPlanner(WORLD, MODEL, 3)
    oracle = full_tree(belief, state, 3)
    for exact_values in (True, False):
        decision = planner.plan(belief, state, exact_values)
        others = decision.explain(1).alternatives
        assert {other.action for other in others} == set(oracle) - {decision.action}
        assert [other.value for other in others] == sorted(other.value for other in others)
        for other in others:
            assert other.gap == max(0.0, other.value - decision.value)
            assert other.value <= oracle[other.action] + 1e-9
            assert not other.exact or other.value == pytest.approx(oracle[other.action], abs=1e-9)
        assert all(other.exact for other in others) or not exact_values


def test_explaining_changes_no_later_draw_among_ties() -> None:
    belief = Belief.initial(WORLD, MODEL)
    drawn: list[list[Action]] = []
    for explains in (False, True):
        planner = EntropyPlanner(WORLD, MODEL, 2, ties="random", seed=4)
        drawn.append([])
        for _ in range(12):
            decision = planner.plan(belief, WORLD.start())
            drawn[-1].append(decision.action)
            assert not explains or decision.explain().root.action == decision.action
    assert drawn[0] == drawn[1]
    assert len(set(drawn[0])) > 1


def test_a_press_while_one_ball_is_lit_speaks_for_that_ball() -> None:
    why = EntropyPlanner(WORLD, MODEL, 5).plan(*after()).explain()
    named, others = why.root.groups
    assert {task.mov for task in named.tasks} == {1}
    assert (named.press_probability, others.press_probability) == pytest.approx((0.03, 0.005))
    lines = str(why).splitlines()
    assert (
        lines[0] == "light_on(1) has the least expected entropy, summed over 5 steps (2.5 s): 15.661811 nats."
    )
    assert lines[3] == "  1. light_on(1): a press has 3.0% under mov=1, 0.5% under the others"
    assert (
        "if pressed (1.3%: that_mov 62%, mistake 37%): mov=1 0.33 -> 0.75, wrt=2|3 0.33 -> 0.44" in lines[4]
    )
    assert "  light_on(2), light_on(3): a tie (15.661811)" in lines


@pytest.mark.parametrize(("least", "most"), [(0.0, 99), (0.01, 99), (0.01, 3), (1.0, 99)])
def test_words_follow_the_likeliest_presses_and_count_the_rest(least: float, most: int) -> None:
    why = EntropyPlanner(WORLD, MODEL, 4).plan(*after(*SECOND_QUESTION)).explain()
    first = why.root.press
    others = [branch.reach for _, branch in why.root.branches() if branch.pressed and branch is not first]
    assert len(others) == 14
    presses = why.root.likely_presses(least, most)
    enough = sorted((reach for reach in others if reach >= least), reverse=True)[: most - 1]
    assert [branch.reach for branch in presses] == [first.reach, *enough]

    followed, left_out = 0, []
    points = [why.root]
    while points:
        for step in points.pop().chain():
            then, silent = step.press.then, step.silent.then
            if step.press not in presses:
                left_out.append(step.press.reach)
                continue
            followed += 1
            if then is not None and silent is not None and not then.is_same_plan(silent):
                points.append(then)
    lines = plan_in_words(why.root, why.tasks, presses)
    assert sum("if pressed" in line for line in lines) == followed
    told = f"  Not followed: {len(left_out)} less likely presses, together {percent(sum(left_out))}."
    assert (told in lines) == bool(left_out) == any("Not followed" in line for line in lines)
    assert (not left_out) == (least == 0.0)


def test_what_follows_a_press_is_said_once_where_it_is_what_follows_silence() -> None:
    why = EntropyPlanner(WORLD, MODEL, 2).plan(*after()).explain()
    press, silent = why.root.press, why.root.silent
    assert press.then is not None
    assert silent.then is not None
    assert press.then.is_same_plan(silent.then)
    assert "then as if not pressed" in str(why)
    other = replace(press.then, action=Action.parse("light_on(2)"))
    told = replace(why, root=replace(why.root, press=replace(press, then=other)))
    assert "then as if not pressed" not in str(told)
    assert "; then light_on(2)" in str(told)


def test_a_world_without_parts_of_tasks_is_explained_by_its_tasks() -> None:
    world, model = menu(3)
    belief, state = Belief.initial(world, model), world.step(world.start(), "point at soup")
    belief = belief.update(state, True)
    why = EntropyPlanner(world, model, 3).plan(belief, state).explain()
    assert "task=soup" in str(why)
    assert "under soup" in str(why)
    shifts = why.to_json()["plan"]["if_pressed"]["shifts"]
    assert {shift["part"] for shift in shifts} == {"task"}
    assert {shift["value"] for shift in shifts} == set(world.tasks)


def test_a_certain_belief_is_told_nothing() -> None:
    prior = np.zeros(24)
    prior[3] = 1.0
    belief = Belief.initial(WORLD, MODEL, prior)
    why = EntropyPlanner(WORLD, MODEL, 2).plan(belief, WORLD.start()).explain()
    assert "a press has 0.5% under any task, and tells nothing" in str(why)
    assert "the belief hardly moves" in str(why)
    assert why.expected_entropy == (0.0, 0.0)


def test_json_holds_the_whole_plan() -> None:
    why = EntropyPlanner(WORLD, MODEL, 3).plan(*after("light_on(1)", "noa!")).explain()
    document = json.loads(json.dumps(why.to_json(), allow_nan=False))
    assert document["tasks"] == [str(task) for task in WORLD.tasks]
    seen = []

    def check(step: PlannedStep, told: dict[str, object], number: int) -> None:
        seen.append(told["action"])
        assert (told["step"], told["action"], told["value"]) == (number, str(step.action), step.value)
        for branch, name in ((step.silent, "if_not"), (step.press, "if_pressed")):
            inside = told[name]
            assert isinstance(inside, dict)
            assert inside["marginal"] == branch.marginal.tolist()
            assert (inside["probability"], inside["entropy"]) == (branch.probability, branch.entropy)
            assert inside.get("reasons", {}) == branch.reasons
            changes = [shift["after"] - shift["before"] for shift in inside["shifts"]]
            assert changes == sorted(changes, reverse=True)
            assert len(changes) == 3 + 3 + 4
            if branch.then is not None:
                check(branch.then, inside["then"], number + 1)
            else:
                assert inside["then"] is None

    check(why.root, document["plan"], 1)
    assert len(seen) == 7
    assert sum(document["expected_entropy"]) == pytest.approx(document["plan"]["value"], abs=1e-9)


@pytest.mark.parametrize("depth", [0, -1, 1.5, True])
def test_a_bad_depth_is_named(depth: int) -> None:
    decision = EntropyPlanner(WORLD, MODEL, 1).plan(*after())
    with pytest.raises(ValueError, match=f"depth must be a whole number of steps from 1, not {depth}"):
        decision.explain(depth)


def test_a_decision_that_no_planner_made_says_so() -> None:
    decision = replace(EntropyPlanner(WORLD, MODEL, 1).plan(*after()), asked=None)
    with pytest.raises(ValueError, match=r"light_on\(1\) was made by no planner"):
        decision.explain()
