"""`taskcomm fit`: a teacher model from logs."""

from dataclasses import replace
from pathlib import Path

from learn import fit
from taskcomm.commands.models import at_dt_of_trials, load_model, load_trials, model_files, naming
from taskcomm.commands.output import result_file, run_record, write_record
from taskcomm.commands.terminal import Terminal
from taskcomm.logs import log_files


def run(
    logs: list[Path],
    out: Path,
    initial: str,
    convert_dt: bool,
    delays: bool,
    starts: int,
    max_iter: int,
    task_unknown: bool,
    seed: int,
    json: bool,
) -> int:
    """Fit, write the model and its record, print the table; 4 if it did not converge."""
    settings = {key: value for key, value in locals().items() if key not in ("json", "logs")}
    terminal = Terminal(json)
    start = load_model(initial, "--initial")
    with result_file(out) as part:
        trials, places = load_trials(logs, terminal)
        record = run_record("fit", settings, [*log_files(logs), *model_files([initial])])
        if task_unknown:
            trials = [replace(trial, task=None) for trial in trials]
        terminal.message(f"fitting {len(trials)} trials, {sum(int(t.presses.sum()) for t in trials)} presses")
        world = trials[0].world
        steps = {trial.dt for trial in trials}
        start = at_dt_of_trials(start, initial, world, steps, convert_dt, terminal)
        with naming(places), terminal.progress("fitting", starts + 2) as progress:
            result = fit(
                trials, world=world, initial=start, delays=delays, starts=starts, max_iter=max_iter,
                seed=seed, progress=lambda done, _total: progress(done),
            )  # fmt: skip
        result.model.save(part)
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
    terminal.line(f"{out}: the model")
    if not result.converged:
        terminal.message(f"{result.status}; the model says so in its provenance")
        return 4
    return 0
