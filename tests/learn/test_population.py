"""A population: what it gives of teachers met and not met, its file, its errors."""

import json
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from taught import WORLD, operator_trials

from learn import FitError, Population, fit, fit_population, log_likelihood
from learn.held_out_teachers import POOLED, SEPARATE, UPDATED, held_out_teachers
from learn.population import ALIKE
from learn.population_study import drawn_teachers, median_teacher
from taskcomm.robot import Robot
from taskcomm.teacher import ModelError, TeacherModel
from taskcomm.trials import Trial

TEACHERS, EACH = 5, 2


def taught_by(teachers: Sequence[TeacherModel], each: int) -> tuple[Trial, ...]:
    """Simulated: trials of every teacher with the scripted operator."""
    taught = []
    for number, teacher in enumerate(teachers):
        for trial in operator_trials(each, teacher, seed=number):
            name = f"{number}-{trial.trial_id}"
            taught.append(replace(trial, trial_id=name, participant_id=f"teacher {number}"))
    return tuple(taught)


@cache
def trials() -> tuple[Trial, ...]:
    """Trials of five teachers who differ."""
    return taught_by(drawn_teachers(TEACHERS, 0.5, np.random.default_rng(7)), EACH)


@cache
def population() -> Population:
    return fit_population(trials(), WORLD, starts=1, draws=100, most_rounds=10)


def own(number: int) -> list[Trial]:
    return [trial for trial in trials() if trial.participant_id == f"teacher {number}"]


def test_a_teacher_who_was_not_met_is_the_mean_teacher() -> None:
    assert population().teacher([]) == population().model


@pytest.mark.parametrize("number", range(TEACHERS))
def test_own_trials_are_likelier_under_the_updated_teacher_than_under_the_mean_one(number: int) -> None:
    """The prior is greatest at the mean, so the posterior's mode owes its place to the likelihood."""
    updated = population().teacher(own(number))
    assert log_likelihood(own(number), WORLD, updated) > log_likelihood(
        own(number), WORLD, population().model
    )


def test_teachers_of_the_fit_and_teachers_met_again_are_the_same() -> None:
    for number, teacher in enumerate(population().teachers):
        assert teacher.name == f"teacher {number}"
        assert (teacher.trials, teacher.presses) == (EACH, sum(int(t.presses.sum()) for t in own(number)))
        again = population().space.point(population().teacher(own(number)))
        there = population().space.point(teacher.model)
        assert np.abs((again - there) / population().normal.spread).max() < 0.02


def test_what_is_known_of_a_teacher_grows_with_the_trials_and_the_prior_fades() -> None:
    many = operator_trials(40, drawn_teachers(1, 0.8, np.random.default_rng(3))[0], seed=11)
    truth = population().space.point(drawn_teachers(1, 0.8, np.random.default_rng(3))[0])
    peaks = slice(0, 4)
    away = [
        np.abs(population().space.point(population().teacher(many[:n])) - truth)[peaks].sum() for n in (0, 40)
    ]
    assert away[1] < away[0] / 2


def test_trials_are_foreseen_as_averages_over_the_population_say() -> None:
    """Against a plain Monte Carlo average of the likelihood over teachers drawn from the population."""
    space, normal = population().space, population().normal
    rng = np.random.default_rng(0)
    points = normal.mean + rng.standard_normal((1500, len(normal.mean))) @ normal.root.T
    logs = space.own(own(0)).values(points)
    plain = np.exp(logs - logs.max())
    error = plain.std() / plain.mean() / np.sqrt(len(plain))
    expected = logs.max() + np.log(plain.mean())
    assert abs(population().log_predictive(own(0)) - expected) < 4 * error + 0.05


def test_the_order_of_trials_makes_no_difference() -> None:
    quick: dict[str, Any] = {"starts": 1, "search": False, "draws": 20, "most_rounds": 2}
    one, other = (fit_population(given, WORLD, **quick) for given in (trials(), trials()[::-1]))
    assert one.to_dict() == other.to_dict()


def test_a_population_file_gives_the_same_population(tmp_path: Path) -> None:
    population().save(tmp_path / "p.json")
    again = Population.load(tmp_path / "p.json")
    assert json.dumps(again.to_dict()) == json.dumps(population().to_dict())
    assert (again.model, again.pooled) == (population().model, population().pooled)
    assert again.teacher(own(1)) == population().teacher(own(1))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema": "taskcomm.population/9"}, "schema: this version reads"),
        ({"mean": [0.0]}, "mean, covariance: must be of 10 coordinates"),
        ({"space": None}, "not a population"),
        ({"covariance": [[0.0]]}, "not a population"),
    ],
)
def test_a_malformed_file_is_named_with_what_is_wrong(
    tmp_path: Path, change: dict[str, object], message: str
) -> None:
    path = tmp_path / "p.json"
    path.write_text(json.dumps(population().to_dict() | change))
    with pytest.raises(ModelError, match=message) as caught:
        Population.load(path)
    assert str(path) in str(caught.value)


def test_what_is_missing_from_a_file_or_no_json_is_named(tmp_path: Path) -> None:
    path = tmp_path / "p.json"
    path.write_text(json.dumps({k: v for k, v in population().to_dict().items() if k != "path"}))
    with pytest.raises(ModelError, match="path: missing"):
        Population.load(path)
    path.write_text("{")
    with pytest.raises(ModelError, match="not JSON"):
        Population.load(path)


def test_a_robot_takes_the_updated_teacher() -> None:
    robot = Robot(WORLD, population().teacher(own(2)))
    robot.reset(np.random.default_rng(0))
    assert robot.model.provenance["trials"] == EACH


def test_a_fit_broken_off_says_so_and_rounds_are_counted() -> None:
    seen: list[tuple[int, int]] = []
    quick: dict[str, Any] = {"starts": 1, "search": False, "draws": 20, "most_rounds": 2}
    found = fit_population(trials(), WORLD, progress=lambda *at: seen.append(at), **quick)
    assert not found.converged
    assert found.status == "not converged: still moving after 2 rounds"
    assert len(found.path) == 2
    assert seen == [(1, 2), (2, 2)]


def test_trials_of_one_teacher_and_too_few_for_a_full_covariance_are_refused() -> None:
    with pytest.raises(FitError, match=r"at least two teachers .* all of teacher 3"):
        fit_population(own(3), WORLD)
    with pytest.raises(FitError, match="5 teachers are too few for the full covariance of 10"):
        fit_population(trials(), WORLD, starts=1, search=False, max_iter=2, full=True)
    with pytest.raises(FitError, match="no trials: a population needs at least one"):
        fit_population([], WORLD)


def test_trials_that_a_population_cannot_be_applied_to_are_refused() -> None:
    with pytest.raises(FitError, match=r"dt = 0\.25 s in the trials"):
        population().teacher([replace(own(0)[0], dt=0.25)])
    with pytest.raises(FitError, match="trials of 2 teachers, teacher 1, teacher 3: one at a time"):
        population().teacher([*own(3), *own(1)])
    with pytest.raises(ValueError, match="estimate: must be"):
        population().teacher(own(0), estimate="median")  # type: ignore[arg-type]


def test_held_out_teachers_are_met_trial_by_trial() -> None:
    quick = {"draws": 20, "most_rounds": 2}
    found = held_out_teachers(trials(), folds=2, population=quick, starts=1, search=False, max_iter=10)
    assert found.met.tolist() == [0, 1] * TEACHERS
    assert set(found.arms) == {POOLED, UPDATED, "population, averaged", SEPARATE}
    for arm, values in found.log_likelihood.items():
        assert (values < 0).all(), arm
    first = found.met == 0
    np.testing.assert_array_equal(found.log_likelihood[SEPARATE][first], found.log_likelihood[POOLED][first])
    assert (found.log_likelihood[SEPARATE] != found.log_likelihood[POOLED])[~first].all()
    assert found.gain(UPDATED, 1).groups == TEACHERS
    assert found.gain(POOLED).estimate == 0
    assert [row["known"] for row in found.rows()] == found.met.tolist()


def test_a_shared_delay_is_one_coordinate() -> None:
    pooled = fit(trials(), WORLD, median_teacher(), starts=1, search=False, max_iter=5, delays="shared")
    found = fit_population(trials(), WORLD, pooled=pooled, draws=20, most_rounds=1)
    assert [each.name for each in found.common][-1] == "delay"
    assert found.space.settings.shared == ("delay",)
    again = Population.from_dict(json.loads(json.dumps(found.to_dict())))
    assert again.space.names == found.space.names
    assert len({top.delay for top in again.teacher(own(0)).approvals.values()}) == 1


def test_trials_without_a_participant_are_teachers_of_their_own_who_may_vary_together() -> None:
    nobody = [replace(trial, participant_id=None) for trial in trials()]
    quick: dict[str, Any] = {"starts": 1, "search": False, "draws": 20, "most_rounds": 2}
    found = fit_population(nobody, WORLD, full=True, **quick)
    assert [teacher.name for teacher in found.teachers] == sorted(f"trial {t.trial_id}" for t in nobody)
    aside = found.normal.covariance - np.diag(np.diag(found.normal.covariance))
    assert np.abs(aside).max() > 1e-3
    assert np.linalg.eigvalsh(found.normal.covariance).min() > 0


@pytest.mark.verify
def test_a_population_is_recovered_from_simulated_trials() -> None:
    """Means and spreads within three of their own standard errors, where the data say anything."""
    taught = taught_by(drawn_teachers(40, 0.6, np.random.default_rng(0)), 5)
    found = fit_population(taught, WORLD, starts=3)
    truth = found.space.point(median_teacher())
    assert found.converged
    for each, middle in zip(found.common, truth, strict=True):
        assert abs(each.mean - middle) < 3 * each.mean_error, each
        assert abs(np.log(each.spread / 0.6)) < 3 * each.spread_error, each
    assert sum(each.mark == ALIKE for each in found.common) <= 6
    assert found.log_marginal > found.pooled_log_likelihood + 20


@pytest.mark.verify
def test_teachers_who_are_alike_are_mostly_found_so() -> None:
    taught = taught_by(drawn_teachers(20, 0.0, np.random.default_rng(0)), 4)
    found = fit_population(taught, WORLD, starts=3)
    assert sum(each.mark == ALIKE for each in found.common) >= 8
