"""Figures of populations: teachers about their mean, and what knowing them is worth."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from learn.held_out_teachers import AVERAGED, SEPARATE, UPDATED
from learn.plots import COLOURS, axes_or_new, style_of, styled
from learn.population import Population

ARMS = (UPDATED, AVERAGED, SEPARATE)
BAR, DOTS = "#BBBBBB", COLOURS[0]


@styled
def teachers_about_their_mean(found: Population, ax: Axes | None = None) -> tuple[Axes, list[dict[str, Any]]]:
    """Each coordinate's parameter relative to that of the mean teacher: the middle 95% of teachers as a bar,
    every teacher's own model as a dot. Delays and holds, which may be 0, are left out.

    Returns the Axes and the numbers behind it, a row for each teacher and parameter.
    """
    middle = {name: values for name, values in found.middle().items() if not name.endswith(("delay", "hold"))}
    ax = axes_or_new(ax, 6.4, 0.8 + 0.32 * len(middle))
    rows = []
    for place, (name, (at, low, high)) in enumerate(middle.items()):
        ax.plot(
            [low / at, high / at], [place, place], color=BAR, linewidth=7, solid_capstyle="round", zorder=1
        )
        values = [found.parameter(teacher.model, name) for teacher in found.teachers]
        aside = 0.18 * np.linspace(-1, 1, len(values))
        ax.plot(np.array(values) / at, place + aside, "o", color=DOTS, markersize=3.4, alpha=0.8, zorder=2)
        rows += [
            {"parameter": name, "teacher": teacher.name, "value": value, "mean_teacher": at}
            for teacher, value in zip(found.teachers, values, strict=True)
        ]
    ax.axvline(1.0, color="#000000", linewidth=0.8, zorder=0)
    ax.set_xscale("log")
    ticks = [tick for tick in (0.125, 0.25, 0.5, 1, 2, 4, 8) if _within(tick, ax.get_xlim())]
    ax.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    ax.minorticks_off()
    ax.set_yticks(range(len(middle)), list(middle))
    ax.invert_yaxis()
    ax.set_xlabel("times that of the mean teacher")
    ax.set_title(f"{len(found.teachers)} teachers (dots), and where 95% of teachers are thought to be (bars)")
    return ax, rows


def _within(tick: float, limits: tuple[float, float]) -> bool:
    return limits[0] <= tick <= limits[1]


@styled
def worth_of_knowing(rows: Sequence[Mapping[str, Any]], title: str, ax: Axes | None = None) -> Axes:
    """Nats per trial gained over one model for all, by how many trials of the teacher were known.

    `rows` are those of `learn.population_study.summary`; bars are 95% intervals, teachers resampled.
    """
    ax = axes_or_new(ax, 5.2, 3.4)
    for place, arm in enumerate(ARMS):
        mine = [row for row in rows if row["arm"] == arm and row["known"] != ""]
        if not mine:
            continue
        known = np.array([int(row["known"]) for row in mine]) + 0.12 * (place - 1)
        at, low, high = (np.array([float(row[name]) for row in mine]) for name in ("estimate", "low", "high"))
        style = style_of(place)
        ax.errorbar(known, at, [at - low, high - at], marker="o", markersize=4, label=arm, capsize=2, **style)
    ax.axhline(0.0, color="#000000", linewidth=0.8, zorder=0)
    ax.set_xlabel("trials of the teacher known before")
    ax.set_ylabel("nats per trial over one model for all")
    ax.set_title(title)
    ax.legend(loc="lower right")
    return ax


@styled
def worth_in_studies(studies: Mapping[str, Sequence[Mapping[str, Any]]]) -> Figure:
    """`worth_of_knowing` of several studies, by title, beside each other on one scale."""
    figure = Figure(figsize=(3.7 * len(studies), 3.5))
    panels = figure.subplots(1, len(studies), sharey=True, squeeze=False)[0]
    for ax, (title, rows) in zip(panels, studies.items(), strict=True):
        worth_of_knowing(rows, title, ax)
        if ax is not panels[-1]:
            ax.get_legend().remove()
        if ax is not panels[0]:
            ax.set_ylabel("")
    return figure
