"""The figure of searches of simulated truths: what was chosen under each truth, by number of trials."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from learn.plots import COLOURS, styled
from learn.structure_study import DIFFER, truths
from learn.structure_summary import KINDS, OTHER, Claim, Row, claims, confusion

ANSWERS = {"told, right": COLOURS[0], "cannot tell": "0.82", "told, wrong": COLOURS[1]}
SHADES = LinearSegmentedColormap.from_list("blue", ["white", COLOURS[0]])


@styled
def confusion_figure(rows: Sequence[Row]) -> Figure:
    """Truth by choice, a matrix for each number of trials: counts of simulated studies."""
    sizes = sorted({int(row["trials"]) for row in rows})
    figure = Figure(figsize=(9.6, 8.4))
    grid = figure.subplots(2, (len(sizes) + 1) // 2, sharex=True, sharey=True, squeeze=False)
    for ax, size in zip(grid.flat, sizes, strict=False):
        _matrix(ax, rows, size)
    for ax in grid.flat[len(sizes) :]:
        ax.set_visible(False)
    for ax in grid[:, 0]:
        ax.set_ylabel("truth")
    for ax in grid[-1]:
        ax.set_xlabel("chosen")
    figure.suptitle("What the search chose: simulated studies, counted", fontsize=12, x=0.01, ha="left")
    return figure


def _matrix(ax: Axes, rows: Sequence[Row], size: int) -> None:
    names = [*truths()]
    choices = [name for name in names if name != DIFFER] + [OTHER]
    counts = confusion(rows, size)
    table = np.array([[counts[truth][choice] for choice in choices] for truth in names])
    shares = table / np.maximum(table.sum(axis=1, keepdims=True), 1)
    ax.imshow(shares, cmap=SHADES, vmin=0, vmax=1.15, aspect="auto")
    for i, j in zip(*np.nonzero(table), strict=True):
        ax.text(
            j, i, str(table[i, j]), ha="center", va="center", color="white" if shares[i, j] > 0.55 else "0.15"
        )
    for i, truth in enumerate(names):
        right = choices.index("intuitive" if truth == DIFFER else truth)
        ax.add_patch(_frame(right, i))
    ax.set_xticks(range(len(choices)), choices, rotation=45, ha="right")
    ax.set_yticks(range(len(names)), names)
    ax.tick_params(length=0)
    ax.set_title(f"{size} trials")
    for side in ax.spines.values():
        side.set_visible(False)


def _frame(column: int, row: int) -> Rectangle:
    return Rectangle((column - 0.48, row - 0.46), 0.96, 0.92, fill=False, edgecolor="0.35", linewidth=1.0)


def _answer(claim: Claim) -> str:
    right, open_, wrong = ANSWERS
    return open_ if not claim.told else right if claim.right else wrong


@styled
def told_figure(rows: Sequence[Row]) -> Figure:
    """By factor and number of trials: told and right, cannot tell (nothing false), told or named wrongly."""
    found = [claim for claim in claims(rows) if claim.truth != DIFFER]
    sizes = sorted({claim.trials for claim in found})
    figure = Figure(figsize=(9.0, 3.4))
    grid = figure.subplots(1, len(KINDS), sharey=True)
    for ax, kind in zip(grid, KINDS, strict=True):
        here = [[c for c in found if (c.kind, c.trials) == (kind, size)] for size in sizes]
        bottom = np.zeros(len(sizes))
        for answer, colour in ANSWERS.items():
            height = np.array([np.mean([_answer(c) == answer for c in each]) for each in here])
            ax.bar(range(len(sizes)), height, bottom=bottom, color=colour, width=0.72, label=answer)
            bottom += height
        ax.set_xticks(range(len(sizes)), [str(size) for size in sizes])
        ax.set_xlabel("trials")
        ax.set_title({"cue": "the cue of a state"}.get(kind, f"is there a {kind}?"))
    grid[0].set_ylabel("share of simulated studies")
    grid[-1].legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure
