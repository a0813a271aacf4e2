"""P(observation | mental state, task): the table, the number, what is missing, and what cannot be."""

import json
import math
import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import observed
from signalled import ROLES, gazing, observation_models, signals_of
from strategies import models, worlds
from tinyworld import menu

from taskcomm.channels import NormalChannel, ObservationModel, PlainChannel, TargetChannel
from taskcomm.observation import Observer, observation_logs
from taskcomm.tasks import Task
from taskcomm.teacher import ModelError, TeacherModel
from taskcomm.trials import Step, Trial
from taskcomm.world import NOA, BallWorld

INTUITIVE = TeacherModel.intuitive()
STATES = INTUITIVE.mental_states


@settings(max_examples=60)
@given(st.data())
def test_the_weights_are_the_law_step_by_step(data: st.DataObject) -> None:
    world, model = data.draw(worlds(max_balls=3, max_distances=2)), data.draw(models())
    seen = data.draw(observation_models(model))
    model = replace(model, observation=seen)
    keys = data.draw(st.lists(st.sampled_from([True, False, None]), min_size=1, max_size=3))
    steps = tuple(Step(NOA, key, signals=data.draw(signals_of(seen, world.num_balls))) for key in keys)
    weights = np.exp(observation_logs(Trial("a", world, None, steps), world, model))
    expected = [
        [
            [
                observed(world, model, task, m, step.pressed, dict(step.signals or {}))
                for m in model.mental_states
            ]
            for task in range(len(world.tasks))
        ]
        for step in steps
    ]
    assert weights == pytest.approx(np.array(expected), rel=1e-12)


def test_an_exact_key_says_whether_the_teacher_waits_and_a_missing_one_nothing() -> None:
    steps = (Step(NOA, True), Step(NOA, False), Step(NOA, None, signals={"gaze": "1"}))
    trial = Trial("a", BallWorld(), None, steps)
    weights = np.exp(observation_logs(trial, trial.world, INTUITIVE))
    assert weights.shape == (3, 24, 5)
    assert (weights == np.array([[0, 1, 1, 1, 1], [1, 0, 0, 0, 0], [1, 1, 1, 1, 1]])[:, None]).all()


def test_a_look_at_a_ball_has_the_probability_of_its_role_shared_by_the_balls_that_have_it() -> None:
    world, gaze = BallWorld(4, 1), gazing().observation.channels["gaze"]
    assert isinstance(gaze, TargetChannel)
    tables = Observer(world, gazing()).tables["gaze"]
    task = list(world.tasks).index(Task(3, 1, 1))
    column = STATES.index("that_mov")
    shares = {value: table[task, column] for value, table in tables.items()}
    assert shares == pytest.approx({"1": 0.1, "2": 0.05, "3": 0.7, "4": 0.05, "none": 0.1}, rel=1e-12)


def test_a_role_that_no_ball_has_leaves_its_probability_to_the_others() -> None:
    tables = Observer(BallWorld(2, 1), gazing()).tables["gaze"]
    shares = {value: table[0, STATES.index("that_mov")] for value, table in tables.items()}
    assert shares == pytest.approx({"1": 7 / 9, "2": 1 / 9, "none": 1 / 9}, rel=1e-12)


@settings(max_examples=40)
@given(st.data())
def test_all_that_may_be_observed_has_probability_1_and_a_missing_signal_is_summed_over(
    data: st.DataObject,
) -> None:
    world, model = data.draw(worlds(max_balls=3, max_distances=2)), data.draw(models())
    observer = Observer(world, replace(model, observation=data.draw(observation_models(model))))
    pressed, signals, table = observer.outcomes()
    assert table.sum(axis=0) == pytest.approx(np.ones(table.shape[1:]), rel=1e-12)
    for key in (False, True):
        own = np.array([one == key for one in pressed])
        assert table[own].sum(axis=0) == pytest.approx(observer.weights(key), abs=1e-12)
    for name, values in observer.tables.items():
        summed = sum(observer.weights(None, {name: value}) for value in values)
        assert summed == pytest.approx(observer.weights(None), rel=1e-12)
    for key, shown, row in zip(pressed, signals, table, strict=True):
        assert observer.weights(key, shown) == pytest.approx(row, rel=1e-12)


@settings(max_examples=40)
@given(st.data())
def test_a_model_file_holds_the_observation_model(data: st.DataObject) -> None:
    model = data.draw(models())
    model = replace(model, observation=data.draw(observation_models(model)))
    for again in (TeacherModel.from_json(model.to_json()), pickle.loads(pickle.dumps(model))):
        assert again == model
        assert hash(again) == hash(model)
        assert again.sha256 == model.sha256
        assert again.to_json() == model.to_json()


def test_models_whose_key_says_it_all_have_the_files_and_hashes_that_they_had() -> None:
    assert "observation" not in INTUITIVE.to_dict()
    assert replace(INTUITIVE, observation=ObservationModel()) == INTUITIVE
    assert INTUITIVE.sha256 != gazing().sha256 != gazing(miss=0.1).sha256
    assert INTUITIVE != gazing() != gazing(miss=0.1)


def test_a_key_that_fires_by_itself_does_so_as_often_per_second_at_another_step() -> None:
    model = gazing(miss=0.2, false_press=0.05).with_dt(1.0)
    assert model.observation.false_press == pytest.approx(1 - 0.95**2, rel=1e-12)
    assert model.observation.miss == 0.2


def _load(**changes: Any) -> TeacherModel:
    """A gazing teacher's model file with other fields in its observation model."""
    observation = gazing(miss=0.1).observation.to_dict() | changes
    return TeacherModel.from_json(json.dumps(INTUITIVE.to_dict() | {"observation": observation}))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"miss": 1.0}, r"miss: must be below 1, not 1"),
        ({"miss": "often"}, r"miss: must be a number, not 'often'"),
        ({"false_press": -0.1}, r"false_press: must be finite and at least 0, not -0\.1"),
        ({"mis": 0.1}, r"mis: unknown field"),
        ({"channels": []}, r"channels: must be an object"),
        (
            {"channels": {"press": {"kind": "plain", "table": {"waiting": {"a": 1}}}}},
            r"channels: 'press' cannot",
        ),
    ],
)
def test_what_is_wrong_with_an_observation_model_is_named(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ModelError, match=rf"^observation: {message}"):
        _load(**changes)


def _table(row: dict[str, float], kind: str = "plain") -> dict[str, Any]:
    return {"kind": kind, "table": dict.fromkeys(STATES, row)}


WAITING_ONLY = {"kind": "plain", "table": {"waiting": {"a": 1.0}}}
NUMBER = {"kind": "normal", "mean": {"waiting": 0}, "sd": {"waiting": 1}}
BY_ROLE = NUMBER | {"mean": {"waiting": {"mov": 0}}, "sd": {"waiting": {"mov": 1}}, "target": "face"}


@pytest.mark.parametrize(
    ("channel", "message"),
    [
        (1, r": channels\.face: must be an object"),
        ({"kind": "odd"}, r": channels\.face\.kind: must be one of plain, target, normal, not 'odd'"),
        ({"kind": "plain"}, r": channels\.face\.table: missing"),
        (WAITING_ONLY | {"tables": {}}, r": channels\.face\.tables: unknown field"),
        (_table({"a": 0.5}), r": channels\.face\.table\.waiting: must sum to 1, not 0\.5"),
        (_table({"a": -1, "b": 2}), r": channels\.face\.table\.waiting\.a: must be finite and at least 0"),
        (_table({"a": 1}, "target"), r": channels\.face\.table: must have a probability of 'none'"),
        (WAITING_ONLY, r"\.channels\.face: nothing is said of 'mistake'"),
        (
            {"kind": "plain", "table": {"waiting": {"a": 1}, "mistake": {"b": 1}}},
            r": channels\.face\.table\.mistake: must have a probability of a",
        ),
        (
            NUMBER | {"sd": {"waiting": 0}},
            r": channels\.face\.sd\.waiting: must be finite and above 0, not 0",
        ),
        (NUMBER | {"sd": {"mistake": 1}}, r": channels\.face\.sd: must have the mental states of mean"),
        (BY_ROLE, r": channels\.face\.target: 'face' is no channel about a target"),
    ],
)
def test_what_is_wrong_with_a_channel_is_named(channel: Any, message: str) -> None:
    with pytest.raises(ModelError, match=rf"^observation{message}"):
        _load(channels={"face": channel})


def test_a_channel_about_targets_needs_a_world_that_knows_their_roles() -> None:
    world, model = menu()
    table = {state: dict.fromkeys(ROLES, 0.25) for state in model.mental_states}
    model = replace(model, observation=ObservationModel(channels={"gaze": TargetChannel(table)}))
    with pytest.raises(
        ModelError, match=r"channels\.gaze: this world says nothing of roles: it needs a method"
    ):
        Observer(world, model)


def test_a_role_that_the_table_lacks_is_named() -> None:
    table = {state: {"mov": 0.5, "none": 0.5} for state in STATES}
    model = replace(INTUITIVE, observation=ObservationModel(channels={"gaze": TargetChannel(table)}))
    with pytest.raises(
        ModelError, match=r"gaze: the world knows a role '(wrt|other)', the table only mov, none"
    ):
        Observer(BallWorld(), model)


@pytest.mark.parametrize(
    ("signals", "message"),
    [
        ({"gaze": "4"}, r"^step 1: signals\.gaze: '4' is none of 1, 2, 3, none$"),
        ({"gaze": 1.0}, r"^step 1: signals\.gaze: 1\.0 is none of 1, 2, 3, none$"),
        ({"loudness": "high"}, r"^step 1: signals\.loudness: must be a finite number, not 'high'$"),
        ({"loudness": math.nan}, r"^step 1: signals\.loudness: must be a finite number, not nan$"),
    ],
)
def test_a_value_that_a_channel_cannot_have_is_named_with_its_step(signals: Any, message: str) -> None:
    model = gazing()
    loud = NormalChannel(dict.fromkeys(STATES, 0.0), dict.fromkeys(STATES, 1.0))
    channels = {**model.observation.channels, "loudness": loud}
    model = replace(model, observation=ObservationModel(channels=channels))
    trial = Trial("a", BallWorld(), None, (Step(NOA, False), Step(NOA, False, signals=signals)))
    with pytest.raises(ValueError, match=message):
        observation_logs(trial, trial.world, model)


def test_drawn_observations_have_their_probabilities() -> None:
    """4000 draws: each share within four standard errors of its probability."""
    face = PlainChannel({state: {"smile": 0.3, "frown": 0.7} for state in STATES})
    channels = {**gazing().observation.channels, "face": face}
    model = replace(INTUITIVE, observation=ObservationModel(0.2, 0.1, channels))
    observer, rng, task = Observer(BallWorld(), model), np.random.default_rng(1), 5
    pressed, signals, table = observer.outcomes()
    for state in (0, 2):
        drawn = [observer.draw(task, state, rng) for _ in range(4000)]
        for key, shown, p in zip(pressed, signals, table[:, task, state], strict=True):
            share = sum(one == (key, shown) for one in drawn) / 4000
            assert share == pytest.approx(p, abs=4 * math.sqrt(p * (1 - p) / 4000) + 1e-12)


def test_drawn_numbers_have_the_mean_and_spread_of_the_role_looked_at() -> None:
    mean = {state: {"mov": 5.0, "wrt": -5.0, "other": 0.0} for state in STATES}
    sd = {state: {"mov": 0.5, "wrt": 1.0, "other": 2.0} for state in STATES}
    channels = {**gazing().observation.channels, "angle": NormalChannel(mean, sd, target="gaze")}
    model = replace(INTUITIVE, observation=ObservationModel(channels=channels))
    world, rng = BallWorld(), np.random.default_rng(2)
    observer, task = Observer(world, model), 0
    drawn = [observer.draw(task, 0, rng)[1] for _ in range(4000)]
    roles = world.roles(world.tasks[task])
    assert all(("angle" in shown) == (shown["gaze"] != "none") for shown in drawn)
    for ball, role in roles.items():
        angles = np.array([float(shown["angle"]) for shown in drawn if shown["gaze"] == ball])
        spread = sd["waiting"][role]
        assert angles.mean() == pytest.approx(mean["waiting"][role], abs=4 * spread / math.sqrt(len(angles)))
        assert angles.std() == pytest.approx(spread, rel=4 / math.sqrt(2 * len(angles)))
