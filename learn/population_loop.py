"""Does a robot that knows its teacher reach Final sooner? On simulated teachers who differ.

    python -m learn.population_loop --out notebooks/results

A population and one model for all are fitted to the trials of some teachers. New teachers, drawn like
them, are each met in some trials. Then they teach the same tasks, with the same luck, to robots that have
the model for all, the teacher as updated by those trials, and the teacher's true model.
Nobody took part: every teacher and operator is a program.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from learn.closed_loop import ClosedLoop, Outcome, run_closed_loop
from learn.empirical_bayes import fit_population
from learn.population import Population
from learn.population_study import WORLD, drawn_teachers, study, write_rows
from taskcomm.parallel import map_in_order
from taskcomm.teacher import TeacherModel

POOLED, UPDATED, TRUE = "pooled", "updated", "true"


@dataclass
class Met:
    """New teachers, each met in `known` trials, who then teach every robot in `trials` more."""

    population: Population
    teachers: tuple[TeacherModel, ...]
    known: int
    trials: int
    horizon: int
    seed: int

    def __call__(self, number: int) -> ClosedLoop:
        """The closed loop with one of the teachers."""
        truth = self.teachers[number]
        known = study([truth], self.known, self.seed + 1 + number)
        arms = {
            POOLED: self.population.pooled,
            UPDATED: self.population.teacher(known),
            TRUE: truth,
        }
        seed = self.seed + 1000 + number
        return run_closed_loop(WORLD, arms, truth, self.trials, horizon=self.horizon, seed=seed, jobs=1)


def together(loops: Sequence[ClosedLoop]) -> ClosedLoop:
    """The closed loops of several teachers as one, each teacher a group."""
    outcomes: dict[str, tuple[Outcome, ...]] = {
        arm: tuple(outcome for loop in loops for outcome in loop.outcomes[arm]) for arm in loops[0].arms
    }
    groups = tuple(number for number, loop in enumerate(loops) for _ in range(loop.trials))
    return ClosedLoop(outcomes, groups, loops[0].dt)


def summary(loop: ClosedLoop, about: dict[str, Any]) -> list[dict[str, Any]]:
    """A row for each robot: mean time and share right, and the time as a ratio to that of `pooled`."""
    rows = []
    for arm in loop.arms:
        measured = {
            "time_s": loop.mean(arm, "time"),
            "right": loop.mean(arm, "correct"),
            "time_ratio": loop.time_ratio(arm, POOLED),
        }
        row: dict[str, Any] = {
            **about,
            "robot": arm,
            "trials": loop.trials,
            "teachers": len(set(loop.groups)),
        }
        for name, value in measured.items():
            row |= {
                f"{name}{end}": f"{at:.4f}"
                for end, at in zip(("", "_low", "_high"), _ends(value), strict=True)
            }
        rows.append(row)
    return rows


def _ends(value: Any) -> tuple[float, float, float]:
    return value.estimate, value.low, value.high


def main(arguments: Sequence[str] | None = None) -> int:
    """Fit, meet, teach, and keep the summary."""
    parser = argparse.ArgumentParser(prog="python -m learn.population_loop", description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--spread", type=float, default=0.6)
    parser.add_argument("--fitted", type=int, default=20, help="teachers of the fit, four trials each")
    parser.add_argument("--met", type=int, default=12, help="new teachers")
    parser.add_argument("--known", type=int, default=6, help="trials in which each was met")
    parser.add_argument("--trials", type=int, default=4, help="trials of each robot with each teacher")
    parser.add_argument("--horizon", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    given = parser.parse_args(arguments)
    everybody = drawn_teachers(given.fitted + given.met, given.spread, np.random.default_rng([given.seed, 2]))
    population = fit_population(study(everybody[: given.fitted], 4, given.seed), WORLD, starts=2, draws=200)
    new = tuple(everybody[given.fitted :])
    met = Met(population, new, given.known, given.trials, given.horizon, given.seed)
    loop = together(map_in_order(met, range(len(new)), given.jobs))
    about = {"spread": given.spread, "known": given.known, "horizon": given.horizon, "seed": given.seed}
    rows = summary(loop, about)
    write_rows(rows, given.out / "population-loop.csv")
    for row in rows:
        print(row)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
