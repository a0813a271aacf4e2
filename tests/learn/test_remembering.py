"""A planner that remembers: the same decisions, each made once."""

from itertools import pairwise

import numpy as np
import pytest
from tinyworld import menu

from learn.remembering import Remembering, fingerprint
from taskcomm.belief import Belief
from taskcomm.planner import EntropyPlanner
from taskcomm.robot import Robot
from taskcomm.simulate import SimulatedTeacher, run_trial
from taskcomm.teacher import TeacherModel
from taskcomm.world import Action, BallWorld

WORLD, MODEL = menu(3)


def test_trials_are_those_of_the_planner_and_what_was_decided_once_is_not_decided_again() -> None:
    memory = Remembering(EntropyPlanner(WORLD, MODEL, 3))
    robot, plain = Robot(WORLD, MODEL, memory), Robot(WORLD, MODEL, EntropyPlanner(WORLD, MODEL, 3))
    made = anew = 0
    for n in range(12):
        teacher = SimulatedTeacher(WORLD, MODEL, WORLD.tasks[n % 4])
        trial = run_trial(robot, teacher, np.random.default_rng(n))
        assert trial.steps == run_trial(plain, teacher, np.random.default_rng(n)).steps
        assert all(decision.horizon == 3 and decision.seconds > 0 for decision in memory.made)
        made, anew = made + len(memory.made), anew + memory.anew
    assert 0 < anew < made
    run_trial(robot, teacher, np.random.default_rng(11))
    assert (memory.anew, len(memory.made) > 0) == (0, True)


def test_a_decision_by_a_deadline_is_made_anew() -> None:
    memory = Remembering(EntropyPlanner(WORLD, MODEL, 3))
    belief, state = Belief.initial(WORLD, MODEL), WORLD.start()
    for _ in range(2):
        memory.plan(belief, state, deadline=1000.0)
    assert (memory.anew, len(memory.made)) == (2, 2)


def test_random_ties_cannot_be_remembered() -> None:
    with pytest.raises(ValueError, match="ties: 'random' cannot be remembered"):
        Remembering(EntropyPlanner(WORLD, MODEL, ties="random"))


def test_beliefs_have_one_fingerprint_where_they_are_equal_only() -> None:
    world, model = BallWorld(2, 2), TeacherModel.intuitive()
    states = [world.start()]
    for text in ("light_on(1)", "pick_up(1)", "slide(1, 2, 2)", "slide(1, 1, 2)"):
        states.append(world.step(states[-1], Action.parse(text)))
    for steps in range(1, 5):
        found = []
        for presses in np.ndindex(*[2] * steps):
            belief = again = Belief.initial(world, model)
            for state, pressed in zip(states[1:], presses, strict=False):
                belief, again = belief.update(state, bool(pressed)), again.update(state, bool(pressed))
            assert fingerprint(belief) == fingerprint(again)
            found.append((fingerprint(belief), belief))
        found.sort(key=lambda pair: pair[0])
        for (one, a), (two, b) in pairwise(found):
            same = np.array_equal(a.weight, b.weight) and np.array_equal(a.level, b.level)
            assert (one == two) == (same and np.array_equal(a.task, b.task))


def test_the_time_since_a_press_counts_while_the_teacher_rests_only() -> None:
    state = WORLD.start()
    for rest, differ in ((0.0, False), (1.0, True)):
        model = TeacherModel(mistake=0.1, approvals=MODEL.approvals, rest=rest)
        prior = [1.0, 0.0, 0.0, 0.0]  # nothing is on, so a press changes nothing but what follows it
        silent, pressed = (Belief.initial(WORLD, model, prior).update(state, seen) for seen in (False, True))
        assert (fingerprint(silent) != fingerprint(pressed)) == differ
