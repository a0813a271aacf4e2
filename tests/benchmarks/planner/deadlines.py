"""How far the planner looks by a deadline, what it proves of the steps beyond, and how late it is."""

import time
from typing import Any

import numpy as np
from benchmarks.planner.measure import SEED
from benchmarks.planner.situations import Situations

from taskcomm.planner import EntropyPlanner

DEADLINE = 0.4
FURTHEST = 10
SMALL = 0.01  # nats
LEGEND = f"""
With a deadline of {DEADLINE:g} s, {FURTHEST} steps at most.
  horizon       steps at which the action is proven to be the best
  regret        nats by which the action can be worse than the best one at {FURTHEST} steps, as certified;
                small: decisions with less than {SMALL:g} nats; optimal: proven the best at {FURTHEST}
  late          wall time beyond the deadline as a share of the step (a busy machine shows here)
"""
COLUMNS = (
    ("decisions of", 12), ("balls", 5), ("tasks", 5), ("decided", 11), ("horizon: least", 14),
    ("median", 7), ("most", 7), ("regret: median", 14), ("p90", 7), ("small", 7), ("optimal", 7),
    ("late: median", 12), ("p99", 7), ("p99.9", 7), ("max", 7), ("in time", 7),
)  # fmt: skip


def reached(situations: Situations, seconds: float) -> dict[str, Any]:
    """Horizons and lateness over decisions drawn with a fixed seed, until `seconds` are spent."""
    world, model, found = situations.world, situations.model, situations.found
    planner = EntropyPlanner(world, model, FURTHEST)
    horizons, regrets, optimal, late = [], [], [], []
    began = time.perf_counter()
    for index in np.random.default_rng(SEED).permutation(len(found)):
        if time.perf_counter() - began > seconds:
            break
        situation = found[index]
        believed, before = situation.before
        planner.plan(believed, before, deadline=DEADLINE)  # the world near it is known, as on the way
        started = time.perf_counter()
        decision = planner.plan(situation.belief, situation.state, deadline=DEADLINE)
        late.append((time.perf_counter() - started - DEADLINE) / model.dt)
        assert decision.certificate is not None
        horizons.append(decision.horizon)
        regrets.append(decision.certificate.regret)
        optimal.append(decision.certificate.optimal)
    return {
        "name": situations.name,
        "num_balls": world.num_balls,
        "tasks": len(world.tasks),
        "of": len(found),
        "decisions": len(horizons),
        "horizon_least": min(horizons),
        "horizon_median": float(np.median(horizons)),
        "horizon_most": max(horizons),
        "regret_median": float(np.median(regrets)),
        "regret_p90": float(np.quantile(regrets, 0.9, method="higher")),
        "regret_small": float(np.mean(np.array(regrets) < SMALL)),
        "optimal": float(np.mean(optimal)),
        "late_median": float(np.median(late)),
        "late_p99": float(np.quantile(late, 0.99, method="higher")),
        "late_p999": float(np.quantile(late, 0.999, method="higher")),
        "late_max": max(late),
        "within_step": float(np.mean([DEADLINE + share * model.dt <= model.dt for share in late])),
    }


def cells(row: dict[str, Any]) -> list[str]:
    return [
        row["name"],
        *(str(row[key]) for key in ("num_balls", "tasks")),
        f"{row['decisions']}/{row['of']}",
        *(f"{row[key]:g}" for key in ("horizon_least", "horizon_median", "horizon_most")),
        *(f"{row[key]:.3g}" for key in ("regret_median", "regret_p90")),
        *(f"{row[key]:.1%}" for key in ("regret_small", "optimal")),
        *(
            "in time" if row[key] <= 0 else f"{row[key]:.2%}"
            for key in ("late_median", "late_p99", "late_p999", "late_max")
        ),
        f"{row['within_step']:.1%}",
    ]
