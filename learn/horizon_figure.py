"""The figure of what looking further came to: time, right, against the paper's horizon, and what it costs."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from learn.horizon_summary import Arm, Row
from learn.plots import style_of, styled

MARKS = "os^D"
CUT = 1.8  # ratios above are written, not drawn


@styled
def horizon_figure(found: Sequence[Row]) -> Figure:
    """Mean time to Final, share right, time against one horizon, and planning time, by how far robots look.

    `found` is a `summary`. Bars are its 95% intervals; in the last panel they run from the median to the 99th
    percentile of the decisions.
    """
    figure = Figure(figsize=(9.4, 6.6))
    grid = figure.subplots(2, 2, sharex=True)
    modes = sorted({row["mode"] for row in found}, key=lambda mode: Arm("", mode).place)
    models = list(dict.fromkeys(row["model"] for row in found))
    for number, model in enumerate(models):
        rows = [row for row in found if row["model"] == model]
        shift = 0.16 * (number - (len(models) - 1) / 2)
        x = np.array([modes.index(row["mode"]) for row in rows]) + shift
        style = {"marker": MARKS[number % len(MARKS)], "markersize": 6, "capsize": 3, **style_of(number)}
        style |= {"label": model, "linewidth": 1.4}
        for ax, what in zip(grid.flat, ("time", "correct", "time_ratio", "planning"), strict=True):
            _bars(ax, x, rows, what, style)
    _dress(grid, found, modes)
    trials = sorted({row["trials"] for row in found})
    counted = f"{trials[0]}" if len(trials) == 1 else f"{trials[0]} to {trials[-1]}"
    figure.suptitle(
        f"Does looking further help? Simulated teachers, {counted} trials a robot",
        fontsize=12,
        x=0.01,
        ha="left",
    )
    return figure


def _bars(ax: Axes, x: Any, rows: Sequence[Row], what: str, style: Mapping[str, Any]) -> None:
    """One model's arms; a line joins horizons, none leads to a deadline."""
    ends = ("_median", "_median", "_p99") if what == "planning" else ("", "_low", "_high")
    values = np.array([[row.get(what + end) for end in ends] for row in rows], dtype=np.float64)
    if what == "time_ratio":
        _write_cut(ax, x, values[:, 0], style)
        values[values[:, 0] > CUT, 1:] = np.nan  # no bar where the mark itself is out of sight
    middle, low, high = values.T
    bars = np.maximum([middle - low, high - middle], 0)
    ax.errorbar(x, middle, yerr=bars, **{**style, "linestyle": "none"})
    steps = np.array([Arm("", row["mode"]).deadline is None for row in rows])
    ax.plot(x[steps], middle[steps], color=style["color"], linestyle=style["linestyle"], linewidth=1.2)


def _write_cut(ax: Axes, x: Any, ratios: Any, style: Mapping[str, Any]) -> None:
    line = MARKS.index(style["marker"])
    look = {"color": style["color"], "backgroundcolor": "white", "zorder": 5, "ha": "center", "va": "top"}
    for place in np.flatnonzero(ratios > CUT):
        text, at = f"{ratios[place]:.1f} \N{UPWARDS ARROW}", (round(x[place]), CUT)
        ax.annotate(text, at, (0, -3 - 13 * line), textcoords="offset points", **look)


def _dress(grid: Any, found: Sequence[Row], modes: Sequence[str]) -> None:
    (time, right), (ratio, planning) = grid
    against = " or ".join(sorted({row["against"] for row in found}))
    time.set_title("Seconds to Final; a timeout counts at its length")
    right.set_title("Share of trials in which Final was right")
    ratio.set_title(f"Time, divided by that of looking {against} steps ahead")
    planning.set_title("A decision's share of the time step: median, 99%")
    time.set_ylim(bottom=0)
    right.set_ylim(min(0.5, right.get_ylim()[0]), 1.02)
    right.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.0%}"))
    lowest = [row["time_ratio_low"] for row in found if row.get("time_ratio_low") is not None]
    ratio.set_ylim(0.95 * min([*lowest, 0.9]), CUT)
    planning.set_yscale("log")
    planning.yaxis.set_major_formatter(
        FuncFormatter(lambda value, _: f"{value:.3%}".rstrip("0%").rstrip(".") + "%")
    )
    for ax in (ratio, planning):
        ax.axhline(1, color="0.6", linewidth=0.8, zorder=0)
    time.legend(*time.get_legend_handles_labels(), loc="upper right")
    timed = any(Arm("", mode).deadline is not None for mode in modes)
    for ax in grid[1]:
        ax.set_xticks(range(len(modes)), [_label(mode, found) for mode in modes])
        ax.set_xlim(-0.5, len(modes) - 0.5)
        ax.set_xlabel("steps looked ahead" + (" (by a deadline: median reached)" if timed else ""))


def _label(mode: str, found: Sequence[Row]) -> str:
    if Arm("", mode).deadline is None:
        return mode
    reached = [row["reached_median"] for row in found if row["mode"] == mode and row["decisions"]]
    steps = list(dict.fromkeys(f"{steps:g}" for steps in sorted(reached)))
    return f"in {mode.replace('s', ' s')}\n({' or '.join(steps) or '-'})"
