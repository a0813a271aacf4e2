"""Figures of a study, for print at 3.2 inches: their style, what comes with each, how they are written."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from learn.plots import COLOURS, STYLE, csv_text

WIDTH = 3.2  # inches: a column of print
DARK, LIGHT = "0.35", "0.75"
HATCHES = ("", "////", "....", "xxxx")
PRINT: Any = STYLE | {
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.labelsize": 8,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "legend.fontsize": 7.5,
    "legend.handlelength": 2.2,
    "legend.handletextpad": 0.5,
    "axes.linewidth": 0.7,
    "lines.linewidth": 1.4,
    "savefig.dpi": 300,
    "text.parse_math": False,  # ids and conditions are shown as they are
    "pdf.fonttype": 42,
    "svg.hashsalt": "taskcomm",
}
Drawing = ParamSpec("Drawing")
Drawn = TypeVar("Drawn")


@dataclass(frozen=True)
class StudyFigure:
    """A figure, the numbers behind it, and a caption that says which data it shows."""

    name: str
    figure: Figure
    rows: Sequence[Mapping[str, Any]]
    caption: str

    def write(self, directory: Path, ending: str = "png") -> list[Path]:
        """Write NAME.png (.pdf, .svg), NAME.csv and NAME.txt (the caption); gives the paths."""
        drawn, table, words = (directory / f"{self.name}.{end}" for end in (ending, "csv", "txt"))
        dateless = {"png": {"Software": None}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}
        with matplotlib.rc_context(PRINT):
            self.figure.draw_without_rendering()  # ticks settle with the layout, the layout with the ticks
            self.figure.savefig(drawn, metadata=dateless[ending])
        table.write_text(csv_text(self.rows), encoding="utf-8")
        words.write_text(self.caption + "\n", encoding="utf-8")
        return [drawn, table, words]


def for_print(draw: Callable[Drawing, Drawn]) -> Callable[Drawing, Drawn]:
    """Draw in the style of print, and leave matplotlib's settings as they were."""

    @wraps(draw)
    def in_style(*args: Drawing.args, **kwargs: Drawing.kwargs) -> Drawn:
        with matplotlib.rc_context(PRINT):
            return draw(*args, **kwargs)

    return in_style


def figure_of(height: float, rows: int = 1, note: str = "", **more: Any) -> tuple[Figure, list[Axes]]:
    """A figure one column wide with `rows` panels one above the other; `note` stands small above them."""
    figure = Figure(figsize=(WIDTH, height))
    axes = figure.subplots(rows, 1, squeeze=False, **more)[:, 0]
    if note:
        figure.suptitle(note, fontsize=7, color="0.3", x=0.01, ha="left")
    return figure, list(axes)


def condition_style(place: int) -> dict[str, Any]:
    """Fill of the condition in this place: colour, and a hatch that stays in grey print."""
    return {"facecolor": COLOURS[place % len(COLOURS)], "hatch": HATCHES[place % len(HATCHES)]}


def write_captions(figures: Sequence[StudyFigure], directory: Path) -> Path:
    """Every caption by the name of its figure, as JSON."""
    path = directory / "captions.json"
    captions = {figure.name: figure.caption for figure in figures}
    path.write_text(json.dumps(captions, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    return path
