"""Time to the first press after a cue came on, as it was and as models expect it."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from cuestudy import TRUE, WORLD, cue_trials

from learn import FitError, log_likelihood
from learn.freebins import bernoulli
from learn.plots import save
from learn.survival import Waits, press_probability, waits_after, waits_figure
from taskcomm.trials import Step, Trial


def trial_of(light: str, presses: str) -> Trial:
    """One character a step: light 0 or 1; press 0, 1, or ? where it was not recorded."""
    steps = [
        Step(WORLD.show(["light"] if on == "1" else []), None if press == "?" else press == "1")
        for on, press in zip(light, presses, strict=True)
    ]
    return Trial("t", WORLD, WORLD.tasks[0], tuple(steps))


def waits(*trials: Trial) -> Waits:
    found = waits_after(trials, "light")
    assert found is not None
    return found


@pytest.mark.parametrize(
    ("light", "presses", "steps", "pressed"),
    [
        ("0111", "0001", [3], [True]),
        ("0111", "0000", [3], [False]),  # the trial ends
        ("0110", "0001", [2], [False]),  # the light goes off before the press
        ("1101", "0101", [2, 1], [True, True]),  # on from the start; every onset counts
        ("1111", "0110", [2], [True]),  # what follows the first press does not
        ("0111", "10?1", [1], [False]),  # the key was not recorded
        ("0111", "0?11", [], []),
    ],
)
def test_a_wait_lasts_to_the_first_press_or_to_where_nothing_more_is_known(
    light: str, presses: str, steps: list[int], pressed: list[bool]
) -> None:
    found = waits_after([trial_of(light, presses)], "light")
    assert (found is None) == (not steps)
    if found is not None:
        assert found.steps.tolist() == steps
        assert found.pressed.tolist() == pressed


def test_a_cue_that_never_came_on_has_no_waits() -> None:
    assert waits_after([trial_of("000", "010")], "light") is None


def test_the_observed_curve_is_the_product_of_the_shares_that_did_not_press() -> None:
    found = waits(*cue_trials())
    seconds, share, low, high = found.curve()
    expected, survived = [], 1.0
    for step in range(1, int(found.steps.max()) + 1):
        at_risk = int((found.steps >= step).sum())
        survived *= 1 - int(((found.steps == step) & found.pressed).sum()) / at_risk
        if (found.steps == step).any():
            expected.append(survived)
    assert seconds == pytest.approx(np.unique(found.steps) * 0.5)
    assert share == pytest.approx(expected)
    inside = np.isfinite(low)
    assert (low[inside] <= share[inside]).all()
    assert (share[inside] <= high[inside]).all()


def test_presses_of_one_constant_probability_are_expected_to_wait_geometrically() -> None:
    found = waits(*cue_trials())
    _, without = found.expected([np.full(trial.num_steps, 0.2) for trial in cue_trials()])
    assert without == pytest.approx(0.8 ** np.arange(1, len(without) + 1))


def test_the_probabilities_of_the_steps_make_up_the_likelihood() -> None:
    trials = cue_trials()[:3]
    total = sum(bernoulli(press_probability(trial, TRUE), trial) for trial in trials)
    assert total == pytest.approx(log_likelihood(trials, WORLD, TRUE))


def test_the_true_teacher_is_expected_to_wait_as_long_as_was_seen() -> None:
    trials = cue_trials(60, 60, 6, seed=5)
    for cue in WORLD.cue_names:
        found = waits_after(trials, cue)
        assert found is not None
        seconds, share, _, _ = found.curve()
        time, without = found.expected([press_probability(trial, TRUE) for trial in trials])
        at = np.searchsorted(time, seconds - 1e-9)
        early = seconds <= 5.0
        assert np.abs(share - without[at])[early].max() < 1.36 / np.sqrt(len(found.steps))  # Kolmogorov, 5%


def test_the_figure_has_a_panel_for_each_cue_and_its_numbers_beside_it(tmp_path: Path) -> None:
    trials, accounts = cue_trials()[:6], {"true": partial(press_probability, model=TRUE)}
    figure, rows = waits_figure(trials, accounts)
    titles = [ax.get_title(loc="left") for ax in figure.axes]
    assert [title.split(":")[0] for title in titles] == ["light (simulated)", "tone (simulated)"]
    assert {(row["cue"], row["account"]) for row in rows} == {
        (cue, account) for cue in WORLD.cue_names for account in ("observed", "true")
    }
    save(figure, tmp_path / "waits.png", rows)
    assert (tmp_path / "waits.csv").read_text().startswith("cue,account,seconds,share,low,high\n")
    only = [replace(trial_of("0111", "0001"), trial_id=str(n)) for n in range(2)]
    assert len(waits_figure(only, accounts)[0].axes) == 1
    with pytest.raises(FitError, match="no cue ever came on"):
        waits_figure([trial_of("000", "010")], accounts)
