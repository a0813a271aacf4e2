"""The robot: when it shows Final, how it walks there, what it survives."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tinyworld import menu

from taskcomm.belief import Belief
from taskcomm.planner import EntropyPlanner
from taskcomm.robot import Final, Robot
from taskcomm.routes import NoRoute, route
from taskcomm.simulate import SimulatedTeacher, run_trial
from taskcomm.tasks import Task
from taskcomm.teacher import TableTop, TeacherModel
from taskcomm.world import Action, BallState, BallWorld, is_goal

WORLD, MODEL = BallWorld(), TeacherModel.intuitive()


@dataclass
class Choice:
    action: Any


class Wander:
    """A stand-in planner: `pick` among the valid actions, and how often it was asked."""

    def __init__(self, world: Any, pick: Callable[[Sequence[Any], int], Any]) -> None:
        self._actions, self._pick, self.asked = world.actions, pick, 0

    def plan(self, belief: Belief, state: Any) -> Choice:
        self.asked += 1
        return Choice(self._pick(self._actions(state), self.asked))


def prior_of(weights: dict[Task, float]) -> list[float]:
    rest = (1 - sum(weights.values())) / (len(WORLD.tasks) - len(weights))
    return [weights.get(task, rest) for task in WORLD.tasks]


@given(st.data())
def test_after_every_update_the_rule_of_the_model_decides(data: st.DataObject) -> None:
    sharp = TeacherModel(
        mistake=0.005,
        approvals={s: TableTop(top.cue, 0.3, 0.5, 0.5) for s, top in MODEL.approvals.items()},
    )
    world = BallWorld(num_balls=2, num_distances=2)
    pick = data.draw(st.integers(0, 10**6))
    planner = Wander(world, lambda actions, asked: actions[(pick + asked * 7) % len(actions)])
    robot, belief, pressed = Robot(world, sharp, planner, threshold=0.9), Belief.initial(world, sharp), None
    state = world.start()
    for _ in range(60):
        asked, action = planner.asked, robot.act(pressed)
        best = int(belief.marginal().argmax())
        task = world.tasks[best]
        if belief.marginal()[best] <= 0.9:
            assert planner.asked == asked + 1
        elif is_goal(world, state, task):
            assert action == Final(task)
            return
        else:
            assert action == world.route(state, task)[0]
            assert planner.asked == asked
            assert robot.decision is None
        state = world.step(state, action)
        assert robot.state == state
        pressed = data.draw(st.booleans())
        belief = belief.update(state, pressed)


def test_final_at_once_takes_no_step() -> None:
    world, model = menu()
    robot = Robot(world, model, prior=[0.99, 0.01, 0, 0])
    robot.state = ("soup", "soup")
    assert robot.act(None) == Final("soup")


def test_a_belief_that_falls_back_asks_the_planner_again() -> None:
    known, other = Task(1, 2, 1), Task(1, 2, 4)
    planner = Wander(WORLD, lambda actions, asked: actions[0])
    robot = Robot(WORLD, MODEL, planner, prior=prior_of({known: 0.985, other: 0.014}))
    assert [robot.act(None), robot.act(False)] == [Action.parse("pick_up(1)"), Action.parse("slide(1, 4, 2)")]
    assert planner.asked == 0
    robot.act(True)  # approval of the distance on the way
    assert planner.asked == 1


def test_a_belief_that_moves_to_another_task_changes_course() -> None:
    known, other = Task(1, 2, 1), Task(1, 2, 4)
    planner = Wander(WORLD, lambda actions, asked: actions[0])
    robot = Robot(WORLD, MODEL, planner, prior=prior_of({known: 0.985, other: 0.014}))
    robot.act(None), robot.act(False), robot.act(True)
    presses, shown = 0, None
    while not isinstance(shown, Final) and presses < 20:
        presses, shown = presses + 1, robot.act(True)
    assert shown == Final(other)


def test_a_robot_on_its_way_turns_round_for_another_task() -> None:
    known, other = Task(1, 2, 1), Task(3, 2, 1)
    planner = Wander(WORLD, lambda actions, asked: actions[0])
    robot = Robot(WORLD, MODEL, planner, prior=prior_of({known: 0.985, other: 0.0149}))
    robot.state = WORLD.step(WORLD.start(), Action.parse("light_on(3)"))
    assert str(robot.act(None)) == "pick_up(1)"
    actions = [str(robot.act(pressed)) for pressed in [True] * 5 + [False] * 2]
    assert actions[0] == "noa"
    assert actions[-3:] == ["release(1)", "pick_up(3)", "slide(3, 4, 2)"]


def test_walks_by_a_shortest_way_in_a_world_that_names_none() -> None:
    world, model = menu()
    robot = Robot(world, model, prior=[0.001, 0.997, 0.001, 0.001])
    assert [robot.act(None), robot.act(False), robot.act(False)] == [
        "point at pizza",
        "serve pizza",
        Final("pizza"),
    ]


def test_shows_final_anywhere_in_a_world_without_goals() -> None:
    world, model = menu()

    class Goalless:
        tasks, cue_names = world.tasks, world.cue_names
        start, actions, step, cues = world.start, world.actions, world.step, world.cues

    assert Robot(Goalless(), model, prior=[0.001, 0.997, 0.001, 0.001]).act(None) == Final("pizza")


class Wayless:
    """Another world, without its `route`."""

    def __init__(self, world: Any) -> None:
        self.tasks, self.cue_names = world.tasks, world.cue_names
        self.start, self.actions, self.step = world.start, world.actions, world.step
        self.cues, self.is_goal = world.cues, world.is_goal


@settings(max_examples=25)
@given(st.lists(st.integers(0, 10**6), max_size=12), st.integers(0, 11), st.booleans())
def test_the_way_found_by_search_is_as_short_as_the_worlds_own(
    picks: list[int], number: int, slide_unheld: bool
) -> None:
    world = BallWorld(num_balls=3, num_distances=2, slide_unheld=slide_unheld)
    state: BallState = world.start()
    for pick in picks:
        actions = world.actions(state)
        state = world.step(state, actions[pick % len(actions)])
    way = route(Wayless(world), state, world.tasks[number])
    assert len(way) == len(world.route(state, world.tasks[number]))
    for action in way:
        state = world.step(state, action)
    assert world.is_goal(state, world.tasks[number])


def test_a_goal_out_of_reach_is_one_clear_error() -> None:
    world, model = menu()

    closed = Wayless(world)
    closed.is_goal = lambda state, task: False
    with pytest.raises(NoRoute, match=r"no way to the goal of pizza from \('', ''\) among 21 states"):
        Robot(closed, model, prior=[0.001, 0.997, 0.001, 0.001]).act(None)
    with pytest.raises(NoRoute):
        route(Wayless(WORLD), WORLD.start(), WORLD.tasks[0], limit=3)


def test_ten_thousand_steps_of_contrary_presses_leave_a_belief() -> None:
    world = BallWorld(num_balls=2, num_distances=1)
    robot = Robot(
        world, MODEL, Wander(world, lambda actions, asked: actions[asked // 50 % 3]), threshold=1 - 1e-16
    )
    pressed, rng = None, np.random.default_rng(3)
    for t in range(10_000):
        action = robot.act(pressed)
        assert not isinstance(action, Final)
        pressed = bool(rng.random() < (0.2 if t // 1000 % 2 else 0.002))
    marginal = robot.belief.marginal()
    assert np.isfinite(marginal).all()
    assert marginal.sum() == pytest.approx(1, abs=1e-12)


def test_presses_under_every_task_at_odds_never_kill_the_robot() -> None:
    world, model = (
        BallWorld(num_balls=2, num_distances=1),
        TeacherModel(mistake=1e-300, approvals={"that_mov": TableTop("mov_lit", 0.9, 0.5, 0.5)}),
    )
    robot = Robot(world, model, Wander(world, lambda actions, asked: actions[0]), threshold=0.999)
    robot.act(None)
    for _ in range(2000):
        robot.act(True)  # nothing is lit: every press is a mistake
    assert robot.belief.marginal() == pytest.approx([0.5, 0.5])


def test_reset_makes_the_next_trial_the_same_as_the_first() -> None:
    world, model = menu(3)
    robot = Robot(world, model, EntropyPlanner(world, model, horizon=2, ties="random"))
    trials = [
        run_trial(robot, SimulatedTeacher(world, model, "paella"), np.random.default_rng(5)) for _ in range(2)
    ]
    fresh = Robot(world, model, EntropyPlanner(world, model, horizon=2, ties="random", seed=9))
    again = run_trial(fresh, SimulatedTeacher(world, model, "paella"), np.random.default_rng(5))
    assert trials[0] == trials[1] == again


def test_random_ties_follow_the_seed_of_the_trial() -> None:
    world, model = menu()
    robot = Robot(world, model, EntropyPlanner(world, model, horizon=1, ties="random"))
    teacher = SimulatedTeacher(world, model, "paella")
    first = {run_trial(robot, teacher, np.random.default_rng(seed)).actions[0] for seed in range(12)}
    assert len(first) > 1


def test_the_planner_is_entropy_at_horizon_5_unless_given() -> None:
    robot = Robot(WORLD, MODEL)
    assert isinstance(robot.planner, EntropyPlanner)
    assert robot.planner.horizon == 5
    assert robot.description == {
        "condition": "pomdp",
        "robot_model": {"name": "intuitive", "sha256": MODEL.sha256},
        "planner": {"horizon": 5, "threshold": 0.98, "seed": None},
    }


class Timed(Wander):
    """A stand-in planner that notes its deadlines."""

    def __init__(self, world: Any) -> None:
        super().__init__(world, lambda actions, asked: actions[0])
        self.deadlines: list[float | None] = []

    def plan(self, belief: Belief, state: Any, deadline: float | None = None) -> Choice:
        self.deadlines.append(deadline)
        return super().plan(belief, state)


def test_every_decision_gets_the_deadline_and_none_where_the_robot_has_none() -> None:
    world, model = menu()
    for deadline in (0.2, None):
        planner = Timed(world)
        robot = Robot(world, model, planner, deadline=deadline)
        robot.act(None), robot.act(False)
        assert planner.deadlines == [deadline] * 2
    assert robot.description["planner"].keys() == {"horizon", "threshold", "seed"}


def test_a_deadline_that_is_long_enough_changes_nothing_and_one_that_is_not_shortens_the_view() -> None:
    world, model = menu(3)
    teacher = SimulatedTeacher(world, model, "paella")
    trials = [
        run_trial(Robot(world, model, EntropyPlanner(world, model, 3), deadline=deadline), teacher, rng)
        for deadline, rng in ((None, np.random.default_rng(3)), (1000.0, np.random.default_rng(3)))
    ]
    assert trials[0].steps == trials[1].steps
    assert trials[1].planner == {"horizon": 3, "threshold": 0.98, "seed": None, "deadline": 1000.0}
    hurried = Robot(WORLD, MODEL, deadline=1e-9)
    hurried.act(None)
    assert hurried.decision.horizon == 1


def test_with_a_deadline_the_planner_may_look_10_steps_ahead_unless_given() -> None:
    robot = Robot(WORLD, MODEL, deadline=0.4)
    told = {"horizon": 10, "threshold": 0.98, "seed": None, "deadline": 0.4}
    assert robot.description["planner"] == told
    assert isinstance(robot.planner, EntropyPlanner)
    assert robot.planner.horizon == 10
    assert robot.description["planner"] == told


@pytest.mark.parametrize("deadline", [0, -0.4, float("nan"), True, "0.4"])
def test_refuses_a_deadline_that_is_none_or_that_the_planner_takes_none_of(deadline: float) -> None:
    with pytest.raises(ValueError, match="deadline: must be a positive number of seconds"):
        Robot(WORLD, MODEL, deadline=deadline)
    with pytest.raises(ValueError, match=r"deadline: Wander\.plan\(belief, state\) takes none"):
        Robot(WORLD, MODEL, Wander(WORLD, lambda actions, asked: actions[0]), deadline=0.4)


@pytest.mark.parametrize("threshold", [0, 1, -0.5, 1.5, float("nan")])
def test_refuses_a_threshold_that_is_none(threshold: float) -> None:
    with pytest.raises(ValueError, match="threshold: must be between 0 and 1"):
        Robot(WORLD, MODEL, threshold=threshold)


def test_refuses_a_planner_of_another_world_or_model() -> None:
    with pytest.raises(ValueError, match="planner: made for another world"):
        Robot(BallWorld(num_balls=4), MODEL, EntropyPlanner(WORLD, MODEL))
    with pytest.raises(ValueError, match="planner: made for another model"):
        Robot(WORLD, menu()[1], EntropyPlanner(WORLD, MODEL))
    with pytest.raises(ValueError, match="prior: must be 24 probabilities"):
        Robot(WORLD, MODEL, prior=[1.0])


def test_refuses_calls_out_of_turn() -> None:
    world, model = menu()
    robot = Robot(world, model, Wander(world, lambda actions, asked: actions[0]))
    with pytest.raises(ValueError, match=r"begins with act\(None\)"):
        robot.act(True)
    robot.act(None)
    with pytest.raises(ValueError, match=r"begins with act\(None\)"):
        robot.act(None)
    sure = Robot(world, model, prior=[1, 0, 0, 0])
    sure.act(None), sure.act(False)
    assert sure.act(False) == Final("soup")
    with pytest.raises(ValueError, match="ends with Final"):
        sure.act(False)
