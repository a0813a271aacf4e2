"""`taskcomm fit`: a teacher model from logs."""

from dataclasses import replace
from pathlib import Path

import typer

from learn import fit
from learn.settings import Settings
from learn.timescale import settings_at
from taskcomm.commands import cues
from taskcomm.commands.models import at_dt_of_trials, load_model, load_trials, model_files, naming
from taskcomm.commands.output import result_file, run_record, write_record
from taskcomm.commands.terminal import Terminal
from taskcomm.cuetable import read_with_places
from taskcomm.logs import log_files


def run(
    logs: list[Path],
    out: Path,
    initial: str,
    convert_dt: bool,
    delays: bool,
    decays: bool,
    starts: int,
    max_iter: int,
    task_unknown: bool,
    dt: float | None,
    folds: int,
    figure: Path | None,
    seed: int,
    jobs: int,
    json: bool,
) -> int:
    """Fit, write the model and its record, print the table; 4 if it did not converge.

    A fit to cue tables is then set beside other accounts of the same presses.
    """
    settings = {key: value for key, value in locals().items() if key not in ("json", "jobs", "logs")}
    terminal = Terminal(json)
    tables = cues.are_cue_tables(logs, {"--dt": dt, "--figure": figure})
    if tables and task_unknown:
        raise typer.BadParameter("a cue table has no tasks", param_hint="--task-unknown")
    given = not tables or initial != "intuitive"
    start = load_model(initial, "--initial")
    with result_file(out) as part, cues.figure_files(figure, folds, logs) as drawing:
        trials, places = read_with_places(logs, dt) if tables else load_trials(logs, terminal)
        start = start if given else cues.start_for(trials)
        record = run_record("fit", settings, [*log_files(logs), *model_files([initial])])
        if task_unknown:
            trials = [replace(trial, task=None) for trial in trials]
        terminal.message(f"fitting {len(trials)} trials, {sum(int(t.presses.sum()) for t in trials)} presses")
        world = trials[0].world
        steps = {trial.dt for trial in trials}
        start = at_dt_of_trials(start, initial, world, steps, convert_dt, terminal)
        chosen = Settings(delays=delays, decays=decays, starts=starts, max_iter=max_iter, seed=seed)
        with naming(places), terminal.progress("fitting", starts + 2) as progress:
            result = fit(
                trials, world=world, initial=start, settings=settings_at(start.dt, chosen),
                progress=lambda done, _total: progress(done),
            )  # fmt: skip
        result.model.save(part)
        found = None
        if tables and folds > 1:
            found = cues.compared(
                trials, result, given=given, folds=folds, seed=seed, jobs=jobs, terminal=terminal
            )
            cues.draw_waits(trials, found, drawing)
    write_record(record, out)
    terminal.document(
        {
            "command": "fit",
            "out": str(out),
            "converged": result.converged,
            "log_likelihood": result.log_likelihood,
            "trials": len(trials),
            "status": result.status,
            "parameters": [row._asdict() for row in result.table()],
            "remarks": list(result.remarks),
            **({} if found is None else {"comparison": found.to_json()}),
        }
    )
    terminal.table(
        f"Teacher model fitted to {len(trials)} trials: log-likelihood {result.log_likelihood:.2f} nats",
        [
            "parameter",
            "intuitive" if initial == "intuitive" else "initial",
            "learned",
            "presses",
            "steps",
            "mark",
        ],
        [
            [
                row.parameter,
                *(f"{x:.4g}" for x in row[1:3]),
                f"{row.presses:.1f}",
                f"{row.steps:.0f}",
                row.mark,
            ]
            for row in result.table()
        ],
    )
    for remark in result.remarks:
        terminal.line(f"- {remark}")
    if found is not None:
        cues.say(found, trials, terminal)
    terminal.line(f"{out}: the model")
    if figure is not None:
        terminal.line(f"{figure}: times to the first press; {cues.numbers_of(figure)}: its numbers")
    if not result.converged:
        terminal.message(f"{result.status}; the model says so in its provenance")
        return 4
    return 0
