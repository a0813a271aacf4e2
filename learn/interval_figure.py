"""Figures of how sure a fit is: a profile, and what intervals have covered."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from learn.intervals import ParameterInterval
from learn.plots import COLOURS, axes_or_new, styled
from taskcomm.lattice import Floats


@styled
def profile_plot(
    curve: tuple[Floats, Floats],
    interval: ParameterInterval,
    ax: Axes | None = None,
    *,
    truth: float | None = None,
    drop: float = 1.92,
) -> Axes:
    """A profile log-likelihood (`learn.certainty.profile_curve`), the `drop` that ends the interval, the
    interval, and with a standard error the parabola that it stands for."""
    ax = axes_or_new(ax)
    values, drops = curve
    if interval.standard_error is not None:
        wide = np.linspace(values[0], values[-1], 200)
        parabola = -(((wide - interval.estimate) / interval.standard_error) ** 2) / 2
        ax.plot(wide, parabola, color="0.6", linestyle=(0, (2, 1.5)), label="parabola of the standard error")
    ax.plot(values, -drops, color=COLOURS[0], marker="o", markersize=3, linewidth=1.6, label="profile")
    ax.axhline(-drop, color="0.7", linewidth=0.8)
    if interval.low is not None and interval.high is not None:
        ax.plot([interval.low, interval.high], [-drop] * 2, color=COLOURS[1], linewidth=4, label="interval")
    if truth is not None:
        ax.axvline(truth, color="black", linewidth=0.9, linestyle=(0, (6, 2)), label="truth")
    ax.set_ylim(-2.2 * drop, 0.12 * drop)
    ax.set_xlabel(interval.parameter)
    ax.set_ylabel("log-likelihood, less its greatest")
    return ax


@styled
def coverage_plot(
    tables: Mapping[str, Sequence[Mapping[str, str]]], ax: Axes | None = None, *, level: float = 0.95
) -> Axes:
    """How often the intervals held the truth, by parameter: rows of `learn.coverage`, under a name each.

    Bars are Wilson's 95% intervals of the share; `level` is what was claimed.
    """
    ax = axes_or_new(ax, 6.4, 4.4)
    names = list(dict.fromkeys(row["parameter"] for rows in tables.values() for row in rows))
    for place, (label, rows) in enumerate(tables.items()):
        shift = 0.22 * (place - (len(tables) - 1) / 2)
        for row in rows:
            y = names.index(row["parameter"]) + shift
            ends = [float(row["coverage_low"]), float(row["coverage_high"])]
            ax.plot(ends, [y, y], color=COLOURS[place], linewidth=1.4)
            ax.plot(float(row["coverage"]), y, "osD"[place % 3], color=COLOURS[place], markersize=4.5)
        ax.add_line(
            Line2D([], [], color=COLOURS[place], marker="osD"[place % 3], label=label, markersize=4.5)
        )
    ax.axvline(level, color="black", linewidth=0.9, linestyle=(0, (6, 2)))
    ax.set_yticks(range(len(names)), names)
    ax.invert_yaxis()
    ax.set_xlim(None, 1.005)
    ax.set_xlabel(f"share of studies whose {level:.0%} interval held the truth")
    ax.legend(loc="upper left", bbox_to_anchor=(0.0, -0.14), ncols=len(tables), borderaxespad=0.2)
    return ax
