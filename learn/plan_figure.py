"""The drawing of a contingent plan: time runs to the right, every likely press opens a row of its own."""

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from learn.plots import COLOURS, axes_or_new, styled
from taskcomm.belief import entropy
from taskcomm.contingency import Branch, PlannedStep
from taskcomm.explain import LEAST, Explanation
from taskcomm.wording import percent, shifts_in_words

SILENT, PRESSED = COLOURS[0], COLOURS[1]
COLUMN, ROW = 1.85, 0.78  # inches for a step, and for a press
MOST = 8  # presses drawn
FITS = 22  # letters between two boxes
BOX = {"boxstyle": "round,pad=0.25", "facecolor": "white", "linewidth": 1.1}


@styled
def plan_tree(
    explanation: Explanation, ax: Axes | None = None, *, least: float = LEAST, most: int = MOST
) -> Axes:
    """The plan as a tree: boxes are actions, blue goes on without a press, orange after one.

    Lines are as thick as their branch is probable. Presses are drawn where their probability, as seen
    from the decision, is at least `least`, the `most` likeliest of them; a dotted stub stands for the others.
    At the end of each row stand its probability and the entropy of the belief reached.
    """
    presses = {id(branch) for branch in explanation.root.likely_presses(least, most)}
    steps = explanation.depth
    ax = axes_or_new(ax, *_inches(steps, len(presses)))
    tree = _Tree(explanation, ax, presses)
    rows = tree.draw(explanation.root, 0)
    ax.set_xlim(-0.35, steps + 0.55)
    ax.set_ylim(-rows + 0.25, 0.6)
    ax.set_yticks([])
    ax.set_xticks(range(steps + 1), [f"{step * explanation.dt:g}" for step in range(steps + 1)])
    ax.set_xlabel("seconds (blue: no press, orange: pressed)")
    ax.spines["left"].set_visible(False)
    root, seconds = explanation.root, explanation.horizon * explanation.dt
    ax.set_title(f"{root.action}: {root.value:.3f} nats over {seconds:g} s; now {entropy(root.before):.3f}")
    return ax


@styled
def plan_figure(explanation: Explanation, title: str = "") -> Figure:
    """A figure of its own for `plan_tree`."""
    presses = explanation.root.likely_presses(LEAST, MOST)
    figure = Figure(figsize=_inches(explanation.depth, len(presses)))
    plan_tree(explanation, figure.add_subplot())
    if title:
        figure.suptitle(title, fontsize=11, x=0.01, ha="left")
    return figure


def _inches(steps: int, presses: int) -> tuple[float, float]:
    return max(COLUMN * (steps + 0.9) + 0.4, 5.0), ROW * (presses + 1) + 1.3


class _Tree:
    """Draws chains of silent steps as rows, the presses of later steps in the rows nearer to their chain."""

    def __init__(self, explanation: Explanation, ax: Axes, presses: set[int]) -> None:
        self._explanation, self._ax, self._presses = explanation, ax, presses

    def draw(self, first: PlannedStep, row: int) -> int:
        """The plan from `first` on, into `row` and as many below as it needs; gives the next free row."""
        chain = list(first.chain())
        start = self._explanation.horizon - first.left
        for x, step in enumerate(chain, start):
            self._line([x, x + 1], [-row, -row], step.silent, SILENT)
        self._ending(chain[-1].silent, start + len(chain), row)
        free = row + 1
        for x, step in reversed(list(enumerate(chain, start))):
            self._box(step, x, row)
            if id(step.press) in self._presses:
                free = self._press(step, x, row, free)
            else:
                self._ax.plot([x, x], [-row, -row - 0.36], color=PRESSED, linestyle=":", zorder=1)
        return free

    def _press(self, step: PlannedStep, x: int, row: int, free: int) -> int:
        """What follows a press in `step`, in the row `free`; gives the next free row."""
        self._line([x, x, x + 1], [-row, -free, -free], step.press, PRESSED)
        why = max(step.press.reasons, key=lambda state: step.press.reasons[state])
        above = f"pressed {percent(step.press.probability)}\n{_short(why)}"
        moved = shifts_in_words(self._explanation.tasks, step.before, step.press.marginal, pressed=True)
        below = "\n".join(map(_short, moved.replace(" -> ", " → ").split(", ")[:2]))
        self._ax.text(x + 0.05, -free + 0.06, above, fontsize=8, va="bottom", color=PRESSED)
        self._ax.text(x + 0.05, -free - 0.07, below, fontsize=8, va="top")
        if step.press.then is None:
            self._ending(step.press, x + 1, free)
            return free + 1
        return self.draw(step.press.then, free)

    def _line(self, x: Sequence[float], y: Sequence[float], branch: Branch, colour: str) -> None:
        width = 0.9 + 4 * branch.reach
        self._ax.plot(x, y, color=colour, linewidth=width, zorder=1, solid_capstyle="butt")

    def _box(self, step: PlannedStep, x: int, row: int) -> None:
        root = step is self._explanation.root
        style: dict[str, Any] = BOX | {"edgecolor": "black" if root else "0.5"}
        weight = "bold" if root else "normal"
        said = _short(str(step.action))
        self._ax.text(x, -row, said, fontsize=8.5, ha="center", va="center", bbox=style, weight=weight)

    def _ending(self, branch: Branch, x: int, row: int) -> None:
        said = f"{percent(branch.reach)}: {branch.entropy:.2f} nats"
        self._ax.text(x + 0.04, -row, said, fontsize=8, va="center")


def _short(text: str) -> str:
    return text if len(text) <= FITS else text[: FITS - 1] + "…"
