"""What looking further came to: means and shares by arm, and against one horizon, trial by trial."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from learn.bootstrap import Interval, ratio_interval
from learn.closed_loop import ClosedLoop, Outcome

Row = Mapping[str, Any]
PAPER = "5"  # the horizon of the paper: 2.5 s
NOT_KEPT: tuple[Any, ...] = (np.zeros(0), np.zeros(0), np.zeros(0, dtype=np.bool_))  # the paths of an Outcome
LEGEND = """\
Does looking further help? Simulated: teachers are programs. All robots meet the same tasks and the same
draws of the teachers. Brackets: 95% intervals, trials (or teachers, where there are several) resampled.
  ahead     steps looked ahead; with an s, as far as a decision gets in that time, at most {furthest}
  time      seconds to Final, a timeout counted at its length
  against   time divided by that of the robot with the same model at the horizon named, same trials
  planning  time of a decision as a share of the time step of {dt:g} s: mean, median, 99th percentile
  late      decisions that took more than the step
  reached   steps looked ahead, median over the decisions
"""


@dataclass(frozen=True)
class Arm:
    """A robot of the study: the name of its model, and its mode, "5" (steps) or "0.4s" (a deadline).

    Raises ValueError for a mode that is neither.

    >>> Arm("learned", "5").horizon, Arm("learned", "0.4s").deadline
    (5, 0.4)
    """

    model: str
    mode: str

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[1-9]\d*|\d*\.?\d+s", self.mode) or self.deadline == 0:
            raise ValueError(
                f"horizons: {self.mode!r} is neither steps, such as 5, nor a deadline, such as 0.4s"
            )

    @property
    def name(self) -> str:
        """Model and mode."""
        return f"{self.model} {self.mode}"

    @property
    def horizon(self) -> int | None:
        """Steps to look ahead; None with a deadline."""
        return None if self.mode.endswith("s") else int(self.mode)

    @property
    def deadline(self) -> float | None:
        """Seconds for a decision, or None."""
        return float(self.mode[:-1]) if self.mode.endswith("s") else None

    @property
    def place(self) -> tuple[bool, float]:
        """Where it stands in a list: horizons first, then deadlines."""
        return (self.deadline is not None, self.deadline or float(self.horizon or 0))


def summary(rows: Iterable[Row], dt: float) -> list[dict[str, Any]]:
    """One flat row for each arm, models in the order of their first row, modes from near to far.

    `time` (s), `correct`, `timeout`, `presses` are means over the trials done, `planning` is the mean over
    decisions of their share of the time step, `late` the share of decisions above 1; each with `_low`
    and `_high`. `time_ratio`, `time_difference` and `correct_difference` are against the arm of the
    same model that looks 5 steps ahead, or else the furthest below, on the trials done by both.
    """
    arms: dict[Arm, dict[int, Row]] = {}
    for row in rows:
        arms.setdefault(Arm(row["model"], row["mode"]), {})[row["trial"]] = row
    models = list(dict.fromkeys(arm.model for arm in arms))
    found = []
    for model in models:
        ours = sorted((arm for arm in arms if arm.model == model), key=lambda arm: arm.place)
        base = _reference(ours)
        found += [_arm_summary(arm, arms[arm], base, arms[base], dt) for arm in ours]
    return found


def _reference(arms: Sequence[Arm]) -> Arm:
    near = [arm for arm in arms if arm.horizon is not None and arm.horizon <= int(PAPER)]
    return near[-1] if near else arms[0]


def _arm_summary(
    arm: Arm, rows: Mapping[int, Row], base: Arm, base_rows: Mapping[int, Row], dt: float
) -> dict[str, Any]:
    alone = _loop({arm.name: rows}, dt)
    shares = [np.array(row["share"]) for row in rows.values()]
    every, counts = np.concatenate(shares), np.array([len(share) for share in shares])
    reached = np.concatenate([row["reached"] for row in rows.values()])
    late = ratio_interval([(share > 1).sum() for share in shares], counts, alone.groups)
    planning = ratio_interval([share.sum() for share in shares], counts, alone.groups)
    found: dict[str, Any] = {"model": arm.model, "mode": arm.mode, "trials": len(rows)}
    for what in ("time", "correct", "timeout", "presses"):
        found |= _spread(what, alone.mean(arm.name, what))
    found |= _spread("planning", planning) | _spread("late", late)
    for name, q in (("median", 0.5), ("p99", 0.99), ("max", 1.0)):
        found[f"planning_{name}"] = float(np.quantile(every, q)) if len(every) else None
    found["decisions"] = len(every)
    found["reached_median"] = float(np.median(reached)) if len(reached) else None
    found["reached_mean"] = float(np.mean(reached)) if len(reached) else None
    found["against"] = base.mode
    both = _loop({arm.name: rows, base.name: base_rows}, dt)
    found["trials_of_both"] = both.trials
    if both.trials:
        found |= _spread("time_ratio", both.time_ratio(arm.name, base.name))
        for what in ("time", "correct"):
            found |= _spread(f"{what}_difference", both.difference(arm.name, base.name, what))
    return found | {"seconds_per_trial": float(np.mean([row["seconds"] for row in rows.values()]))}


def _spread(name: str, interval: Interval) -> dict[str, float | None]:
    values = interval.to_json()
    return {name: values["estimate"], f"{name}_low": values["low"], f"{name}_high": values["high"]}


def _loop(arms: Mapping[str, Mapping[int, Row]], dt: float) -> ClosedLoop:
    """The closed loop of these arms on the trials that all of them have done."""
    first, *others = arms.values()
    common = sorted(set(first).intersection(*others))
    outcomes = {
        name: tuple(
            Outcome(row["steps"], row["correct"], row["timeout"], row["presses"], *NOT_KEPT)
            for row in (rows[n] for n in common)
        )
        for name, rows in arms.items()
    }
    return ClosedLoop(outcomes, tuple(first[n]["teacher"] for n in common), dt)


def trial_rows(rows: Iterable[Row], dt: float) -> list[dict[str, Any]]:
    """One row for every trial and arm, for a table file; times in seconds."""
    kept = ("trial", "teacher", "model", "mode", "task")
    return [
        {key: row[key] for key in kept}
        | {"time_s": row["steps"] * dt, "correct": int(row["correct"]), "timeout": int(row["timeout"])}
        | {"presses": row["presses"], "decisions": len(row["share"])}
        for row in rows
    ]


def table(found: Sequence[Row], dt: float, furthest: int) -> str:
    """The summary as text."""
    heading = [
        "model",
        "ahead",
        "trials",
        "time",
        "right",
        "timeouts",
        "against",
        "planning",
        "late",
        "reached",
    ]
    lines = [heading] + [_cells(row) for row in found]
    widths = [max(len(line[n]) for line in lines) for n in range(len(heading))]
    text = "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
        for line in lines
    )
    return f"{LEGEND.format(dt=dt, furthest=furthest)}\n{text}\n"


def _cells(row: Row) -> list[str]:
    compared = row["mode"] != row["against"] and row["trials_of_both"]
    cells = [
        row["model"],
        row["mode"],
        str(row["trials"]),
        _number(row, "time", ".1f"),
        _number(row, "correct", ".1%"),
        _number(row, "timeout", ".1%"),
        f"{row['against']}: {_number(row, 'time_ratio', '.2f')}" if compared else "-",
    ]
    if not row["decisions"]:
        return [*cells, "-", "-", "-"]
    planning = [row[f"planning{which}"] for which in ("", "_median", "_p99")]
    return [
        *cells,
        ", ".join(f"{share:.2g}" for share in planning),
        f"{row['late']:.2%}",
        f"{row['reached_median']:g}",
    ]


def _number(row: Row, what: str, form: str) -> str:
    low, high = (format(row[f"{what}_{end}"], form) for end in ("low", "high"))
    return f"{row[what]:{form}} ({low} to {high})"
