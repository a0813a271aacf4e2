"""When a robot says 98%, is it right in 98% of the trials? `make study-calibration`; all of it simulated.

The teachers of `datasets/simulated-study` meet robots that differ in their model: intuitive; learned from
the study's 44 trials; the population's median teacher; and the very teacher's own. The robots go on until
they are sure beyond any threshold of interest, which says what every lower threshold comes to.
"""

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from learn.calibration import Calibration, calibration
from learn.calibration_figure import calibration_figure
from learn.closed_loop import ClosedLoop, run_closed_loop
from taskcomm.parallel import map_in_order
from taskcomm.studies import MEDIAN_MISTAKE, MEDIANS, WORLD
from taskcomm.teacher import TableTop, TeacherModel

STUDY = Path("datasets/simulated-study")
ENDED_AT = 0.9999
NOTE = (
    "Simulated: no person took part. Every arm met the same tasks and draws of the 22 simulated teachers of"
    " datasets/simulated-study; arm 'learned' was fitted to 44 other trials of these teachers, arm 'true' has"
    " each teacher's own model. Intervals resample teachers. Made by: make study-calibration"
)


@dataclass(frozen=True)
class TaughtBy:
    """The trials of one teacher, with every arm and a robot that knows that teacher's own model."""

    robots: Mapping[str, TeacherModel]
    teachers: Sequence[TeacherModel]
    trials: int
    horizon: int
    seed: int

    def __call__(self, number: int) -> ClosedLoop:
        teacher = self.teachers[number]
        return run_closed_loop(
            WORLD, {**self.robots, "true": teacher}, teacher, self.trials, horizon=self.horizon,
            seed=1000 * self.seed + number, jobs=1, threshold=ENDED_AT,
        )  # fmt: skip


def median_teacher() -> TeacherModel:
    """The teacher with the median of every parameter of the study's population."""
    cues = {state: top.cue for state, top in TeacherModel.intuitive().approvals.items()}
    tops = {state: TableTop(cues[state], *values) for state, values in MEDIANS.items()}
    return TeacherModel(mistake=MEDIAN_MISTAKE, approvals=tops)


def robots() -> dict[str, TeacherModel]:
    """The arms that have one model for all teachers; `learned` is fitted here."""
    from learn import fit
    from taskcomm.logs import read_trials

    intuitive = TeacherModel.intuitive()
    learned = fit(read_trials(STUDY / "trials.jsonl"), world=WORLD, initial=intuitive).model
    return {"intuitive": intuitive, "learned": learned, "median": median_teacher()}


def teachers() -> tuple[TeacherModel, ...]:
    """The teachers of the study."""
    documents = json.loads((STUDY / "teachers.json").read_text(encoding="utf-8"))
    return tuple(TeacherModel.from_dict(document) for document in documents.values())


def judged(loops: Sequence[ClosedLoop]) -> dict[str, Calibration]:
    """Calibration of every arm over the loops, one for each teacher; teachers are resampled."""
    groups = [number for number, loop in enumerate(loops) for _ in range(loop.trials)]
    return {
        arm: calibration(
            [outcome for loop in loops for outcome in loop.outcomes[arm]],
            groups,
            ended_at=ENDED_AT,
            dt=loops[0].dt,
        )
        for arm in loops[0].arms
    }


def document(found: Mapping[str, Calibration], work: TaughtBy) -> dict[str, Any]:
    """What is kept of the study: plain values."""
    return {
        "about": NOTE,
        "settings": {
            "teachers": len(work.teachers),
            "trials_per_teacher": work.trials,
            "horizon": work.horizon,
            "seed": work.seed,
            "ended_at": ENDED_AT,
            "models": {name: model.sha256 for name, model in work.robots.items()},
        },
        "arms": {arm: _rounded(one.to_json()) for arm, one in found.items()},
    }


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    return float(f"{value:.6g}") if isinstance(value, float) else value


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study; write its numbers (.json) and its figure."""
    parser = argparse.ArgumentParser(prog="python -m learn.calibration_study", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("notebooks/results/calibration.json"))
    parser.add_argument("--figure", type=Path, default=Path("notebooks/figures/calibration.png"))
    parser.add_argument("--trials", type=int, default=50, help="trials with each of the 22 teachers")
    parser.add_argument("--horizon", type=int, default=3)
    parser.add_argument("--seed", type=int, default=2012)
    parser.add_argument("--jobs", type=int, default=2)
    chosen = parser.parse_args(arguments)
    work = TaughtBy(robots(), teachers(), chosen.trials, chosen.horizon, chosen.seed)
    loops = map_in_order(
        work, range(len(work.teachers)), chosen.jobs, lambda n: print(n, end=" ", flush=True)
    )
    found = judged(loops)
    print()
    for arm, one in found.items():
        print(f"{arm}: said {one.said:.4f}, right {one.right}; for {one.needed.goal:g}: {one.needed}")
    chosen.out.parent.mkdir(parents=True, exist_ok=True)
    chosen.out.write_text(json.dumps(document(found, work), indent=1) + "\n", encoding="utf-8")
    figure = calibration_figure({"simulated closed loop": found})
    figure.savefig(chosen.figure, dpi=150, metadata={"Software": None})
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
