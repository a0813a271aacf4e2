"""Figures, each drawn into an Axes and given back with the numbers behind it. Nothing is ever shown.

Colours are Okabe and Ito's, which the colour-blind tell apart; arms differ in line style too.
"""

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from learn.closed_loop import ClosedLoop
from taskcomm.teacher import TableTop, TeacherModel

Floats = NDArray[np.float64]
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
LINES: tuple[Any, ...] = ("-", (0, (6, 2)), (0, (2, 1.5)), (0, (6, 2, 1.5, 2)), (0, (1, 1)), "-", "-")
STYLE: Any = {
    "figure.dpi": 110,
    "savefig.dpi": 150,
    "font.size": 10,
    "axes.titlesize": 10.5,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "legend.handlelength": 2.9,
    "figure.constrained_layout.use": True,
}


Band = Callable[[str, Floats, str], tuple[Floats, Floats]]  # of a mental state, seconds, a cue on or off
Drawing = ParamSpec("Drawing")
Drawn = TypeVar("Drawn")


def styled(draw: Callable[Drawing, Drawn]) -> Callable[Drawing, Drawn]:
    """Draw with the house style, and leave matplotlib's settings as they were."""

    @wraps(draw)
    def in_style(*args: Drawing.args, **kwargs: Drawing.kwargs) -> Drawn:
        with matplotlib.rc_context(STYLE):
            return draw(*args, **kwargs)

    return in_style


def axes_or_new(ax: Axes | None, width: float = 5.2, height: float = 3.4) -> Axes:
    """`ax`, or the Axes of a new figure of this size in inches, not registered with pyplot."""
    if ax is not None:
        return ax
    return Figure(figsize=(width, height)).add_subplot()


def style_of(place: int) -> dict[str, Any]:
    """Colour and line of the arm in this place."""
    return {"color": COLOURS[place % len(COLOURS)], "linestyle": LINES[place % len(LINES)]}


def approval_after(top: TableTop, seconds: ArrayLike, cue: str = "on") -> Floats:
    """P(M = m) per step, some seconds after the cue came `on` (level 0), or went `off` (level 1).

    The table-top of the paper's figure 2, as continuous time has it, without resets.

    >>> approval_after(TableTop("mov_lit", peak=0.1, rise=2.0, fall=2.0), [0.0, 1.0, 2.0, 9.0]).tolist()
    [0.0, 0.05, 0.1, 0.1]
    """
    since = np.asarray(seconds, dtype=np.float64) - top.delay
    if cue == "off":
        return np.asarray(top.peak * np.clip(1 - since / top.fall, 0, 1))
    probability = top.peak * np.clip(since / top.rise, 0, 1)
    if top.decay is not None:
        probability = probability * np.exp(-np.maximum(0.0, since - top.hold) / top.decay)
    return np.asarray(probability)


@styled
def table_top(
    models: Mapping[str, TeacherModel],
    state: str,
    cue: str = "on",
    ax: Axes | None = None,
    *,
    seconds: float = 6.0,
    truths: Sequence[TeacherModel] = (),
    bands: Mapping[str, Band] | None = None,
) -> Axes:
    """The table-top of one mental state under each model, since its cue went `on` or `off`.

    `truths` are drawn thin and grey behind. A model without the state is left out. `bands` are drawn behind
    the models that they are named for, see `learn.bands`.
    """
    ax = axes_or_new(ax)
    since = np.linspace(-0.5, seconds, 400)
    for place, truth in enumerate(truths):
        if state in truth.approvals:
            label = "true teachers" if place == 0 else None
            line = table_top_line(truth.approvals[state], since, cue)
            ax.plot(since, line, color="0.8", linewidth=0.8, zorder=1, label=label)
    for place, (name, model) in enumerate(models.items()):
        if state in model.approvals:
            line = table_top_line(model.approvals[state], since, cue)
            ax.plot(since, line, label=name, linewidth=2.2, zorder=3, **style_of(place))
            if bands is not None and name in bands:
                low, high = bands[name](state, since, cue)
                colour = style_of(place)["color"]
                ax.fill_between(since, low, high, color=colour, alpha=0.2, linewidth=0, zorder=2)
    ax.axvline(0, color="0.6", linewidth=0.8, zorder=0)
    ax.set_xlim(since[0], since[-1])
    ax.set_ylim(bottom=0)
    ax.set_xlabel(f"seconds since the cue went {cue}")
    return ax


def table_top_line(top: TableTop, since: Floats, cue: str) -> Floats:
    """P(M = m) some seconds after, or with a negative number before, its cue went `on` or `off`."""
    before = 0.0 if cue == "on" else top.peak
    return np.where(since < 0, before, approval_after(top, np.maximum(since, 0), cue))


@styled
def table_tops(models: Mapping[str, TeacherModel], truths: Sequence[TeacherModel] = ()) -> Figure:
    """All table-tops of all models, overlaid: a row for each mental state, cue on and cue off."""
    states = list(dict.fromkeys(state for model in models.values() for state in model.approvals))
    tops = [top for model in models.values() for top in model.approvals.values()]
    longest = max(top.delay + max(top.rise, top.fall) for top in tops)
    seconds = float(np.clip(np.ceil(longest) + 1, 4, 12))
    figure = Figure(figsize=(8.6, 2.3 * len(states) + 0.6))
    grid = figure.subplots(len(states), 2, sharex="col", sharey="row", squeeze=False)
    for number, (row, state) in enumerate(zip(grid, states, strict=True), start=1):
        for ax, cue in zip(row, ("on", "off"), strict=True):
            table_top(models, state, cue, ax, seconds=seconds, truths=truths)
            if number < len(states):
                ax.set_xlabel("")
        cues = {model.approvals[state].cue for model in models.values() if state in model.approvals}
        row[0].set_ylabel("P per step")
        row[0].set_title(f"{state}, cue {' or '.join(sorted(cues))}")
    handles, labels = grid[0, 1].get_legend_handles_labels()
    order = sorted(range(len(labels)), key=lambda place: labels[place] == "true teachers")
    grid[0, 1].legend([handles[n] for n in order], [labels[n] for n in order], loc="upper right")
    return figure


def table_top_rows(models: Mapping[str, TeacherModel], seconds: float = 12.0) -> list[dict[str, Any]]:
    """The numbers of `table_tops`: one row for each model, mental state, cue and tenth of a second."""
    return [
        {
            "model": name,
            "mental_state": state,
            "cue": top.cue,
            "since_cue_went": cue,
            "seconds": round(float(since), 3),
            "probability": float(probability),
        }
        for name, model in models.items()
        for state, top in model.approvals.items()
        for cue in ("on", "off")
        for since in (np.linspace(0, seconds, int(seconds * 10) + 1),)
        for since, probability in zip(since, approval_after(top, since, cue), strict=True)
    ]


def _legend_below(ax: Axes, columns: int) -> None:
    ax.legend(loc="upper left", bbox_to_anchor=(0.0, -0.16), ncols=min(columns, 4), borderaxespad=0.2)


@styled
def time_to_final(loop: ClosedLoop, ax: Axes | None = None) -> Axes:
    """Share of trials in which the right Final (bold), and any Final (thin), was shown by a time."""
    ax = axes_or_new(ax, 6.2, 3.8)
    longest = max(float(loop.time(arm).max()) for arm in loop.arms)
    for place, arm in enumerate(loop.arms):
        style, time = style_of(place), loop.time(arm)
        shown, right = ~loop.timeout(arm), loop.correct(arm)
        for kept, width, alpha in ((shown, 1.0, 0.55), (right, 2.2, 1.0)):
            x = np.concatenate([[0.0], np.sort(time[kept]), [longest * 1.03]])
            y = np.concatenate([np.arange(kept.sum() + 1), [kept.sum()]]) / len(time)
            ax.step(x, y, where="post", linewidth=width, alpha=alpha, **style)
        late = int(loop.timeout(arm).sum())
        notes = f"{arm}: {right.mean():.0%} right, mean {time.mean():.0f} s"
        notes += f", {late} timeout{'s' if late > 1 else ''}" if late else ""
        ax.plot([], [], label=notes, linewidth=2.2, **style)
    ax.set_xlim(0, longest * 1.03)
    ax.set_ylim(0, 1.02)
    ax.set_xlabel("seconds")
    ax.set_ylabel("share of trials")
    ax.set_title("Final shown by then: rightly (bold), at all (thin)")
    _legend_below(ax, columns=1)
    return ax


def entropy_quantiles(loop: ClosedLoop, arm: str) -> tuple[Floats, Floats]:
    """Seconds (T,), and the quartiles (3, T) of the entropy over the trials of an arm.

    A trial that has ended keeps its last entropy.
    """
    paths = [outcome.entropy for outcome in loop.outcomes[arm]]
    length = max(len(outcome.entropy) for name in loop.arms for outcome in loop.outcomes[name])
    filled = np.array([np.concatenate([path, np.full(length - len(path), path[-1])]) for path in paths])
    time = np.arange(length, dtype=np.float64) * loop.dt
    return time, np.asarray(np.quantile(filled, [0.25, 0.5, 0.75], axis=0), dtype=np.float64)


@styled
def entropy_over_time(loop: ClosedLoop, ax: Axes | None = None) -> Axes:
    """Median and quartiles, over the trials, of the entropy of the belief over tasks."""
    ax = axes_or_new(ax, 6.2, 3.8)
    ends = []
    for place, arm in enumerate(loop.arms):
        time, (low, median, high) = entropy_quantiles(loop, arm)
        style = style_of(place)
        ax.fill_between(time, low, high, color=style["color"], alpha=0.15, linewidth=0)
        ax.plot(time, median, label=arm, linewidth=2.2, **style)
        ends.append(float(np.quantile(loop.time(arm), 0.95)))
    ax.set_xlim(0, max(ends))
    ax.set_ylim(bottom=0)
    ax.set_xlabel("seconds")
    ax.set_ylabel("entropy of the task (nats)")
    ax.set_title("Median (line) and quartiles (band); after Final, as it stood")
    _legend_below(ax, columns=len(loop.arms))
    return ax


def entropy_rows(loop: ClosedLoop) -> list[dict[str, Any]]:
    """The numbers of `entropy_over_time`."""
    return [
        {"arm": arm, "seconds": float(t), "lower_quartile": low, "median": median, "upper_quartile": high}
        for arm in loop.arms
        for time, quartiles in (entropy_quantiles(loop, arm),)
        for t, (low, median, high) in zip(time, quartiles.T.tolist(), strict=True)
    ]


@styled
def save(figure: Figure | Axes, path: Path, rows: Sequence[Mapping[str, Any]]) -> list[Path]:
    """Write a figure, and the numbers behind it as CSV beside it; gives the paths written."""
    drawn = figure.get_figure(root=True) if isinstance(figure, Axes) else figure
    if drawn is None:
        raise ValueError(f"{path}: these Axes belong to no figure")
    drawn.savefig(path, metadata={"Software": None} if path.suffix == ".png" else None)
    table = path.with_suffix(".csv")
    table.write_text(csv_text(rows), encoding="utf-8")
    return [path, table]


def csv_text(rows: Sequence[Mapping[str, Any]]) -> str:
    """Rows with equal keys as CSV with a heading; floats at full precision."""
    text = io.StringIO()
    if rows:
        writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    return text.getvalue()
