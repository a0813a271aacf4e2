"""Do the intervals hold what they promise? Studies simulated from a known truth, and how often it is covered.

    python -m learn.coverage --studies 200 --trials 22 --seed 0 --out notebooks/results/coverage.csv

Nobody took part: every teacher and every operator here is a program. Every study is kept in a .jsonl file
beside the table as soon as it is done; a run that was stopped goes on where it was.
"""

import argparse
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import ndtri

from learn.certainty import uncertainty
from learn.coordinates import NAMES, model_at, names_of, vector_of
from learn.em import fit
from learn.intervals import Method, ParameterInterval
from learn.kept_rows import KeptRows
from learn.plots import csv_text
from taskcomm.parallel import map_in_order
from taskcomm.studies import WORLD, Session
from taskcomm.teacher import TableTop, TeacherModel
from taskcomm.trials import Trial

HORIZON = 3
DIGITS = 5
TRUTH = TeacherModel(
    mistake=0.01,
    approvals={
        "that_mov": TableTop("mov_lit", 0.20, 1.2, 1.3),
        "that_wrt": TableTop("wrt_lit_while_mov_held", 0.20, 1.2, 1.3),
        "that_dist": TableTop("mov_at_dist", 0.15, 1.2, 1.3),
    },
    provenance={"name": "coverage study"},
)


@dataclass(frozen=True)
class Plan:
    """Studies of `trials` trials each, two by each teacher: one with a robot that plans with the intuitive
    model, one with the scripted operator. With `spread`, teachers differ: the logarithm of every parameter
    but mistake has that standard deviation about the truth's."""

    trials: int = 22
    seed: int = 0
    spread: float = 0.0
    methods: tuple[Method, ...] = ("likelihood", "wald")
    resamples: int = 200
    level: float = 0.95
    starts: int = 6

    def study(self, number: int) -> tuple[Trial, ...]:
        """The trials of study `number`, always the same for a seed."""
        rng = np.random.default_rng([self.seed, number])
        trials = []
        for index in range(self.trials):
            if index % 2 == 0:
                teacher = self.teacher(rng)
            session = Session(
                trial_id=f"s{number}-{index}",
                participant_id=f"p{index // 2}",
                trial_index=index % 2,
                condition=("pomdp", "operator")[index % 2],
                teacher=teacher,
                task=WORLD.tasks[int(rng.integers(len(WORLD.tasks)))],
                horizon=HORIZON,
                seed=(self.seed, number, index),
            )
            trials.append(session.run())
        return tuple(trials)

    def teacher(self, rng: np.random.Generator) -> TeacherModel:
        """One teacher of a study."""
        vector = vector_of(TRUTH)
        moved = np.arange(1, 1 + 3 * len(TRUTH.approvals))
        vector[moved] *= np.exp(self.spread * rng.standard_normal(len(moved)))
        times = moved[len(TRUTH.approvals) :]
        vector[times] = np.maximum(vector[times], TRUTH.dt)
        return model_at(vector, TRUTH)


@dataclass(frozen=True)
class StudyOf:
    """One study: simulated, fitted, and kept as a row."""

    plan: Plan
    kept: KeptRows

    def __call__(self, number: int) -> None:
        plan = self.plan
        trials = plan.study(number)
        result = fit(trials, WORLD, starts=plan.starts)
        row: dict[str, Any] = {
            "study": number,
            "converged": result.converged,
            "marks": {name: mark for name, mark in result.marks.items() if mark not in ("", "fixed")},
        }
        for method in plan.methods:
            found = uncertainty(
                result, trials, WORLD, method=method, level=plan.level, resamples=plan.resamples, seed=number
            )
            row["above"] = max(row.get("above", 0.0), round(found.above, DIGITS))
            row[method] = {each.parameter: _short(each) for each in found.intervals if each.how != "none"}
        self.kept.append(row)


def _short(interval: ParameterInterval) -> list[Any]:
    """Estimate, low, high; an open end is null."""
    low = None if interval.open_low else interval.low
    high = None if interval.open_high else interval.high
    return [None if x is None else float(f"{x:.{DIGITS}g}") for x in (interval.estimate, low, high)]


def proportion_interval(hits: int, of: int, level: float = 0.95) -> tuple[float, float]:
    """Wilson's interval of a proportion.

    >>> low, high = proportion_interval(190, 200)
    >>> round(low, 3), round(high, 3)
    (0.91, 0.973)
    """
    z, share = float(ndtri((1 + level) / 2)), hits / of
    middle = (share + z * z / (2 * of)) / (1 + z * z / of)
    half = z / (1 + z * z / of) * math.sqrt(share * (1 - share) / of + z * z / (4 * of * of))
    return middle - half, middle + half


def coverage_rows(rows: Sequence[Mapping[str, Any]], methods: Sequence[str]) -> list[dict[str, Any]]:
    """A row for each method and parameter: how many studies had an interval, in what share it held the
    truth (with Wilson's 95% interval), on which side it missed, how often it was open, how wide it was.

    `width` is the median of high / low where both ends are closed.
    """
    truth = dict(zip(names_of(list(TRUTH.approvals)), vector_of(TRUTH), strict=True))
    table = []
    for method in methods:
        for state in ("", *TRUTH.approvals):
            for kind in ("mistake",) if not state else NAMES[:3]:
                name = f"{state}.{kind}" if state else kind
                found = [row[method][name] for row in rows if name in row[method]]
                if not found:
                    continue
                below = sum(low is not None and low > truth[name] for _, low, _ in found)
                above = sum(high is not None and high < truth[name] for _, _, high in found)
                hits = len(found) - below - above
                low, high = proportion_interval(hits, len(found))
                closed = [
                    high / low for _, low, high in found if low is not None and high is not None and low
                ]
                table.append(
                    {
                        "method": method,
                        "parameter": name,
                        "truth": float(truth[name]),
                        "studies": len(rows),
                        "intervals": len(found),
                        "coverage": round(hits / len(found), 4),
                        "coverage_low": round(float(low), 4),
                        "coverage_high": round(float(high), 4),
                        "all_above_truth": below,
                        "all_below_truth": above,
                        "open_low": sum(low is None for _, low, _ in found),
                        "open_high": sum(high is None for _, _, high in found),
                        "median_estimate": float(np.median([estimate for estimate, _, _ in found])),
                        "width": round(float(np.median(closed)), 3) if closed else "",
                    }
                )
    return table


def run(plan: Plan, studies: int, out: Path, jobs: int = 1) -> list[dict[str, Any]]:
    """The table of `coverage_rows` over `studies` studies, written to `out`; goes on where it had stopped."""
    kept = KeptRows(out.with_suffix(".jsonl"))
    about = {"made_by": "learn.coverage", "simulated": True, "truth": vector_of(TRUTH)[:10].tolist()}
    kept.begin(about | {"plan": {**plan.__dict__, "methods": list(plan.methods)}})
    done = {row["study"] for row in kept.rows()}
    left = [number for number in range(studies) if number not in done]
    map_in_order(StudyOf(plan, kept), left, jobs, lambda count: _tell(len(done) + count, studies))
    rows = [row for row in kept.rows() if row["study"] < studies]
    table = coverage_rows(rows, plan.methods)
    out.write_text(csv_text(table), encoding="utf-8")
    return table


def _tell(done: int, total: int) -> None:
    if done % 10 == 0 or done == total:
        print(f"{done} of {total} studies", file=sys.stderr)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study and write its table."""
    parser = argparse.ArgumentParser(prog="python -m learn.coverage", description=__doc__)
    plan = Plan()
    parser.add_argument("--studies", type=int, default=200)
    parser.add_argument("--trials", type=int, default=plan.trials)
    parser.add_argument("--seed", type=int, default=plan.seed)
    parser.add_argument("--spread", type=float, default=plan.spread, help="of teachers, in logarithms")
    parser.add_argument("--methods", nargs="+", default=list(plan.methods))
    parser.add_argument("--resamples", type=int, default=plan.resamples)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args(arguments)
    plan = replace(
        plan, trials=given.trials, seed=given.seed, spread=given.spread, methods=tuple(given.methods),
        resamples=given.resamples,
    )  # fmt: skip
    given.out.parent.mkdir(parents=True, exist_ok=True)
    run(plan, given.studies, given.out, given.jobs)
    return 0


if __name__ == "__main__":
    sys.exit(main())
