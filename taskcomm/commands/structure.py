"""`taskcomm structure`: which structure of the teacher the logs favour, and what they cannot tell."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from learn.candidates import spoken
from learn.settings import Settings
from learn.structure import StructureSearch, search_structure
from learn.timescale import settings_at, within
from taskcomm.commands import cues, fitted
from taskcomm.commands.models import at_dt_of_trials, load_model, load_trials, model_files, naming
from taskcomm.commands.output import result_file, run_record, write_record
from taskcomm.commands.terminal import Terminal
from taskcomm.cuetable import read_with_places
from taskcomm.logs import log_files
from taskcomm.teacher import TeacherModel

MOST_SHOWN = 12


def run(
    logs: list[Path],
    out: Path,
    initial: str,
    convert_dt: bool,
    rests: list[float] | None,
    confidence: float,
    folds: int,
    longest: float | None,
    starts: int,
    thorough: int,
    task_unknown: bool,
    dt: float | None,
    seed: int,
    json: bool,
) -> int:
    """Search, write the model of the chosen structure and its record, print tables; 4 if its fit is not to be
    trusted."""
    settings = {key: value for key, value in locals().items() if key not in ("json", "logs")}
    terminal = Terminal(json)
    tables = cues.are_cue_tables(logs, {"--dt": dt})
    start = load_model(initial, "--initial")
    with result_file(out) as part:
        trials, places = read_with_places(logs, dt) if tables else load_trials(logs, terminal)
        if tables and initial == "intuitive":
            start = cues.start_for(trials)
        record = run_record("structure", settings, [*log_files(logs), *model_files([initial])])
        if task_unknown:
            trials = [replace(trial, task=None) for trial in trials]
        start = at_dt_of_trials(
            start, initial, trials[0].world, {trial.dt for trial in trials}, convert_dt, terminal
        )
        chosen = within(settings_at(start.dt, Settings(starts=starts, seed=seed)), longest)
        fitted.say_widened(start, longest, terminal)
        with naming(places):
            found = search_structure(
                trials, initial=start, settings=chosen,
                rests=rests or None, folds=folds, confidence=confidence, thorough=thorough,
                tell=terminal.message,
            )  # fmt: skip
        model = _model(found)
        model.save(part)
    write_record(record, out)
    terminal.document(
        {"command": "structure", "out": str(out), "trials": len(trials)}
        | _document(found)
        | {"fit": fitted.document(_fit(found))}
    )
    say(found, terminal)
    fitted.say(_fit(found), len(trials), terminal)
    terminal.line(f"{out}: the model")
    if not _fit(found).certificate.trusted:
        terminal.message(f"{_fit(found).status}; the model says so in its provenance")
        return 4
    return 0


def _fit(found: StructureSearch) -> Any:
    assert found.fitted is not None  # the command asks for at least one thorough fit
    return found.fitted


def _model(found: StructureSearch) -> TeacherModel:
    """The fitted model, with what was chosen and claimed in its provenance."""
    model: TeacherModel = _fit(found).model
    return replace(model, provenance=dict(model.provenance) | {"structure": _claims(found)})


def _claims(found: StructureSearch) -> dict[str, Any]:
    return {
        "chosen": str(found.chosen.structure),
        "rule": "fewest parameters within one standard error of the best held-out log-likelihood",
        "confidence": found.confidence,
        "factors": {
            answer.factor: {
                "chosen": answer.chosen,
                "named": list(answer.named),
                "told": answer.told,
                "weights": {str(value): weight for value, weight in answer.weights.items()},
            }
            for answer in found.answers
        },
    }


def _document(found: StructureSearch) -> dict[str, Any]:
    return _claims(found) | {
        "least_bic": str(found.best_bic.structure),
        "settled": found.settled,
        "people": found.bench.num_people,
        "folds": int(found.bench.fold.max()) + 1,
        "candidates": found.rows(),
    }


def say(found: StructureSearch, terminal: Terminal) -> None:
    """The candidates and the answers, for people."""
    bench, rows = found.bench, found.rows()
    shown = [row for row in rows if row["held_out"] is not None][:MOST_SHOWN]
    sources = ", ".join(sorted({trial.source for trial in bench.trials}))
    terminal.line(f"Structure of the initial model: {found.initial}.")
    terminal.table(
        f"Structures, {len(bench.trials)} trials ({sources}) of {bench.num_people} people: held-out"
        " log-likelihood less the best",
        ["beside the initial", "parameters", "held out", "standard error", "BIC less least", ""],
        [
            [
                row["beside_initial"],
                row["parameters"],
                f"{row['held_out']:.2f}",
                f"{row['standard_error']:.2f}",
                f"{row['bic']:.2f}",
                "chosen" if row["chosen"] else "",
            ]
            for row in shown
        ],
    )
    terminal.line(f"{len(rows) - len(shown)} others were tried and fell behind.")
    terminal.line()
    if not found.settled:
        terminal.message("warning: the search still changed in its last round")
    terminal.table(
        f"What the trials tell, at {found.confidence:.0%} confidence",
        ["factor", "chosen", "cannot tell it from"],
        [
            [answer.factor, spoken(answer.chosen), ", ".join(map(spoken, answer.named[1:])) or "-"]
            for answer in found.answers
        ],
    )
