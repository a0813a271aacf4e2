"""Figures of a recovery: the learning curve, errors by parameter, and learned models as robots."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, MultipleLocator, NullLocator

from learn.plots import style_of, styled
from learn.recovery import LOOP
from learn.recovery_robots import INTUITIVE, TRUE, Row

MARKS = "os^D"
WIDEST = 8.0  # factors beyond this are drawn at the edge
LOWEST = -2.5  # nats per trial against the intuitive model: what is lower is not drawn


@styled
def learning_curve(found: Sequence[Row]) -> Figure:
    """What learning gains over the intuitive model on fresh trials, by trials learned from; `curve_rows`.

    A closed loop is drawn without its intervals.
    """
    truths = list(dict.fromkeys(row["truth"] for row in found))
    figure = Figure(figsize=(max(5.4, 3.5 * len(truths) + 0.6), 3.9))
    panels = figure.subplots(1, len(truths), sharey=True, squeeze=False)[0]
    sources = list(dict.fromkeys(row["source"] for row in found))
    highest = 1.15 * max(max(row["gain_high"] for row in found), 0.2)
    lowest = max(LOWEST, 1.15 * min(min(row["gain_low"] for row in found), -0.2))
    for ax, truth in zip(panels, truths, strict=True):
        for place, source in enumerate(sources):
            rows = sorted(_where(found, truth=truth, source=source), key=lambda row: row["size"])
            if rows:
                _curve(ax, rows, place, len(sources))
        possible = _where(found, truth=truth)[0]["possible"]
        ax.axhline(possible, color="0.35", linewidth=1.0, linestyle=(0, (1, 1.5)), label="true model")
        ax.axhline(0, color="0.35", linewidth=1.0, label=None)
        ax.set_title(f"teachers: {truth}")
        ax.set_xscale("log")
        _sizes_axis(ax, sorted({row["size"] for row in _where(found, truth=truth) if row["source"] != LOOP}))
        ax.set_ylim(lowest, highest)
    panels[0].set_ylabel("nats per trial above the intuitive model")
    drawn = max((ax.get_legend_handles_labels() for ax in panels), key=lambda found: len(found[1]))
    panels[-1].legend(*drawn, loc="lower right", handlelength=2.4)
    figure.suptitle("What learning gains on fresh trials. Simulated", fontsize=12, x=0.01, ha="left")
    return figure


def _where(rows: Sequence[Row], **wanted: Any) -> list[Row]:
    return [row for row in rows if all(row[key] == value for key, value in wanted.items())]


def _curve(ax: Axes, rows: Sequence[Row], place: int, places: int) -> None:
    shift = 1 + 0.05 * (place - (places - 1) / 2)
    x = np.array([row["size"] for row in rows]) * shift
    gain, low, high = (np.array([row[name] for row in rows]) for name in ("gain", "gain_low", "gain_high"))
    style = {**style_of(place), "linewidth": 1.5, "marker": MARKS[place % 4], "markersize": 4.5, "capsize": 2}
    bars = (
        None if rows[0]["source"] == LOOP else [gain - low, high - gain]
    )  # of a loop, they are in the table
    ax.errorbar(x, gain, yerr=bars, elinewidth=0.9, label=rows[0]["source"], **style)


def _sizes_axis(ax: Axes, sizes: Sequence[int]) -> None:
    ax.xaxis.set_major_locator(FixedLocator(sizes))
    ax.xaxis.set_minor_locator(NullLocator())
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.0f}"))
    ax.set_xlabel("trials learned from")


@styled
def error_figure(found: Sequence[Row], truth: str) -> Figure:
    """Learned over true, by parameter and trials learned from; `parameter_rows` of one truth.

    Marks are medians over the studies, bars run from the 10th to the 90th percentile.
    """
    rows = _where(found, truth=truth)
    names = list(dict.fromkeys(row["parameter"] for row in rows))
    sources = list(dict.fromkeys(row["source"] for row in rows if row["source"] != LOOP))
    sizes = sorted({row["size"] for row in rows if row["source"] in sources})
    columns = 3 if len(names) > 4 else len(names)
    order = [*names[1:], names[0]]
    count = -(-len(order) // columns)
    figure = Figure(figsize=(3.1 * columns + 0.4, 1.9 * count + 0.9))
    grid = figure.subplots(count, columns, sharex=True, sharey=True, squeeze=False).ravel()
    for ax, name in zip(grid, order, strict=False):
        for place, source in enumerate(sources):
            _errors(ax, _where(rows, parameter=name, source=source), sizes, place, len(sources))
        ax.axhline(1, color="0.35", linewidth=0.9, zorder=0)
        ax.set_title(f"{name} ({rows[names.index(name)]['true']:g})")
        ax.set_yscale("log")
        ax.set_ylim(1 / WIDEST / 1.15, WIDEST * 1.15)
        ax.yaxis.set_major_locator(FixedLocator([1 / 8, 1 / 4, 1 / 2, 1, 2, 4, 8]))
        ax.yaxis.set_minor_locator(NullLocator())
        ax.yaxis.set_major_formatter(FuncFormatter(_factor))
        ax.set_xticks(range(len(sizes)), [str(size) for size in sizes])
        ax.set_xlim(-0.5, len(sizes) - 0.5)
    _close(figure, grid, len(order), columns, len(sources))
    figure.suptitle(
        f"Learned over true (odds or seconds), teachers: {truth}. Simulated", fontsize=12, x=0.01, ha="left"
    )
    return figure


def _factor(value: float, _place: object) -> str:
    return f"{value:g}" if value >= 1 else f"1/{1 / value:g}"


def _errors(ax: Axes, rows: Sequence[Row], sizes: Sequence[int], place: int, places: int) -> None:
    rows = [row for row in rows if np.isfinite(row["median_error"])]
    x = np.array([sizes.index(row["size"]) for row in rows]) + 0.2 * (place - (places - 1) / 2)
    middle, low, high = (
        np.clip(np.exp([row[name] for row in rows]), 1 / WIDEST, WIDEST)
        for name in ("median_error", "error_10", "error_90")
    )
    style = {"color": style_of(place)["color"], "marker": MARKS[place % 4], "markersize": 4.5}
    label = rows[0]["source"] if rows else None
    bars = [middle - low, high - middle]
    ax.errorbar(x, middle, yerr=bars, linestyle="none", elinewidth=1.2, label=label, **style)


def _close(figure: Figure, grid: Any, used: int, columns: int, sources: int) -> None:
    """Labels at the edges; the legend in the first panel that is left over, or below."""
    for ax in grid[used:]:
        ax.set_axis_off()
    for place, ax in enumerate(grid[:used]):
        if place + columns >= used:
            ax.set_xlabel("trials learned from")
            ax.tick_params(labelbottom=True)
        if place % columns == 0:
            ax.set_ylabel("learned / true")
    handles, labels = grid[0].get_legend_handles_labels()
    if used < len(grid):
        grid[used].legend(handles, labels, loc="center left", title="robot moved by")
    else:
        figure.legend(handles, labels, loc="outside lower center", ncols=sources)


@styled
def robot_figure(found: Sequence[Row]) -> Figure:
    """Time to Final, share right, and how often 98% sure was right, by robot; `robot_rows`."""
    truths = list(dict.fromkeys(row["truth"] for row in found))
    arms = list(dict.fromkeys(row["arm"] for row in found))
    arms = [INTUITIVE, *(arm for arm in arms if arm not in (INTUITIVE, TRUE)), TRUE]
    figure = Figure(figsize=(9.6, 4.0))
    panels = figure.subplots(1, 3)
    for ax, what in zip(panels, ("time", "correct", "right"), strict=True):
        for place, truth in enumerate(truths):
            rows = [_where(found, truth=truth, arm=arm)[0] for arm in arms]
            x = np.arange(len(arms)) + 0.18 * (place - (len(truths) - 1) / 2)
            middle, low, high = (np.array([row[what + end] for row in rows]) for end in ("", "_low", "_high"))
            style = {"color": style_of(place)["color"], "marker": MARKS[place % 4], "markersize": 5}
            bars = [middle - low, high - middle]
            ax.errorbar(x, middle, yerr=bars, linestyle="none", capsize=2.5, label=truth, **style)
        ax.set_xticks(range(len(arms)), [arm.replace("learned from ", "") for arm in arms])
        ax.set_xlim(-0.5, len(arms) - 0.5)
        ax.set_xlabel("trials learned from")
    panels[0].set_title("Seconds to Final")
    panels[0].set_ylim(bottom=0)
    panels[1].set_title("Share of trials with the right Final")
    panels[2].set_title("Right when first 98% sure")
    panels[2].legend(title="teachers", loc="lower right")
    panels[2].axhline(0.98, color="0.35", linewidth=0.9, linestyle=(0, (1, 1.5)))
    for ax in panels[1:]:
        ax.set_ylim(min(0.895, ax.get_ylim()[0]), 1.005)
        ax.yaxis.set_major_locator(MultipleLocator(0.05))
        ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.0%}"))
    figure.suptitle("Learned models as robots. Simulated teachers", fontsize=12, x=0.01, ha="left")
    return figure
