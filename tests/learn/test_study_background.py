"""Who took part, in which order, and how far annotators agree."""

from dataclasses import replace

import numpy as np
import pytest
from ratedstudy import labelled, of_condition, unrated

from learn.study_background import agreement_rows, answer_rows, background_sentences, orders
from learn.study_statistics import statistics_text
from taskcomm.trials import Trial


def judged(said: list[tuple[str, str]]) -> Trial:
    """A trial in which ann and bob label one press after another."""
    trial = next(trial for trial in unrated() if trial.presses.sum() >= len(said))
    steps = np.flatnonzero(trial.presses)[: len(said)]
    pairs = zip(steps, said, strict=True)
    return labelled(
        trial, *((int(t), s, who) for t, two in pairs for who, s in zip(("ann", "bob"), two, strict=True))
    )


def test_kappa_is_one_in_full_agreement_and_none_without_a_choice() -> None:
    (row,) = agreement_rows([judged([("mistake", "mistake"), ("that_mov", "that_mov")])])
    assert (row["first"], row["second"], row["presses"], row["agreed"], row["kappa"]) == (
        "ann",
        "bob",
        2,
        1.0,
        1.0,
    )
    (row,) = agreement_rows([judged([("mistake", "mistake")])])
    assert row["kappa"] is None


def test_kappa_is_agreement_above_chance() -> None:
    """7 of 10 agreed; one says a as often as b, the other six times in ten: chance is one half."""
    said = [("a", "a")] * 4 + [("a", "b")] + [("b", "a")] * 2 + [("b", "b")] * 3
    halves = [judged(said[:5]), replace(judged(said[5:]), trial_id="other")]
    (row,) = agreement_rows(halves)
    assert row["presses"] == 10
    assert row["agreed"] == pytest.approx(0.7)
    assert row["kappa"] == pytest.approx(0.4)


def test_orders_count_teachers_by_the_place_of_their_trials() -> None:
    found = orders(unrated())
    assert sum(found.values()) == 22
    assert set(found) == {("operator", "pomdp"), ("pomdp", "operator")}
    first = [trial for trial in unrated() if trial.trial_index == 0]
    assert found["pomdp", "operator"] == len(of_condition(first, "pomdp"))
    assert orders(list(reversed(unrated()))) == found
    assert orders(of_condition(unrated(), "pomdp")) == {}


def test_what_there_is_is_said_and_what_there_is_not_is_not() -> None:
    assert background_sentences(of_condition(unrated(), "pomdp"), {}) == []
    ages = {"age": [18.0, 22.0, 26.0], "unanswered": []}
    assert [row["item"] for row in answer_rows(ages)] == ["age"]
    text = statistics_text(unrated(), ages)
    assert "Age: 18 to 26, mean 22.0, standard deviation 4.0 (n = 3)." in text
    assert "Order of conditions, teachers: operator, then pomdp: " in text
