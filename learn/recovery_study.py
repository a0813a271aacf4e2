"""The kept study of recovery: three teachers, up to 1000 trials, the closed loop, and learned robots.

    python -m learn.recovery_study --rows recovery-results --out notebooks/results

Nobody takes part: every teacher and every operator is a program. It takes about half an hour of one
processor. Every fit and every trial of a robot is kept in --rows as soon as it is done: the same command goes
on where it was stopped. The tables in --out (recovery-*.csv, recovery.json) are what the notebook reads.
"""

import argparse
import csv
import json
import platform
import sys
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from learn.plots import csv_text
from learn.recovery import Plan, recover
from learn.recovery_report import Recovery, recovery_of, report, robot_plan, write_recovery
from learn.recovery_robots import RobotPlan, run_robots
from learn.teaching import TRUTHS
from taskcomm.world import BallWorld

OPTIONS = {"starts": 3, "delays": False, "decays": False}
ROBOT_SIZES = (4, 22, 44, 200)
TABLES = ("parameters", "curve", "crossings", "robots")


@dataclass(frozen=True)
class Part:
    """Some teachers, what is done with them, and how many trials of each robot."""

    name: str
    truths: tuple[str, ...]
    plan: Plan
    robot_trials: int

    @property
    def robots(self) -> RobotPlan:
        """The closed loop of learned models, those of the mixed studies."""
        return robot_plan(self.plan, self.robot_trials, ROBOT_SIZES)

    def run(self, rows: Path, jobs: int = 1) -> Recovery:
        """Go on with this part to its end, and sum it up."""
        world, truths = BallWorld(), {name: TRUTHS[name] for name in self.truths}
        fits = recover(rows / self.name, world, truths, self.plan, jobs=jobs, stage=_told)
        robots = []
        if self.robot_trials:
            robots = run_robots(rows / self.name, world, truths, fits, self.robots, jobs=jobs, stage=_told)
        return recovery_of(fits, robots, truths, self.plan)


PARTS = (
    Part(
        "prompt",
        ("prompt",),
        Plan(sizes=(2, 4, 8, 22, 44, 200), repeats=20, pool=1000, loops=3, options=OPTIONS),
        robot_trials=200,
    ),
    Part(
        "thousand",
        ("prompt",),
        Plan(sizes=(1000,), sources=("operator",), repeats=3, pool=3000, intervals=True, options=OPTIONS),
        robot_trials=0,
    ),
    Part(
        "others",
        ("hesitant", "intuitive"),
        Plan(sizes=(2, 4, 8, 22, 44, 200), sources=("both",), repeats=10, pool=600, options=OPTIONS),
        robot_trials=60,
    ),
)


def _told(text: str, total: int) -> AbstractContextManager[Any]:
    print(f"{text}: {total}", file=sys.stderr)
    return nullcontext(lambda _done: None)


def write_tables(found: Sequence[Recovery], parts: Sequence[Part], out: Path) -> None:
    """The tables of all parts together, numbers to four digits, and how they were made."""
    out.mkdir(parents=True, exist_ok=True)
    for table in TABLES:
        of_parts = [getattr(one, table) for one in found if table != "crossings" or len(one.plan.sizes) > 1]
        rows = [_short(row) for of_part in of_parts for row in of_part]
        (out / f"recovery-{table}.csv").write_text(csv_text(rows), encoding="utf-8")
    made = {
        "made_by": "python -m learn.recovery_study",
        "simulated": True,
        "versions": _versions(),
        "parts": [_made(part) for part in parts],
    }
    (out / "recovery.json").write_text(json.dumps(made, indent=1) + "\n", encoding="utf-8")


def _made(part: Part) -> dict[str, Any]:
    return {
        "truths": {name: TRUTHS[name].sha256 for name in part.truths},
        "plan": asdict(part.plan),
        "robots": asdict(part.robots),
    }


def write_one(found: Recovery, number: int, out: Path) -> None:
    """The kept tables with the rows of one of PARTS made anew; `versions` of that part are its own.

    Replaced are rows of its truths and, where they have them, its sources and sizes.
    """
    part, made = PARTS[number], json.loads((out / "recovery.json").read_text(encoding="utf-8"))
    for table, rows in read_tables(out).items():
        new = [_short(row) for row in getattr(found, table)]
        if not new or (table == "crossings" and len(part.plan.sizes) == 1):
            continue
        cells = {_cell(row) for row in new}
        first = next((n for n, row in enumerate(rows) if _cell(row) in cells), len(rows))
        kept = [row for row in rows[first:] if _cell(row) not in cells]
        (out / f"recovery-{table}.csv").write_text(csv_text([*rows[:first], *new, *kept]), encoding="utf-8")
    made["parts"][number] = _made(part) | {"versions": _versions()}
    (out / "recovery.json").write_text(json.dumps(made, indent=1) + "\n", encoding="utf-8")


def _cell(row: dict[str, Any]) -> tuple[Any, ...]:
    return row["truth"], row.get("source"), row.get("size")


def read_tables(folder: Path) -> dict[str, list[dict[str, Any]]]:
    """The kept tables, by name, as rows of plain values: what the figures of a recovery take."""
    tables = {}
    for table in TABLES:
        with (folder / f"recovery-{table}.csv").open(encoding="utf-8", newline="") as file:
            tables[table] = [{k: _value(text) for k, text in row.items()} for row in csv.DictReader(file)]
    return tables


def _value(text: str) -> int | float | str:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def _short(row: dict[str, Any]) -> dict[str, Any]:
    return {k: float(f"{v:.4g}") if isinstance(v, float) else v for k, v in row.items()}


def _versions() -> dict[str, str]:
    from taskcomm import __version__

    return {"taskcomm": __version__, "python": platform.python_version(), "numpy": np.__version__}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run or go on with the study; write its tables and, beside the rows of each part, a report."""
    parser = argparse.ArgumentParser(
        prog="python -m learn.recovery_study", description="The kept study of recovery."
    )
    parser.add_argument("--rows", type=Path, default=Path("recovery-results"), help="folder of the rows")
    parser.add_argument(
        "--out", type=Path, default=Path("notebooks") / "results", help="folder of the tables"
    )
    parser.add_argument("--jobs", type=int, default=1)
    names = [part.name for part in PARTS]
    parser.add_argument("--only", choices=names, help="run one part, and replace its rows in the tables")
    chosen = parser.parse_args(arguments)
    try:
        if chosen.only:
            number = names.index(chosen.only)
            one = PARTS[number].run(chosen.rows, chosen.jobs)
            print(report(one))
            write_one(one, number, chosen.out)
            return 0
        found = [part.run(chosen.rows, chosen.jobs) for part in PARTS]
        for part, one in zip(PARTS, found, strict=True):
            write_recovery(one, chosen.rows / part.name)
            print(report(one))
        write_tables(found, PARTS, chosen.out)
    except (OSError, ValueError) as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
