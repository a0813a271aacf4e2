"""The figure of calibration: said against right, what each threshold comes to, and how long it takes."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullLocator

from learn.calibration import ENOUGH, Calibration
from learn.plots import style_of, styled

MARKS = "os^Dv*"
SURE = 0.8  # thresholds below are not drawn
TICKS = (0.8, 0.95, 0.98, 0.995, 0.999, 0.9999)


@styled
def calibration_figure(found: Mapping[str, Mapping[str, Calibration]]) -> Figure:
    """A row of three panels for each place, such as the logs and the closed loop: a curve for each model.

    Left, the reliability diagram, each range's share right with its 95% interval. Middle, the share
    right when a trial first passed a threshold; above the grey line it is as often right as it says, or
    oftener. Right, the mean time to that moment.
    """
    figure = Figure(figsize=(11.2, 3.5 * len(found) + 0.2))
    grid = figure.subplots(len(found), 3, squeeze=False)
    for row, (place, judged) in zip(grid, found.items(), strict=True):
        _reliability(row[0], judged)
        _thresholds(row[1], judged, "right")
        _thresholds(row[2], judged, "seconds")
        row[0].set_title(f"{place}: every moment")
        row[1].set_title("when it was first that sure")
        row[2].set_title("seconds until then")
    return figure


def _reliability(ax: Axes, judged: Mapping[str, Calibration]) -> None:
    ax.plot([0, 1], [0, 1], color="0.7", linewidth=1, zorder=0)
    for place, (arm, one) in enumerate(judged.items()):
        said, right, low, high = (
            np.array([row[key] for row in one.rows]) for key in ("said", "right", "low", "high")
        )
        style = {"marker": MARKS[place % len(MARKS)], "markersize": 4, "linewidth": 1.4, **style_of(place)}
        bars = np.maximum([right - low, high - right], 0)
        ax.errorbar(said, right, yerr=bars, label=arm, capsize=2, elinewidth=0.9, **style)
    ax.set_xlim(0, 1.02)
    ax.set_ylim(0, 1.02)
    ax.set_xlabel("probability said of the likeliest task")
    ax.set_ylabel("share right")
    ax.legend(*ax.get_legend_handles_labels(), loc="upper left")


def _thresholds(ax: Axes, judged: Mapping[str, Calibration], what: str) -> None:
    lowest = []
    for place, one in enumerate(judged.values()):
        rows = [r for r in one.curve if r["threshold"] >= SURE and r["passed"] >= ENOUGH * one.trials]
        if not rows:
            continue
        keys = ("threshold", what, f"{what}_low", f"{what}_high")
        asked, value, low, high = (np.array([row[key] for row in rows]) for key in keys)
        ax.fill_between(1 - asked, low, high, color=style_of(place)["color"], alpha=0.13, linewidth=0)
        ax.plot(1 - asked, value, linewidth=1.8, **style_of(place))
        lowest.append(low.min())
    ax.set_xscale("log")
    ax.invert_xaxis()
    _ticks(ax, max(row["threshold"] for one in judged.values() for row in one.curve))
    ax.set_xlabel("threshold")
    if what == "seconds":
        ax.set_ylim(bottom=0)
        return
    doubt = np.geomspace(1 - SURE, 1e-5, 200)
    ax.plot(doubt, 1 - doubt, color="0.7", linewidth=1, zorder=0)
    goal = next(iter(judged.values())).needed.goal
    ax.axhline(goal, color="0.5", linewidth=0.9, linestyle=":", zorder=0)
    ax.set_ylim(max(0.0, min([*lowest, SURE]) - 0.02), 1.005)
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{100 * value:g}%"))
    for place, one in enumerate(judged.values()):
        if SURE <= one.needed.threshold < 1:
            mark = {"marker": MARKS[place % len(MARKS)], "color": style_of(place)["color"]}
            ax.plot([1 - one.needed.threshold], [goal], markersize=7, markeredgecolor="white", **mark)


def _ticks(ax: Axes, most: float) -> None:
    end = most if SURE < most < 1 else 1 - 1e-5
    shown = [tick for tick in TICKS if tick <= end]
    ax.set_xlim(1 - SURE, (1 - end) * 0.9)
    ax.set_xticks([1 - tick for tick in shown], [f"{tick:.10g}" for tick in shown])
    ax.xaxis.set_minor_locator(NullLocator())


def calibration_rows(found: Mapping[str, Mapping[str, Calibration]]) -> list[dict[str, Any]]:
    """The numbers of the left panels: one row for each place, model and range."""
    return _rows(found, "rows")


def threshold_rows(found: Mapping[str, Mapping[str, Calibration]]) -> list[dict[str, Any]]:
    """The numbers of the other panels: one row for each place, model and threshold."""
    return _rows(found, "curve")


def _rows(found: Mapping[str, Mapping[str, Calibration]], what: str) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = []
    for place, judged in found.items():
        for arm, one in judged.items():
            of_arm: Sequence[dict[str, Any]] = getattr(one, what)
            rows += [{"where": place, "model": arm, **row} for row in of_arm]
    return rows
