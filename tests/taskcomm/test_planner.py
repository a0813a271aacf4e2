"""The planner equals the whole tree: every value, and the action chosen."""

from typing import cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plaintree import PlainTree
from trees import assert_equals_the_whole_tree, situations

from taskcomm.belief import Belief
from taskcomm.planner import EntropyPlanner
from taskcomm.searching import Search, row_bytes
from taskcomm.teacher import ModelError, TableTop, TeacherModel
from taskcomm.world import Action, BallWorld

# MODEL.md, section 6: horizon -> Q of noa, light_on(any), pick_up(any)
REFERENCE = {
    1: (3.178053830, 3.173143, 3.178053830),
    2: (6.351197, 6.333974, 6.351075),
    3: (9.512027, 9.473553, 9.510808),
    4: (12.651607, 12.583004, 12.647779),
    5: (15.761058, 15.661811, 15.753024),
}


@pytest.mark.parametrize("horizon", REFERENCE)
def test_first_decision_has_the_reference_values(horizon: int) -> None:
    world, model = BallWorld(), TeacherModel.intuitive()
    planner = EntropyPlanner(world, model, horizon)
    decision = planner.plan(Belief.initial(world, model), world.start(), exact_values=True)
    noa, light, pick = REFERENCE[horizon]
    for action, value in decision.values.items():
        assert value == pytest.approx({"noa": noa, "light_on": light}.get(action.name, pick), abs=1e-6)
    assert decision.action == Action("light_on", 1)
    assert decision.ties == tuple(Action("light_on", ball) for ball in (1, 2, 3))
    quick = planner.plan(Belief.initial(world, model), world.start())
    assert (quick.action, quick.ties) == (decision.action, decision.ties)
    assert quick.gap <= decision.gap + 1e-12
    assert quick.nodes <= decision.nodes


@given(situations(), st.integers(1, 2), st.sampled_from([1.0, 0.9, 0.3]))
def test_equals_the_whole_tree_on_any_world_and_model(
    situation: tuple[Belief, object], horizon: int, gamma: float
) -> None:
    assert_equals_the_whole_tree(*situation, horizon, gamma)


@given(situations(max_balls=2, max_steps=5))
def test_equals_the_whole_tree_three_steps_deep(situation: tuple[Belief, object]) -> None:
    assert_equals_the_whole_tree(*situation, 3, 1.0)


@pytest.mark.verify
@pytest.mark.parametrize("presses", [0, 1, 3])
@pytest.mark.parametrize("horizon", [4, 5])
def test_equals_the_whole_tree_at_the_papers_horizon(horizon: int, presses: int) -> None:
    world, model = BallWorld(2, 2), TeacherModel.intuitive()
    belief, state = Belief.initial(world, model), world.start()
    for step in range(2 * presses):
        state = world.step(state, world.actions(state)[1 + step % 2])
        belief = belief.update(state, step % 2 == 1)
    assert_equals_the_whole_tree(belief, state, horizon, 1.0)


@pytest.mark.parametrize("num_balls", [5, 6])
def test_equals_the_plain_tree_with_more_tasks_than_a_word_has_bits(num_balls: int) -> None:
    world, model = BallWorld(num_balls), TeacherModel.intuitive()
    belief, state = Belief.initial(world, model), world.start()
    tree = PlainTree(world, model, 3)
    for step in range(6):
        actions = world.actions(state)
        state = world.step(state, actions[(5 * step + 2) % len(actions)])
        belief = belief.update(state, step == 3)
        decision = EntropyPlanner(world, model, 3).plan(belief, state, exact_values=True)
        assert decision.values == pytest.approx(tree.values(belief, state), abs=1e-9)


def peaked(presses: int) -> tuple[Belief, object]:
    world, model = BallWorld(2, 2), TeacherModel.intuitive()
    belief, state = Belief.initial(world, model), world.start()
    script = ("light_on(1)", "noa", "pick_up(1)", "light_on(2)", "slide(1, 2, 2)", "slide(1, 1, 2)")
    for text in (*script, *["noa"] * (2 * presses)):
        state = world.step(state, Action.parse(text))
        belief = belief.update(state, text == "noa")
    return belief, state


@pytest.mark.parametrize("presses", [2, 4, 8])
def test_equals_the_whole_tree_for_peaked_beliefs(presses: int) -> None:
    belief, state = peaked(presses)
    assert belief.marginal().max() > 0.85
    assert_equals_the_whole_tree(belief, state, 3, 1.0)


def test_a_certain_belief_has_nothing_to_gain() -> None:
    world, model = BallWorld(), TeacherModel.intuitive()
    prior = np.zeros(24)
    prior[3] = 1.0
    decision = EntropyPlanner(world, model, 3).plan(Belief.initial(world, model, prior), world.start())
    assert decision.value == pytest.approx(0.0, abs=1e-12)
    assert decision.ties == world.actions(world.start())
    assert decision.gap == np.inf


def test_rows_beyond_the_working_memory_are_made_room_for() -> None:
    belief, state = peaked(8)
    planner = EntropyPlanner(belief.world, belief.model, 4)
    wanted = planner.plan(belief, state, exact_values=True)
    small = EntropyPlanner(belief.world, belief.model, 4)
    small._capacity = 1
    assert small.plan(belief, state, exact_values=True) == wanted


def test_rows_beyond_the_memory_are_one_clear_error_and_with_a_deadline_a_shorter_horizon(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("taskcomm.planner.ROWS", 1)
    belief, state = peaked(8)
    small = EntropyPlanner(belief.world, belief.model, 5, memory=1 << 20)
    with pytest.raises(MemoryError, match=r"the beliefs 5 steps from .* do not fit into 1048576"):
        small.plan(belief, state, exact_values=True)
    decision = small.plan(belief, state, deadline=60.0)
    assert 1 <= decision.horizon < 5
    whole = EntropyPlanner(belief.world, belief.model, decision.horizon).plan(belief, state)
    assert decision.value == pytest.approx(whole.value, abs=1e-9)


def test_what_just_fits_into_the_memory_is_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("taskcomm.planner.ROWS", 1)
    belief, state = peaked(4)
    planner = EntropyPlanner(belief.world, belief.model, 4)
    wanted = planner.plan(belief, state)
    root = planner._graph.grow(planner._at(belief, state), 4)
    assert root is not None

    def fits(rows: int) -> bool:
        search = Search(belief, planner._graph, root, 4, 2e-9, 1.0, rows)
        search.run()
        return search.fits

    few, enough = len(belief.task) * 5, 1 << 16
    assert not fits(few)
    assert fits(enough)
    while enough - few > 1:  # the fewest rows with which it ends
        middle = (few + enough) // 2
        few, enough = (few, middle) if fits(middle) else (middle, enough)
    memory = enough * row_bytes(belief)
    planner._memory, planner._capacity = memory, 1
    assert planner.plan(belief, state) == wanted
    planner._memory, planner._capacity = memory - 1, 1
    with pytest.raises(MemoryError):
        planner.plan(belief, state)


def test_a_long_look_begins_with_what_a_shorter_one_took_for_the_best() -> None:
    world, model = BallWorld(2, 1), TeacherModel.intuitive()
    belief, state = Belief.initial(world, model), world.start()
    for text in ("light_on(1)", "pick_up(1)", "light_on(2)"):
        state = world.step(state, Action.parse(text))
        belief = belief.update(state, False)
    planner, tree = EntropyPlanner(world, model, 6), PlainTree(world, model, 6)
    decision, values = planner.plan(belief, state), tree.values(belief, state)
    assert decision.value == pytest.approx(min(values.values()), abs=1e-9)
    root = planner._graph.grow(planner._at(belief, state), 6)
    assert root is not None
    nodes = {}
    for best_first in (True, False):
        before = np.array([value if best_first else -value for value in values.values()])
        search = Search(belief, planner._graph, root, 6, 2e-9, 1.0, planner._capacity, before)
        assert search.run()
        assert search.bound.min() == pytest.approx(decision.value, abs=1e-12)
        nodes[best_first] = search.nodes
    assert nodes[True] < nodes[False]


def test_a_deadline_gives_the_longest_horizon_that_ends_by_then() -> None:
    world, model = BallWorld(), TeacherModel.intuitive()
    planner, belief, state = EntropyPlanner(world, model, 12), Belief.initial(world, model), world.start()
    planner.warm_up()
    horizons = []
    for deadline in (1e-9, 0.05, 0.4):
        decision = planner.plan(belief, state, deadline=deadline)
        whole = EntropyPlanner(world, model, decision.horizon).plan(belief, state)
        assert (decision.action, decision.ties) == (whole.action, whole.ties)
        assert decision.value == pytest.approx(whole.value, abs=1e-9)
        horizons.append(decision.horizon)
    assert horizons == sorted(horizons)
    assert horizons[0] == 1
    assert 3 <= horizons[2] < 12
    assert EntropyPlanner(world, model, 3).plan(belief, state, deadline=60.0).horizon == 3


def test_a_search_in_slices_is_the_search_in_one() -> None:
    belief, state = peaked(4)
    planner = EntropyPlanner(belief.world, belief.model, 5)
    whole = planner.plan(belief, state, exact_values=True)
    root = planner._graph.node(planner._at(belief, state))
    search = Search(belief, planner._graph, root, 5, np.inf, 1.0, planner._capacity)
    values, slices = np.array(list(whole.values.values())), 1
    while search.fits and not search.run(until=0.0):
        slices += 1
        assert (search.bound <= values + 1e-12).all()  # what stands there is right at any time
        assert search.bound[search.exact] == pytest.approx(values[search.exact], abs=1e-12)
        assert (search.at_most >= values - 1e-12).all()
    assert search.fits
    assert slices > 1
    assert list(search.bound) == list(whole.values.values())
    assert search.nodes == whole.nodes


def test_random_ties_are_drawn_from_the_ties_by_the_seed() -> None:
    world, model = BallWorld(), TeacherModel.intuitive()
    belief = Belief.initial(world, model)

    def drawn(seed: int) -> list[Action]:
        planner = EntropyPlanner(world, model, 1, ties="random", seed=seed)
        return [planner.plan(belief, world.start()).action for _ in range(20)]

    assert drawn(1) == drawn(1)
    assert set(drawn(1)) == {Action("light_on", ball) for ball in (1, 2, 3)}


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"horizon": 0}, "horizon"),
        ({"horizon": 2.5}, "horizon"),
        ({"horizon": 101}, "horizon must be a whole number of steps from 1 to 100, not 101"),
        ({"gamma": 0.0}, "gamma"),
        ({"gamma": 1.1}, "gamma"),
        ({"gamma": float("nan")}, "gamma"),
        ({"gamma": "1"}, "gamma"),
        ({"ties": "last"}, "ties"),
        ({"memory": 1e9}, "memory"),
        ({"memory": "1 GB"}, "memory"),
    ],
)
def test_bad_settings_are_named(arguments: dict[str, object], named: str) -> None:
    with pytest.raises(ValueError, match=named):
        EntropyPlanner(BallWorld(), TeacherModel.intuitive(), **arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize("deadline", [0.0, -1.0, float("nan"), True, "0.4"])
def test_a_deadline_must_be_a_positive_number(deadline: float) -> None:
    world, model = BallWorld(2, 1), TeacherModel.intuitive()
    with pytest.raises(ValueError, match="deadline"):
        EntropyPlanner(world, model, 2).plan(Belief.initial(world, model), world.start(), deadline=deadline)


def test_unknown_cues_and_foreign_beliefs_are_refused() -> None:
    world, model = BallWorld(), TeacherModel.intuitive()
    strange = TeacherModel(mistake=0.01, approvals={"that": TableTop("smell", 0.1, 1.0, 1.0)})
    with pytest.raises(ModelError, match="smell"):
        EntropyPlanner(world, strange)
    for other in (BallWorld(2, 2), BallWorld(2, 12)):  # the latter has as many tasks
        with pytest.raises(ValueError, match="another model or world"):
            EntropyPlanner(world, model).plan(Belief.initial(other, model), world.start())


def test_a_belief_that_has_the_approvals_in_another_order_is_refused() -> None:
    world, model = BallWorld(), TeacherModel.intuitive()
    turned = TeacherModel(mistake=model.mistake, approvals=dict(reversed(list(model.approvals.items()))))
    assert turned == model
    with pytest.raises(ValueError, match="another model or world"):
        EntropyPlanner(world, model).plan(Belief.initial(world, turned), world.start())
    assert EntropyPlanner(world, turned).plan(Belief.initial(world, turned), world.start()).value > 0


def test_what_is_no_belief_is_named() -> None:
    world, nothing = BallWorld(), cast(Belief, None)  # as from a script that nobody checked the types of
    with pytest.raises(TypeError, match=r"belief must be a taskcomm\.Belief, not None"):
        EntropyPlanner(world, TeacherModel.intuitive()).plan(nothing, world.start())
