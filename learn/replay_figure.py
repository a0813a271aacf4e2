"""The figure of one replayed trial: what the robot believed, when, and why each press was made.

Source: the paper, figures of the task marginals, of the mistake recovery, and of the inference.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from learn.plots import COLOURS, axes_or_new, styled
from taskcomm.replay import BeliefPath, PressReason

PLAIN = {"waiting": "0.75", "mistake": "0.25"}  # what is no approval has no colour
NAMES = {"mov": "ball to move", "wrt": "with respect to ball", "dist": "at distance"}


@styled
def marginal_over_time(
    path: BeliefPath, field: str | None, ax: Axes | None = None, truth: Any = None
) -> Axes:
    """P(one part of the task) over time; the true value bold. With no field, the likeliest tasks."""
    ax = axes_or_new(ax, 7, 2)
    if field is None:
        most = np.argsort(-path.marginal.max(axis=0), kind="stable")[:6]
        columns = {path.world.tasks[index]: path.marginal[:, index] for index in sorted(most)}
    else:
        columns = path.marginal_of(field)
    for place, (value, column) in enumerate(columns.items()):
        right = truth is not None and value == truth
        ax.plot(
            path.time,
            column,
            color=COLOURS[place % len(COLOURS)],
            linestyle="-" if right or truth is None else "--",
            linewidth=2.4 if right else 1.2,
            label=f"{value} (true)" if right else str(value),
        )
    mark_presses(path, ax)
    ax.set_ylim(-0.02, 1.05)
    ax.set_ylabel("probability")
    ax.set_title("task" if field is None else NAMES.get(field, field))
    ax.legend(loc="center left", bbox_to_anchor=(1.01, 0.5))
    return ax


def mark_presses(path: BeliefPath, ax: Axes) -> None:
    """A vertical line at every press, a pale band over every step whose key was not recorded."""
    for time in path.press_times:
        ax.axvline(time, color="0.45", linewidth=0.9, zorder=0)
    for step in np.flatnonzero(~path.recorded):
        ax.axvspan(path.time[step], path.time[step + 1], color="0.9", linewidth=0, zorder=-1)
    ax.set_xlim(0, path.time[-1] if len(path.time) > 1 else 1)


@styled
def entropy_of_path(path: BeliefPath, ax: Axes | None = None) -> Axes:
    """Entropy of the belief over tasks, in nats, over time."""
    ax = axes_or_new(ax, 7, 2)
    ax.plot(path.time, path.entropy, color="black", linewidth=1.6)
    mark_presses(path, ax)
    ax.set_ylim(bottom=0)
    ax.set_ylabel("nats")
    ax.set_title("entropy of the task")
    return ax


@styled
def signals_over_time(path: BeliefPath, channel: str, ax: Axes | None = None) -> Axes:
    """What one channel showed in each step: values as rows of dots, numbers as dots alone."""
    ax = axes_or_new(ax, 7, 1)
    seen = [
        (at, value)
        for at, value in zip(path.time[1:], path.signals[channel], strict=True)
        if value is not None
    ]
    times, shown = [at for at, _ in seen], [value for _, value in seen]
    if any(isinstance(value, str) for value in shown):
        values = sorted({str(value) for value in shown})
        shown = [values.index(str(value)) for value in shown]
        ax.set_yticks(range(len(values)), values)
        ax.set_ylim(-0.6, len(values) - 0.4)
        ax.invert_yaxis()
    ax.plot(times, shown, linestyle="", marker="o", markersize=3.5, color=COLOURS[0])
    mark_presses(path, ax)
    ax.set_title(f"signal: {channel}")
    return ax


@styled
def reasons_of_presses(reasons: Sequence[PressReason], ax: Axes | None = None) -> Axes:
    """For each press, P(mental state) at once (left bar) and with the whole trial known (right bar)."""
    ax = axes_or_new(ax, 7, 2)
    states = list(reasons[0].at_end) if reasons else []
    colours = [PLAIN[state] for state in states if state in PLAIN] + list(COLOURS)
    for place, state in enumerate(states):
        for shift, when in ((-0.2, "at_once"), (0.2, "at_end")):
            heights = [getattr(reason, when)[state] for reason in reasons]
            below = [sum(getattr(reason, when)[s] for s in states[:place]) for reason in reasons]
            ax.bar(
                np.arange(len(reasons)) + shift,
                heights,
                width=0.36,
                bottom=below,
                color=colours[place % 8],
                alpha=0.55 if when == "at_once" else 1.0,
                label=state if when == "at_end" else None,
            )
    noted = len(reasons) <= 12 and any(reason.noted is not None for reason in reasons)
    labels = [f"{reason.time:g} s" + (f"\n{reason.noted}" if noted else "") for reason in reasons]
    ax.set_xticks(range(len(reasons)), labels, fontsize=9 if len(reasons) < 8 else 7.5)
    if len(reasons) > 16:
        ax.tick_params(axis="x", labelrotation=90)
    ax.set_xlim(-0.6, max(len(reasons), 1) - 0.4)
    ax.set_ylim(0, 1.02)
    ax.set_yticks([0, 0.5, 1])
    ax.set_ylabel("probability")
    more = "; below, the true reason" if noted else ""
    ax.set_title(f"why it was pressed: as believed then (pale), at the end (full){more}")
    if states:
        ax.legend(loc="center left", bbox_to_anchor=(1.01, 0.5))
    return ax


@styled
def replay_figure(
    path: BeliefPath, reasons: Sequence[PressReason], truth: Any = None, title: str = ""
) -> Figure:
    """Marginals, entropy, signals and reasons of presses of one trial, one above the other."""
    fields: tuple[str | None, ...] = path.fields or (None,)
    above = len(fields) + 1 + len(path.signals)
    panels = above + bool(reasons)
    figure = Figure(figsize=(8.6, 1.75 * panels + 0.4))
    axes = figure.subplots(panels, 1, squeeze=False)[:, 0]
    for ax, field in zip(axes, fields, strict=False):
        part = truth if field is None or truth is None else getattr(truth, field)
        marginal_over_time(path, field, ax, part)
    entropy_of_path(path, axes[len(fields)])
    for ax, channel in zip(axes[len(fields) + 1 :], path.signals, strict=False):
        signals_over_time(path, channel, ax)
    gaps = "" if path.recorded.all() else "; bands: key not recorded"
    axes[above - 1].set_xlabel(f"seconds (grey lines: presses{gaps})")
    if reasons:
        reasons_of_presses(reasons, axes[-1])
    if title:
        figure.suptitle(title, fontsize=11, x=0.01, ha="left")
    return figure
