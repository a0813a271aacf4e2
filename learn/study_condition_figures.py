"""The paper's figures by condition: ratings of each teacher, and a histogram of the times to Final."""

import dataclasses
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator, MultipleLocator

from learn.plots import COLOURS
from learn.study_paired import exception_sentence, paired, t_interval
from learn.study_statistics import by_teacher, measures
from learn.study_style import StudyFigure, condition_style, figure_of, for_print
from learn.study_trials import (
    Missing,
    by_condition,
    counted,
    rated_items,
    scale_of,
    source_note,
    teacher_of,
    time_to_final,
)
from taskcomm.trials import Trial

STEPS = (1, 2, 2.5, 5, 10, 15, 20, 30, 60)  # widths of bins, seconds


def rating_figures(trials: Sequence[Trial]) -> list[StudyFigure]:
    """A figure for every item that is rated in numbers; Missing where there is none."""
    items = [item for item, plain in rated_items(trials).items() if not plain]
    if not items:
        raise Missing("no trial has a rating in numbers")
    made: dict[str, StudyFigure] = {}
    for item in items:
        one = rating_figure(trials, item)
        name = one.name if one.name not in made else f"{one.name}-{len(made) + 1}"
        made[name] = dataclasses.replace(one, name=name)
    return list(made.values())


@for_print
def rating_figure(trials: Sequence[Trial], item: str) -> StudyFigure:
    """The rating of every teacher in every condition, a line for each teacher; means with 95% intervals."""
    measure = next(one for one in measures(trials) if one.name == f"rating {item}")
    grouped = by_condition(trials)
    of = {name: by_teacher(members, measure) for name, members in grouped.items()}
    of = {name: values for name, values in of.items() if values}
    rated = [trial for trial in trials if measure.of(trial) is not None]
    low, high = scale_of(trials, item)
    figure, (ax,) = figure_of(2.6, 1, f"{source_note(rated)}")
    names = list(of)
    for place in range(len(names) - 1):
        _lines(ax, of[names[place]], of[names[place + 1]], place)
    for place, (name, values) in enumerate(of.items()):
        _points(ax, place, list(values.values()), condition_style(place)["facecolor"])
        names[place] = f"{name}\nn = {len(values)}"
    ax.set_xticks(range(len(of)), names)
    ax.set_xlim(-0.55, len(of) - 0.45)
    ax.set_ylim(low - 0.4, high + 0.4)
    if high - low <= 12:
        ax.set_yticks(np.arange(low, high + 0.5))
    ax.set_ylabel(f"{item} ({low:g} to {high:g})")
    rows = [
        {"item": item, "teacher": teacher, "condition": name, "rating": value}
        for name, values in of.items()
        for teacher, value in values.items()
    ]
    safe = "".join(letter if letter.isalnum() else "-" for letter in item.lower()).strip("-")
    return StudyFigure(f"ratings-{safe}", figure, rows, _rating_caption(rated, item, of, measure.phrase))


def _lines(ax: Axes, left: dict[str, float], right: dict[str, float], place: int) -> None:
    """A line for every pair of ratings, thicker for more teachers; dashed where it goes up."""
    pairs = Counter((left[teacher], right[teacher]) for teacher in left if teacher in right)
    for (before, after), number in pairs.items():
        up = after > before
        style = (
            {"color": COLOURS[1], "linestyle": (0, (3, 1.5))} if up else {"color": "0.6", "linestyle": "-"}
        )
        ax.plot([place, place + 1], [before, after], linewidth=0.6 + 0.6 * number, zorder=1, **style)


def _points(ax: Axes, place: int, values: Sequence[float], colour: str) -> None:
    """A circle for each rating, larger and numbered for several teachers; beside them the mean."""
    for value, number in Counter(values).items():
        look: Any = {"color": colour, "edgecolor": "0.2", "linewidth": 0.5, "zorder": 2}
        ax.scatter([place], [value], s=18 + 42 * np.sqrt(number - 1), **look)
        if number > 1:
            middle: Any = {"ha": "center", "va": "center", "fontsize": 6.5, "color": "white"}
            ax.text(place, value - 0.03, str(number), fontweight="bold", **middle)
    mean, (low, high) = float(np.mean(values)), t_interval(values)
    bars = [[mean - low], [high - mean]] if np.isfinite(low) else None
    beside = place - 0.33 if place == 0 else place + 0.33
    look = {"color": "black", "markersize": 4, "capsize": 3, "linewidth": 1.2, "zorder": 3}
    ax.errorbar([beside], [mean], bars, fmt="D", **look)


def _rating_caption(trials: Sequence[Trial], item: str, of: dict[str, dict[str, float]], phrase: str) -> str:
    means = "; ".join(
        f"{name} {np.mean(list(values.values())):.2f} (n = {len(values)})" for name, values in of.items()
    )
    said = []
    names = list(of)
    for first, second in pairwise(names):
        if of[first].keys() & of[second].keys():
            said.append(exception_sentence(paired(of[first], of[second]), phrase, first, second))
    return (
        f"Ratings of {item!r} by condition, {source_note(trials)} of"
        f" {counted(len({teacher_of(trial) for trial in trials}), 'teacher')}. Circles: ratings, with the"
        " number of teachers in them; each line is a teacher (thicker: more of them), dashed where the"
        f" rating on the right is higher. Diamonds: means with Student's 95% intervals. Means: {means}."
        f" {' '.join(said)}"
    ).strip()


@for_print
def time_figure(trials: Sequence[Trial]) -> StudyFigure:
    """A histogram of the times to Final, the conditions side by side in every bin."""
    grouped = by_condition(trials)
    times = {
        name: [time for trial in members if (time := time_to_final(trial)) is not None]
        for name, members in grouped.items()
    }
    times = {name: values for name, values in times.items() if values}
    if not times:
        raise Missing("no trial ended with Final")
    every = [time for values in times.values() for time in values]
    edges = bin_edges(every)
    ended = [trial for trial in trials if time_to_final(trial) is not None]
    figure, (ax,) = figure_of(2.4, 1, source_note(ended))
    wide = (edges[1] - edges[0]) * 0.9 / len(times)
    counts = {name: np.histogram(values, edges)[0] for name, values in times.items()}
    for place, (name, count) in enumerate(counts.items()):
        left = edges[:-1] + 0.05 * (edges[1] - edges[0]) + place * wide
        label = f"{name} (n = {len(times[name])})"
        ax.bar(
            left,
            count,
            wide,
            align="edge",
            label=label,
            edgecolor="white",
            linewidth=0.3,
            **condition_style(place),
        )
        look: Any = {
            "color": COLOURS[place % 7],
            "markeredgecolor": "black",
            "markeredgewidth": 0.4,
            "markersize": 5,
        }
        below: Any = {"clip_on": False, "transform": ax.get_xaxis_transform()}
        ax.plot(np.mean(times[name]), -0.035, marker="^", **look, **below)
    ax.set_xlim(edges[0], edges[-1])
    ax.xaxis.set_major_locator(MultipleLocator((edges[1] - edges[0]) * max(1, -(-len(edges) // 8))))
    ax.yaxis.set_major_locator(MaxNLocator("auto", integer=True))
    ax.set_xlabel("seconds until Final (triangles: means)", labelpad=5)
    ax.tick_params(axis="x", pad=5)
    ax.set_ylabel("trials")
    figure.legend(loc="outside lower center", ncols=2 if len(times) < 5 else 1)
    rows = [
        {"from_seconds": float(low), "to_seconds": float(high)}
        | {name: int(count[place]) for name, count in counts.items()}
        for place, (low, high) in enumerate(pairwise(edges))
    ]
    return StudyFigure("time-to-final", figure, rows, _time_caption(trials, ended, times, edges))


def bin_edges(times: Sequence[float], most: int = 14) -> "np.ndarray[Any, np.dtype[np.float64]]":
    """Edges of bins from 0 to past the longest time: the narrowest of a few widths that gives at most `most`.

    >>> bin_edges([3.0, 55.0]).tolist()[:3], len(bin_edges([3.0, 55.0]))
    ([0.0, 5.0, 10.0], 13)
    """
    longest = max(times)
    wide = next((step for step in STEPS if longest / step < most), 60 * np.ceil(longest / 60 / most))
    return np.asarray(np.arange(0, np.floor(longest / wide) + 2) * wide, dtype=np.float64)


def _time_caption(
    trials: Sequence[Trial], ended: Sequence[Trial], times: dict[str, list[float]], edges: Any
) -> str:
    means = "; ".join(
        f"{name} mean {np.mean(values):.1f} s, median {np.median(values):.1f} s (n = {len(values)})"
        for name, values in times.items()
    )
    known = [trial.correct for trial in ended if trial.correct is not None]
    without = Counter(trial.reason or "broken off" for trial in trials if trial.reason != "final")
    left = ", ".join(f"{number} {reason}" for reason, number in sorted(without.items()))
    return (
        f"Histogram of the times until the robot displayed Final, by condition, in {source_note(ended)};"
        f" bins of {edges[1] - edges[0]:g} s. {means}."
        + (f" Final showed the right task in {sum(known)} of {len(known)}." if known else "")
        + (f" Without Final, and not shown: {left}." if left else "")
    )
