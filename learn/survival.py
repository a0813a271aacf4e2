"""Time from a cue's onset to the first press: as it was (Kaplan and Meier), and as models expect it."""

import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import CensoredData, ecdf

from learn.exposure import FitError
from learn.plots import axes_or_new, style_of, styled
from taskcomm.belief import Belief
from taskcomm.lattice import Bools, Floats, Ints
from taskcomm.smoother import cue_tables, index_of_task
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial

PressProbability = Callable[[Trial], Floats]
LEVEL = 0.95


@dataclass(frozen=True)
class Waits:
    """The onsets of one cue: how long until the first press, or until nothing more was seen.

    `trial` and `first` (onsets,) say where each began, `steps` how many steps were at risk, `pressed`
    whether the last of them had a press. A wait is censored where the cue goes off, the trial ends, or
    the key was not recorded. `sources` are those of the trials.
    """

    cue: str
    dt: float
    trial: Ints
    first: Ints
    steps: Ints
    pressed: Bools
    sources: tuple[str, ...] = ()

    def curve(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Kaplan and Meier's estimate: seconds, P(no press by then), and its 95% band (log-log).

        The band is nan where the estimate is 0 or 1.
        """
        seconds = np.asarray(self.steps * self.dt, dtype=np.float64)
        found = ecdf(CensoredData(uncensored=seconds[self.pressed], right=seconds[~self.pressed])).sf
        with np.errstate(divide="ignore", invalid="ignore"), warnings.catch_warnings():
            warnings.filterwarnings("ignore", "The confidence interval is undefined", RuntimeWarning)
            band: Any = found.confidence_interval(LEVEL, method="log-log")
        return found.quantiles, found.probabilities, band.low.probabilities, band.high.probabilities

    def expected(self, probabilities: Sequence[Floats]) -> tuple[Floats, Floats]:
        """What a model makes of the same onsets: seconds, and P(no press by then).

        `probabilities[n]` (T,) are P(press | past) of the steps of trial n. The hazard of the k-th step is
        their mean over the onsets still at risk in it, as Kaplan and Meier's is the share of presses.
        """
        longest = int(self.steps.max())
        hazard, at_risk = np.zeros(longest), np.zeros(longest)
        for trial, first, steps in zip(self.trial, self.first, self.steps, strict=True):
            hazard[:steps] += probabilities[trial][first : first + steps]
            at_risk[:steps] += 1
        seconds = np.arange(1, longest + 1, dtype=np.float64) * self.dt
        return seconds, np.asarray(np.cumprod(1 - hazard / at_risk), dtype=np.float64)


def waits_after(trials: Sequence[Trial], cue: str) -> Waits | None:
    """Every onset of a cue, at its first step; None if it never came on."""
    found: list[tuple[int, int, int, bool]] = []
    for number, trial in enumerate(trials):
        row = list(trial.world.cue_names).index(cue)
        task = index_of_task(trial, trial.world, trial.task)
        on = cue_tables(trial, trial.world, np.array([row]))[:, 0, task]
        edges = np.flatnonzero(np.diff(on.astype(np.int8), prepend=0, append=0))
        for first, end in edges.reshape(-1, 2):
            unseen = np.flatnonzero(~trial.recorded[first:end])
            end = first + unseen[0] if len(unseen) else end
            presses = np.flatnonzero(trial.presses[first:end])
            length = presses[0] + 1 if len(presses) else end - first
            if length:
                found.append((number, int(first), int(length), len(presses) > 0))
    if not found:
        return None
    numbers, first, steps, pressed = map(np.array, zip(*found, strict=True))
    sources = tuple(sorted({trial.source for trial in trials}))
    return Waits(cue, trials[0].dt, numbers, first, steps, pressed, sources)


def press_probability(trial: Trial, model: TeacherModel) -> Floats:
    """P(press | past) in every step of a trial under a teacher model, its task known: shape (T,)."""
    world = trial.world
    known = np.zeros(len(world.tasks))
    known[index_of_task(trial, world, trial.task)] = 1.0
    belief, probability = Belief.initial(world, model, known), np.empty(trial.num_steps)
    for t, (state, step) in enumerate(zip(trial.states, trial.steps, strict=True)):
        probability[t] = belief.press_probability(state)
        belief = belief.update(state, step.pressed, step.signals)
    return probability


@styled
def waits_figure(
    trials: Sequence[Trial], accounts: Mapping[str, PressProbability]
) -> tuple[Figure, list[dict[str, Any]]]:
    """A panel for each cue that came on: the share of onsets without a press by then, as observed and as
    each account expects it; and the numbers behind it, a row for each cue, account and time.

    Raises FitError where no cue ever came on.
    """
    cues = trials[0].world.cue_names
    panels = [waits for cue in cues if (waits := waits_after(trials, cue)) is not None]
    if not panels:
        raise FitError("no cue ever came on: there are no onsets to wait after")
    down, across = -(-len(panels) // 3), min(len(panels), 3)
    figure = Figure(figsize=(4.6 * across + 0.4, 3.6 * down))
    grid = figure.subplots(down, across, squeeze=False)
    probabilities = {name: [account(trial) for trial in trials] for name, account in accounts.items()}
    for ax, waits in zip(grid.ravel(), panels, strict=False):
        waits_axes(waits, probabilities, ax)
    for ax in grid.ravel()[len(panels) :]:
        ax.remove()
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower left", ncols=min(len(labels), 2 * across, 4))
    return figure, [row for waits in panels for row in _rows(waits, probabilities)]


@styled
def waits_axes(waits: Waits, probabilities: Mapping[str, Sequence[Floats]], ax: Axes | None = None) -> Axes:
    """One panel of `waits_figure`."""
    ax = axes_or_new(ax)
    seconds, share, low, high = (
        np.concatenate([[start], line]) for start, line in zip((0, 1, 1, 1), waits.curve(), strict=True)
    )
    ax.fill_between(seconds, low, high, step="post", color="0.85", linewidth=0, zorder=0)
    ax.step(seconds, share, where="post", color="0.35", linewidth=1.6, label="observed, with 95% band")
    for place, (name, of_trials) in enumerate(probabilities.items()):
        time, without = waits.expected(of_trials)
        ax.plot([0, *time], [1, *without], label=name, linewidth=1.8, ds="steps-post", **style_of(place))
    ax.set_xlim(0, float(seconds[-1]))
    ax.set_ylim(0, 1.02)
    ax.set_xlabel(f"seconds since {waits.cue} came on")
    ax.set_ylabel("share without a press")
    simulated = " (simulated)" if "simulated" in waits.sources else ""
    counted = f"{len(waits.steps)} onsets, {int(waits.pressed.sum())} of them answered"
    ax.set_title(f"{waits.cue}{simulated}: {counted}")
    return ax


def _rows(waits: Waits, probabilities: Mapping[str, Sequence[Floats]]) -> Iterator[dict[str, Any]]:
    for time, share, *band in zip(*map(np.ndarray.tolist, waits.curve()), strict=True):
        low, high = ("" if math.isnan(end) else end for end in band)
        yield _row(waits.cue, "observed", time, share, low, high)
    for name, of_trials in probabilities.items():
        for time, share in zip(*map(np.ndarray.tolist, waits.expected(of_trials)), strict=True):
            yield _row(waits.cue, name, time, share)


def _row(cue: str, account: str, seconds: float, share: float, *band: Any) -> dict[str, Any]:
    values = (cue, account, seconds, share, *(band or ("", "")))
    return dict(zip(("cue", "account", "seconds", "share", "low", "high"), values, strict=True))
