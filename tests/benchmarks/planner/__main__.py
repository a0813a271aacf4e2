"""`make bench-planner`: the search against the plain compiled tree, as a table, JSON and CSV."""

import argparse
import csv
import json
import sys
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.planner import deadlines
from benchmarks.planner.measure import Limits, measured
from benchmarks.planner.situations import Situations, learned, of_balls, study
from plaintree import PlainTree

from taskcomm.belief import Belief
from taskcomm.planner import EntropyPlanner

QUICK = Limits(search=8, plain=20, plain_decisions=100, decision=20)
FULL = Limits(search=1800, plain=600, plain_decisions=1000, decision=120)
PLAIN_TO = {3: 5, 4: 4, 6: 4, 10: 3}  # balls: the furthest horizon at which the plain tree takes seconds
COLUMNS = (
    ("decisions of", 12), ("balls", 5), ("tasks", 5), ("horizon", 7), ("decided", 11), ("stopped", 7),
    ("plain/search", 19), ("n", 4), ("plain nodes", 11), ("nodes", 8), ("median", 7), ("p99", 7),
    ("max", 7), ("in time", 7), ("memory", 7),
)  # fmt: skip

LEGEND = """\
The search (EntropyPlanner.plan) against a plain compiled whole tree (numba, buffers allocated before,
closed-form leaves; no bounds, no merging), on the same decisions in the same process, one core.
  decided       decisions timed of those there are, in an order drawn with a fixed seed, until {search:g} s
                a row are spent
  stopped       decisions given up after {decision:g} s, the world being explored included; they count as
                infinitely long
  plain/search  median (quartiles) of the ratio of their times over the n decisions on which the plain tree
                was run: {plain_decisions} a row, or {plain:g} s; not at all where one takes it too long (-).
                Wherever it was run, the least values agreed to 1e-9.
  nodes         beliefs looked at, medians
  median, p99, max  processor time of a decision, as a share of the time step of 0.5 s
  in time       decisions within the step
  memory        peak of the process, with the interpreter and the plain tree
"""


def cases(wanted: list[str]) -> Iterator[tuple[Situations, range]]:
    """The decisions asked for, and the horizons to look at them with."""
    if "study" in wanted:
        yield study(), range(3, 9)
    if "learned" in wanted:
        yield learned(), range(3, 9)
    if "balls" in wanted:
        for balls in (4, 6, 10):
            yield of_balls(balls), range(3, 6)


def _compile(situations: Situations) -> None:
    """Load both ways before any process is started."""
    world, model = situations.world, situations.model
    EntropyPlanner(world, model, 1).warm_up()
    PlainTree(world, model, 1).values(Belief.initial(world, model), world.start())


def line(cells: list[str], columns: tuple[tuple[str, int], ...] = COLUMNS) -> str:
    return "  ".join(cell.rjust(width) for cell, (_, width) in zip(cells, columns, strict=True))


def cells(figures: dict[str, Any]) -> list[str]:
    low, high = figures["plain_over_search_quartiles"]
    ratio = figures["plain_over_search"]
    return [
        figures["name"],
        *(str(figures[key]) for key in ("num_balls", "tasks", "horizon")),
        f"{figures['decisions']}/{figures['of']}",
        str(figures["stopped"]),
        f"{ratio:.0f} ({low:.0f}-{high:.0f})" if ratio else "-",
        str(figures["plain_decisions"]),
        *("-" if figures[key] is None else f"{figures[key]:.0f}" for key in ("plain_nodes", "nodes")),
        *(_share(figures[key], figures["stopped"]) for key in ("median_share", "p99_share", "max_share")),
        "-" if figures["within_step"] is None else f"{figures['within_step']:.1%}",
        f"{figures['memory'] / 2**20:.0f} MB",
    ]


def _share(share: float | None, stopped: int) -> str:
    if share is None:
        return "over" if stopped else "-"
    return f"{share:.2%}" if share < 0.1 else f"{share:.1%}" if share < 1 else f"{share:.0%}"


def _write(path: Path, figures: list[dict[str, Any]]) -> None:
    path.with_suffix(".json").write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    with path.with_suffix(".csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(figures[0]))
        writer.writeheader()
        writer.writerows(figures)


def main() -> int:
    parser = argparse.ArgumentParser(prog="make bench-planner", description=__doc__)
    parser.add_argument("--full", action="store_true", help="all decisions, or half an hour a row")
    parser.add_argument("--rows", default="study,learned,balls", help="which of study, learned, balls")
    parser.add_argument("--out", type=Path, default=Path("build/bench-planner"), help="folder of the figures")
    chosen = parser.parse_args()
    limits = FULL if chosen.full else QUICK
    print(LEGEND.format(**asdict(limits)))
    chosen.out.mkdir(parents=True, exist_ok=True)
    found = list(cases(chosen.rows.split(",")))
    print(line([name for name, _ in COLUMNS]), flush=True)
    figures = []
    for situations, horizons in found:
        _compile(situations)
        for horizon in horizons:
            plain = horizon <= PLAIN_TO[situations.world.num_balls]
            figures.append(measured(situations, horizon, plain, limits).summary())
            print(line(cells(figures[-1])) + f"  {figures[-1]['trouble']}", flush=True)
    _write(chosen.out / "rows", figures)
    print(deadlines.LEGEND)
    print(line([name for name, _ in deadlines.COLUMNS], deadlines.COLUMNS), flush=True)
    reached = []
    for situations, _ in found:
        reached.append(deadlines.reached(situations, 2 * limits.search))
        print(line(deadlines.cells(reached[-1]), deadlines.COLUMNS), flush=True)
    _write(chosen.out / "deadlines", reached)
    print(f"\nin {chosen.out}: rows and deadlines, .json and .csv")
    return 1 if any(row["trouble"] for row in figures) else 0


if __name__ == "__main__":
    sys.exit(main())
