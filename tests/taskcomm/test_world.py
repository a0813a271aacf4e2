"""The ball world against MODEL.md's own table of actions and cues, written out plainly here."""

import itertools
import math
import pickle
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import walks, worlds

from taskcomm.tasks import Task
from taskcomm.world import Action, BallState, BallWorld, InvalidAction, World, is_goal


class PlainWorld:
    """Sections 1 and 2 of the model with sets and dictionaries; every rule as it is written."""

    def __init__(self, world: BallWorld) -> None:
        self.balls = range(1, world.num_balls + 1)
        self.scale = range(1, world.num_distances + 1)
        self.off_the_scale = world.num_distances + 1
        self.slide_unheld = world.slide_unheld
        self.lit: set[int] = set()
        self.held: int | None = None
        self.placed: dict[int, tuple[int, int]] = {}
        self.last: tuple[Action, int] | None = None  # a slide and the distance before it

    def distance(self, i: int, j: int) -> int:
        reference, k = self.placed.get(i, (None, 0))
        return k if reference == j else self.off_the_scale

    def valid(self, action: Action) -> bool:
        match action.name, action.ball, action.distance, action.reference:
            case "noa", *_:
                return True
            case "light_on", i, *_:
                return i not in self.lit
            case "light_off", i, *_:
                return i in self.lit
            case "pick_up", *_:
                return self.held is None
            case "release", i, *_:
                return i == self.held
            case "slide", int(i), int(k), int(j) if i != j:
                rests_at_j = self.slide_unheld and self.distance(i, j) in self.scale
                return (i == self.held or rests_at_j) and abs(k - self.distance(i, j)) == 1
        return False

    def act(self, action: Action) -> None:
        self.last = None
        match action.name, action.ball, action.distance, action.reference:
            case "light_on", int(i), *_:
                self.lit.add(i)
            case "light_off", int(i), *_:
                self.lit.remove(i)
            case "pick_up", i, *_:
                self.held = i
            case "release", *_:
                self.held = None
            case "slide", int(i), int(k), int(j):
                self.last = action, self.distance(i, j)
                self.placed = {b: p for b, p in self.placed.items() if p[0] != i} | {i: (j, k)}

    def every_action(self) -> list[Action]:
        """All that can be said, in canonical order."""
        lights = [Action(name, i) for i in self.balls for name in ("light_on", "light_off")]
        hands = [Action(name, i) for name in ("pick_up", "release") for i in self.balls]
        slides = [
            Action("slide", i, k, j)
            for i, j, k in itertools.product(self.balls, self.balls, self.scale)
            if i != j
        ]
        return [Action("noa"), *lights, *hands, *slides]

    def cue(self, name: str, task: Task) -> bool:
        i, j, k = task
        match name:
            case "mov_lit":
                return i in self.lit
            case "wrt_lit_while_mov_held":
                return self.held == i and j in self.lit
            case "mov_at_dist":
                return self.placed.get(i) == (j, k)
            case "mov_held":
                return self.held == i
            case "wrt_lit":
                return j in self.lit
            case "mov_near_wrt":
                return i in self.placed and self.placed[i][0] == j
            case "mov_closing" if self.last:
                action, before = self.last
                nearer = abs(self.distance(i, j) - k) < abs(before - k)
                return (action.ball, action.reference) == (i, j) and nearer
        return False


@given(st.data())
def test_actions_steps_and_cues_are_those_of_the_model(data: st.DataObject) -> None:
    world = data.draw(worlds())
    plain, before = PlainWorld(world), world.start()
    for action, state in data.draw(walks(world, 15)):
        assert isinstance(state, BallState)
        assert list(world.actions(before)) == [a for a in plain.every_action() if plain.valid(a)]
        plain.act(action)
        assert (set(state.lit), state.held) == (plain.lit, plain.held)
        assert state.placements == tuple(plain.placed.get(i) for i in plain.balls)
        expected = [[plain.cue(name, task) for task in world.tasks] for name in world.cue_names]
        assert world.cues(state).tolist() == expected
        before = state


def test_canonical_order_is_noa_lights_hands_slides() -> None:
    world = BallWorld()
    state = world.start()
    for text in ("light_on(2)", "pick_up(1)", "slide(1, 4, 3)"):
        state = world.step(state, Action.parse(text))
    assert [str(action) for action in world.actions(state)] == [
        *("noa", "light_on(1)", "light_off(2)", "light_on(3)", "release(1)"),
        *("slide(1, 4, 2)", "slide(1, 3, 3)"),
    ]


def test_a_ball_keeps_its_placement_until_its_reference_slides() -> None:
    world = BallWorld()
    state = world.start()
    for text in ("pick_up(1)", "slide(1, 4, 2)", "release(1)", "pick_up(2)"):
        state = world.step(state, Action.parse(text))
    assert state.placements == ((2, 4), None, None)
    assert world.step(state, Action.parse("slide(2, 4, 3)")).placements == (None, (3, 4), None)


def test_closing_is_on_for_the_step_of_the_slide_alone() -> None:
    world = BallWorld()
    closing = world.cue_names.index("mov_closing")
    state, on = world.start(), []
    for text in ("pick_up(1)", "slide(1, 4, 2)", "slide(1, 3, 2)", "noa", "slide(1, 4, 2)"):
        state = world.step(state, Action.parse(text))
        row = world.cues(state)[closing]
        on.append([task.dist for task, yes in zip(world.tasks, row, strict=True) if yes])
    assert on == [[], [1, 2, 3, 4], [1, 2, 3], [], [4]]


@given(st.data())
def test_an_invalid_action_is_an_error_that_names_action_and_state(data: st.DataObject) -> None:
    world = data.draw(worlds())
    _, state = data.draw(walks(world, 6))[-1]
    assert isinstance(state, BallState)
    invalid = set(PlainWorld(world).every_action()) - set(world.actions(state))
    action = data.draw(st.sampled_from(sorted(invalid, key=str)))
    with pytest.raises(InvalidAction) as error:
        world.step(state, action)
    assert str(action) in str(error.value)
    assert str(state) in str(error.value)


@pytest.mark.parametrize("text", ["light_on(4)", "slide(1, 5, 2)", "slide(1, 4, 1)", "pick_up(9)"])
def test_balls_and_distances_beyond_the_world_are_invalid(text: str) -> None:
    world = BallWorld()
    held = world.step(world.start(), Action.parse("pick_up(1)"))
    for state in (world.start(), held):
        with pytest.raises(InvalidAction, match=text.split("(")[0]):
            world.step(state, Action.parse(text))


@given(st.data())
def test_renaming_the_balls_renames_actions_and_cues(data: st.DataObject) -> None:
    world = data.draw(worlds())
    balls = range(1, world.num_balls + 1)
    new: dict[Any, Any] = dict(zip(balls, data.draw(st.permutations(balls)), strict=True))
    new[None] = None

    def renamed(action: Action) -> Action:
        return Action(action.name, new[action.ball], action.distance, new[action.reference])

    tasks = [world.tasks.index(Task(new[i], new[j], k)) for i, j, k in world.tasks]
    other = world.start()
    for action, state in data.draw(walks(world, 10)):
        assert isinstance(state, BallState)
        other = world.step(other, renamed(action))
        np.testing.assert_array_equal(world.cues(other)[:, tasks], world.cues(state))
        assert set(world.actions(other)) == {renamed(a) for a in world.actions(state)}


def shortest(world: BallWorld, state: BallState, task: Task) -> float:
    """Length of a shortest way to the goal, breadth first over every valid action."""
    seen, edge, steps = {state[:3]}, [state], 0
    while edge:
        if any(world.is_goal(reached, task) for reached in edge):
            return steps
        following = []
        for reached in edge:
            for action in world.actions(reached):
                after = world.step(reached, action)
                if after[:3] not in seen:  # the last action matters to no goal
                    seen.add(after[:3])
                    following.append(after)
        edge, steps = following, steps + 1
    return math.inf


@given(st.data())
def test_the_route_is_a_shortest_way_to_the_goal(data: st.DataObject) -> None:
    world = data.draw(worlds(max_balls=3, max_distances=2) | worlds(max_balls=2, max_distances=4))
    _, state = data.draw(walks(world, 12))[-1]
    assert isinstance(state, BallState)
    task = data.draw(st.sampled_from(world.tasks))
    route = world.route(state, task)
    assert len(route) == shortest(world, state, task)
    for action in route:
        assert not is_goal(world, state, task)
        state = world.step(state, action)
    assert is_goal(world, state, task)


def test_a_world_without_goals_may_show_final_anywhere() -> None:
    class Plain:
        tasks, cue_names = ("a", "b"), ("hint",)

    assert is_goal(Plain(), "anywhere", "a")  # type: ignore[arg-type]


@given(worlds(max_balls=5))
def test_sizes_and_start_of_a_world(world: BallWorld) -> None:
    count = world.num_balls * (world.num_balls - 1) * world.num_distances
    assert isinstance(world, World)
    assert len(set(world.tasks)) == len(world.tasks) == count
    cues = world.cues(world.start())
    assert cues.shape == (len(world.cue_names), count)
    assert cues.dtype == np.bool_
    assert not cues.any()
    assert len(world.actions(world.start())) == 1 + 2 * world.num_balls


@given(worlds(max_balls=5))
def test_a_world_is_a_value(world: BallWorld) -> None:
    rebuilt = BallWorld(**{key: value for key, value in world.spec().items() if key != "name"})
    assert world.tasks  # fills the cache before the copy
    for copy in (rebuilt, pickle.loads(pickle.dumps(world))):
        assert copy == world
        assert hash(copy) == hash(world)
        assert copy.tasks == world.tasks


@pytest.mark.parametrize(
    ("sizes", "field"),
    [
        ({"num_balls": 1}, "num_balls"),
        ({"num_balls": 2.0}, "num_balls"),
        ({"num_balls": True}, "num_balls"),
        ({"num_distances": 0}, "num_distances"),
        ({"num_distances": "4"}, "num_distances"),
    ],
)
def test_sizes_out_of_range_are_errors_that_name_the_field(sizes: dict[str, Any], field: str) -> None:
    with pytest.raises(ValueError, match=f"^{field} must be"):
        BallWorld(**sizes)


@given(worlds())
def test_an_action_reads_as_it_prints(world: BallWorld) -> None:
    for action in PlainWorld(world).every_action():
        assert Action.parse(str(action)) == action
        assert pickle.loads(pickle.dumps(action)) == action
        assert hash(Action.parse(repr(action))) == hash(action)


def test_the_actions_print_as_in_the_paper() -> None:
    actions = Action("noa"), Action("light_on", 1), Action("pick_up", 2), Action("slide", 1, 4, 2)
    assert list(map(str, actions)) == ["noa", "light_on(1)", "pick_up(2)", "slide(1, 4, 2)"]
    assert Action.parse(" slide( 1,4 , 2 ) ") == actions[-1]


@pytest.mark.parametrize(
    "text",
    [
        *("", "fly", "light_on", "light_on()", "light_on(1, 2)", "light_on(-1)", "light_on(1.0)", "noa(1)"),
        *("slide(1, 4)", "slide(1,, 2)", "slide(1, 4, 2", "pick_up(1) release(1)", "LIGHT_ON(1)"),
    ],
)
def test_what_is_no_action_is_an_error_that_repeats_it(text: str) -> None:
    with pytest.raises(ValueError, match="not an action") as error:
        Action.parse(text)
    assert repr(text) in str(error.value)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("jump",), "unknown action 'jump'"),
        (("light_on",), "light_on: ball must be"),
        (("light_on", 0), "light_on: ball must be a whole number from 1"),
        (("light_on", True), "light_on: ball must be"),
        (("light_on", 1, 2), "light_on takes no distance"),
        (("slide", 1, 2, 0), "slide: reference must be"),
        (("noa", 1), "noa takes no ball"),
    ],
)
def test_an_action_with_wrong_arguments_is_an_error(arguments: tuple[Any, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Action(*arguments)
