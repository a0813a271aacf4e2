"""What a decision proves of a horizon that it did not reach: true, and as tight as the laws it uses."""

import gc
import itertools
import json
import time
from collections import Counter
from typing import Any

import numpy as np
import pytest
from decisions import Family, group
from hypothesis import given
from hypothesis import strategies as st
from plaintree import PlainTree
from scipy.optimize import linprog
from teachers import small_world, tiny_world
from trees import EXACT

from taskcomm import searching
from taskcomm.belief import Belief
from taskcomm.certificate import Looked, certificate, enclosed, most_told
from taskcomm.decision import TIE, Decision
from taskcomm.planner import EntropyPlanner
from taskcomm.teacher import TeacherModel
from taskcomm.world import BallWorld

INFINITE = np.inf


def cut_off(
    monkeypatch: pytest.MonkeyPatch, planner: EntropyPlanner, belief: Belief, state: Any, looks: int
) -> Decision:
    """The decision whose deadline comes after so many looks at the clock, slices of a search being small."""
    ticks = itertools.count()
    with monkeypatch.context() as clock:
        clock.setattr(searching, "SLICE", 3)
        clock.setattr(time, "perf_counter", lambda: float(next(ticks)))
        return planner.plan(belief, state, deadline=float(looks))


@pytest.mark.parametrize(
    "family",
    [
        Family(3, small_world, groups=25, beliefs=4, rows=60),
        Family(4, tiny_world, groups=40, beliefs=4, rows=40),
        Family(5, tiny_world, groups=8, beliefs=3, rows=20),
    ],
    ids=lambda family: family.name,
)
def test_bounds_enclose_the_whole_tree_wherever_the_search_is_cut_off(
    family: Family, monkeypatch: pytest.MonkeyPatch
) -> None:
    reached: Counter[int] = Counter()
    rng = np.random.default_rng(5)
    for seed in range(family.groups):
        of = group(family, seed)
        tree = PlainTree(of.world, of.model, family.horizon, of.gamma)
        planner = EntropyPlanner(of.world, of.model, family.horizon, gamma=of.gamma)
        for _, belief, state in of.situations:
            truth = tree.values(belief, state)
            decision = cut_off(monkeypatch, planner, belief, state, int(10 ** rng.uniform(0.0, 2.3)))
            assert_proven(decision, truth)
            reached[decision.horizon] += 1
    assert set(reached) == set(range(1, family.horizon + 1))


def assert_proven(decision: Decision, truth: dict[Any, float]) -> None:
    """The certificate holds of the true Q_H."""
    proof = decision.certificate
    assert proof is not None
    assert list(proof.lower) == list(proof.upper) == list(truth)
    for action, value in truth.items():
        assert proof.lower[action] - EXACT <= value <= proof.upper[action] + EXACT
    excess = truth[decision.action] - min(truth.values())
    assert proof.regret >= 0
    assert excess <= proof.regret + TIE + EXACT
    assert proof.optimal == (proof.regret == 0)


def test_a_decision_at_the_planners_horizon_is_proven_optimal() -> None:
    world, model = BallWorld(), TeacherModel.intuitive()
    belief, state = Belief.initial(world, model), world.start()
    for deadline in (None, 60.0):
        decision = EntropyPlanner(world, model, 3).plan(belief, state, deadline=deadline)
        proof = decision.certificate
        assert proof is not None
        assert (proof.horizon, proof.regret, proof.optimal) == (3, 0.0, True)
        assert {a: proof.lower[a] for a in decision.values} == decision.values
        assert proof.lower == {a: (decision.values | decision.bounds)[a] for a in proof.lower}
        assert proof.upper == {a: (decision.values | decision.upper_bounds)[a] for a in proof.upper}


def test_a_certain_belief_needs_no_further_look(monkeypatch: pytest.MonkeyPatch) -> None:
    world, model = BallWorld(), TeacherModel.intuitive()
    belief = Belief.initial(world, model, [1.0] + [0.0] * 23)
    decision = cut_off(monkeypatch, EntropyPlanner(world, model, 10), belief, world.start(), 1)
    assert decision.horizon == 1
    assert decision.certificate is not None
    assert decision.certificate.optimal


@pytest.mark.parametrize("gamma", [1e-3, 1e-60, 1e-200])
def test_a_discount_that_leaves_later_steps_no_weight_is_certified_by_the_first(gamma: float) -> None:
    first = np.array([1.5, 1.0])
    looked = Looked(1, first, first, first, np.full(1, np.inf))
    lower, upper = enclosed([looked], np.full(10, 0.1), gamma)
    assert (first <= lower).all()
    assert (lower <= upper).all()
    assert upper == pytest.approx(first / (1.0 - gamma), rel=1e-12)


def test_a_certificate_is_written_as_plain_values() -> None:
    proof = certificate(["wait", "light"], 1, 7, np.array([2.0, 1.0]), np.array([3.0, 2.25]), 1e-9)
    assert (proof.regret, proof.optimal) == (0.25, False)
    assert json.loads(json.dumps(proof.to_json())) == {
        "horizon": 7,
        "lower": {"wait": 2.0, "light": 1.0},
        "upper": {"wait": 3.0, "light": 2.25},
        "regret": 0.25,
        "optimal": False,
    }


@pytest.mark.parametrize(
    ("lower", "upper", "regret"),
    [
        ([1.0, 3.0], [2.0, 4.0], 0.0),  # the first is the better one, whatever it costs
        ([1.0, 2.0 - 1e-10], [2.0, 4.0], 0.0),  # or tied
        ([1.0, 1.5], [2.0, 4.0], 0.5),
        ([1.0], [2.0], 0.0),  # there is no other
    ],
)
def test_regret_is_against_the_other_actions(lower: list[float], upper: list[float], regret: float) -> None:
    proof = certificate(range(len(lower)), 0, 2, np.array(lower), np.array(upper), TIE)
    assert (proof.regret, proof.optimal) == (regret, regret == 0)


@st.composite
def courses(draw: st.DrawFn) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any], float]:
    """Expected entropy after each of some steps, the most that each step can tell, and a discount."""
    horizon = draw(st.integers(1, 7))
    told = np.array(draw(st.lists(st.floats(0.0, 1.0), min_size=horizon, max_size=horizon)))
    used = np.array(draw(st.lists(st.floats(0.0, 1.0), min_size=horizon, max_size=horizon)))
    course = np.maximum(0.0, draw(st.floats(0.0, 4.0)) - np.cumsum(told * used))
    return course, told, draw(st.sampled_from([1.0, 0.9, 0.3]))


@given(courses(), st.data())
def test_bounds_enclose_every_course_that_the_laws_allow(
    drawn: tuple[np.ndarray[Any, Any], np.ndarray[Any, Any], float], data: st.DataObject
) -> None:
    course, told, gamma = drawn
    sums = np.cumsum(course * gamma ** np.arange(len(course)))
    horizons = data.draw(st.lists(st.integers(1, len(course)), min_size=1, unique=True))
    loose = data.draw(st.sampled_from([0.0, 0.1]))
    looked = [
        Looked(h, sums[h - 1 : h] - loose, sums[h - 1 : h] + loose, course[:1], np.full(h, INFINITE))
        for h in sorted(horizons)
    ]
    lower, upper = enclosed(looked, told, gamma)
    assert lower[0] - EXACT <= sums[-1] <= upper[0] + EXACT


def test_lower_bound_is_the_least_that_the_laws_allow() -> None:
    """A linear program finds the same, from one search."""
    rng = np.random.default_rng(11)
    for _ in range(200):
        told = rng.uniform(0.0, 0.5, int(rng.integers(2, 9)))
        used = rng.uniform(size=len(told)) * (rng.uniform(size=len(told)) < 0.5)
        course = np.maximum(0.0, rng.uniform(0.0, 4.0) - np.cumsum(told * used))
        horizon, weight = int(rng.integers(1, len(told) + 1)), rng.choice([1.0, 0.8]) ** np.arange(len(told))
        value = float((course * weight)[:horizon].sum())
        looked = Looked(horizon, np.array([value]), np.array([INFINITE]), course[:1], told[:horizon])
        lower, _ = enclosed([looked], told, float(weight[1]))
        falls = np.eye(len(told))[:-1] - np.eye(len(told), k=1)[:-1]
        paid = np.where(np.arange(len(told)) < horizon, weight, 0.0)
        found = linprog(
            weight,
            A_ub=np.vstack([-falls, falls, -paid[None]]),
            b_ub=np.concatenate([np.zeros(len(told) - 1), told[1:], [-value]]),
            bounds=[(course[0], course[0]), *[(0.0, None)] * (len(told) - 1)],
        )
        assert found.success
        assert lower[0] == pytest.approx(found.fun, abs=1e-7)


def _told(prior: np.ndarray[Any, Any], press: np.ndarray[Any, Any]) -> float:
    def h2(p: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        return np.asarray(-p * np.log(p) - (1 - p) * np.log(1 - p))

    return float(h2(prior @ press) - prior @ h2(press))


@given(
    st.floats(1e-6, 0.1),
    st.lists(st.floats(0.0, 0.25), min_size=1, max_size=3),
    st.lists(st.tuples(st.floats(1e-3, 1.0), st.floats(0.0, 1.0)), min_size=1, max_size=6),
)
def test_no_step_tells_more_than_the_most(
    mistake: float, peaks: list[float], tasks: list[tuple[float, float]]
) -> None:
    prior, share = np.array(tasks).T
    prior = prior / prior.sum()
    press = mistake + share * sum(peaks)
    assert _told(prior, press) <= most_told(mistake, np.array(peaks), float(prior.max())) + 1e-12


@pytest.mark.parametrize(("mistake", "peak"), [(0.005, 0.3), (0.05, 0.1), (0.001, 0.9)])
def test_the_most_is_told_by_the_best_of_two_point_channels(mistake: float, peak: float) -> None:
    prior = np.linspace(0.001, 0.999, 9999)
    best = max(_told(np.array([p, 1 - p]), np.array([mistake + peak, mistake])) for p in prior)
    assert most_told(mistake, np.array([peak]), 0.0) == pytest.approx(best, abs=1e-7)
    assert most_told(mistake, np.array([0.0]), 0.0) == 0.0


def test_no_garbage_is_collected_between_the_start_of_a_deadline_and_the_decision() -> None:
    """Once before, of what is young; and what the decision added is not due to be collected right after."""
    world, model = BallWorld(4), TeacherModel.intuitive()
    told_apart = np.arange(1.0, len(world.tasks) + 1)  # no two balls are alike, and all of the world is met
    planner, belief = (
        EntropyPlanner(world, model, 6),
        Belief.initial(world, model, told_apart / told_apart.sum()),
    )
    planner.warm_up()
    generations: list[int] = []

    def collecting(phase: str, information: dict[str, int]) -> None:
        if phase == "start":
            generations.append(information["generation"])

    gc.callbacks.append(collecting)
    try:
        planner.plan(belief, world.start(), deadline=1.0)
        due = gc.get_count()[0]
    finally:
        gc.callbacks.remove(collecting)
    assert generations == [1]
    assert due < gc.get_threshold()[0]
    assert gc.isenabled()
    assert len(planner._graph.states) > 3 * gc.get_threshold()[0]
