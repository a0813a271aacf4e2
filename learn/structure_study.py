"""Simulated truths, searched for: how many trials does each difference of structure need to be found?

    python -m learn.structure_study --out structure-results

keeps a row for every simulated study as soon as it is searched, goes on where it stopped, and writes
structure-study.csv from all rows. Nobody took part: every teacher and every operator is a program.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from learn.candidates import Structure, Value
from learn.kept_rows import KeptRows
from learn.plots import csv_text
from learn.structure import search_structure
from taskcomm.operators import ScriptedOperator
from taskcomm.parallel import map_in_order
from taskcomm.simulate import SimulatedTeacher, run_trial
from taskcomm.studies import WORLD, drawn_teacher, population_teacher
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial
from taskcomm.wholefile import write_whole

SEED = 2012
REPEATS = {22: 8, 44: 8, 200: 4, 500: 4}
TRIALS_EACH, MAX_STEPS = 2, 160
MANY = 200  # from here on 5 folds of people, 10 below
RESTS = (0.0, 0.5, 1.0, 1.5)
HARDEST = (
    "delay + decay",
    "intuitive",
    "delay",
    "decay",
    "rest",
    "teachers differ",
    "wrt_lit",
    "mov_closing",
)
DIFFER = "teachers differ"


def truths() -> dict[str, TeacherModel]:
    """The simulated teachers by name: the intuitive structure with the parameters of the large data set, and
    what each changes of it."""
    plain = population_teacher()

    def changed(rest: float = 0.0, **values: Any) -> TeacherModel:
        tops = {state: replace(top, **values) for state, top in plain.approvals.items()}
        return replace(plain, approvals=tops, rest=rest)

    def driven(state: str, cue: str) -> TeacherModel:
        tops = {**plain.approvals, state: replace(plain.approvals[state], cue=cue)}
        return replace(plain, approvals=tops)

    return {
        "intuitive": plain,
        "delay": changed(delay=0.3),
        "decay": changed(decay=6.0),
        "delay + decay": changed(delay=0.3, decay=6.0),
        "rest": changed(rest=1.0),
        "wrt_lit": driven("that_wrt", "wrt_lit"),
        "mov_closing": driven("that_dist", "mov_closing"),
        DIFFER: plain,
    }


def simulated_study(truth: str, count: int, seed: Sequence[int]) -> tuple[Trial, ...]:
    """`count` trials of the scripted operator, two for each simulated teacher, tasks drawn anew.

    Teachers are alike; those of the truth DIFFER have parameters of their own, drawn as for the study set.
    """
    trials = []
    model = truths()[truth]
    for number, rng in enumerate(np.random.default_rng(seed).spawn(count)):
        person, visit = divmod(number, TRIALS_EACH)
        if truth == DIFFER and not visit:
            model = drawn_teacher(rng)
        task = WORLD.tasks[int(rng.integers(len(WORLD.tasks)))]
        teacher = SimulatedTeacher(WORLD, model, task)
        trial = run_trial(
            ScriptedOperator(WORLD), teacher, rng, max_steps=MAX_STEPS, trial_id=f"{person:03d}-{visit}",
            participant_id=f"{person:03d}", trial_index=visit,
        )  # fmt: skip
        trials.append(trial)
    return tuple(trials)


def study_row(truth: str, count: int, repeat: int, seed: int = SEED) -> dict[str, Any]:
    """Simulate a study and search it with quick fits alone: what was chosen, and what is claimed.

    By factor: the value chosen, then the others that are named beside it, parted by "|".
    """
    drawn = (seed, [*truths()].index(truth), count, repeat)
    trials = simulated_study(truth, count, drawn)
    found = search_structure(trials, rests=RESTS, folds=10 if count < MANY else 5, thorough=0)
    start = next(c for c in found.candidates if c.structure == Structure.of(TeacherModel.intuitive()))
    gain, error = (np.nan, np.nan) if start.held_out is None else found.gap(found.chosen, start)
    return {
        "truth": truth,
        "trials": count,
        "repeat": repeat,
        "seed": "-".join(map(str, drawn)),
        "steps": sum(trial.num_steps for trial in trials),
        "presses": int(sum(trial.presses.sum() for trial in trials)),
        "chosen": str(found.chosen.structure),
        "least_bic": str(found.best_bic.structure),
        "tried": len(found.candidates),
        "settled": found.settled,
        "gain": round(gain, 3),
        "gain_error": round(error, 3),
        **{answer.factor: "|".join(map(text_of, answer.named)) for answer in found.answers},
        **{
            f"weights of {answer.factor}": "|".join(
                f"{text_of(value)}: {weight:.4f}"
                for value, weight in answer.weights.items()
                if weight >= 5e-5
            )
            for answer in found.answers
        },
    }


def text_of(value: Value) -> str:
    """A value as it stands in a row."""
    return value if isinstance(value, str) else f"{value:g}"


def wanted(repeats: Mapping[int, int]) -> list[tuple[str, int, int]]:
    """Truth, number of trials and repeat of every study, so that a run that is stopped has some of each.

    The largest first, and, among them, the truths that are the hardest to tell.
    """
    least = min(repeats.values())
    kinds = [(count, repeat) for count in sorted(repeats, reverse=True) for repeat in range(repeats[count])]
    kinds.sort(key=lambda kind: kind[1] * least // repeats[kind[0]])
    order = sorted(truths(), key=HARDEST.index)
    return [(truth, *kind) for kind in kinds for truth in order]


@dataclass
class Study:
    """One simulated study at a time, its row kept in a file."""

    kept: KeptRows

    def __call__(self, item: tuple[str, int, int]) -> None:
        self.kept.append(study_row(*item))
        sys.stderr.write(f"{item[0]}, {item[1]} trials, study {item[2] + 1}\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is missing, then write the table."""
    parser = argparse.ArgumentParser(
        prog="python -m learn.structure_study", description="Search simulated truths."
    )
    parser.add_argument("--out", type=Path, required=True, help="folder for the rows and the table")
    parser.add_argument("--sizes", type=int, nargs="+", default=[*REPEATS], help="numbers of trials")
    parser.add_argument("--repeats", type=int, help="studies of each kind, instead of the default by size")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    chosen = parser.parse_args(arguments)
    repeats = {size: chosen.repeats or REPEATS.get(size, 3) for size in chosen.sizes}
    chosen.out.mkdir(parents=True, exist_ok=True)
    kept = KeptRows(chosen.out / "structure-study.jsonl")
    kept.begin(
        {
            "seed": SEED,
            "rests": RESTS,
            "max_steps": MAX_STEPS,
            "truths": {n: m.sha256 for n, m in truths().items()},
        }
    )
    done = {(row["truth"], row["trials"], row["repeat"]) for row in kept.rows()}
    map_in_order(Study(kept), [study for study in wanted(repeats) if study not in done], chosen.jobs)
    rows = sorted(kept.rows(), key=lambda r: ([*truths()].index(r["truth"]), r["trials"], r["repeat"]))
    write_whole(chosen.out / "structure-study.csv", csv_text(rows).encode())
    return 0


if __name__ == "__main__":
    sys.exit(main())
