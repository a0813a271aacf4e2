"""`taskcomm fit`: a teacher model from logs."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import typer

from learn import fit
from learn.prior import Prior
from learn.result import FitResult
from learn.settings import Settings
from learn.timescale import settings_at, within
from taskcomm.commands import cues, fitted
from taskcomm.commands.models import at_dt_of_trials, load_model, load_trials, model_files, naming
from taskcomm.commands.output import result_file, run_record, write_record
from taskcomm.commands.terminal import Terminal
from taskcomm.cuetable import read_with_places
from taskcomm.logs import log_files
from taskcomm.teacher import TeacherModel


def run(
    logs: list[Path],
    out: Path,
    initial: str,
    convert_dt: bool,
    delays: bool,
    decays: bool,
    holds: bool,
    shared: bool,
    observe: list[str] | None,
    labels: bool,
    prior_trials: float,
    intervals: str,
    longest: float | None,
    dropped_mass: float,
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
    """Fit, write the model and its record, print table and certificate; 4 if it is not to be trusted.

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
        if tables and folds > 1:
            cues.need_people(trials)
        record = run_record("fit", settings, [*log_files(logs), *model_files([initial])])
        if task_unknown:
            trials = [replace(trial, task=None) for trial in trials]
        terminal.message(f"fitting {len(trials)} trials, {sum(int(t.presses.sum()) for t in trials)} presses")
        world = trials[0].world
        steps = {trial.dt for trial in trials}
        start = at_dt_of_trials(start, initial, world, steps, convert_dt, terminal)
        chosen = Settings(
            **_freedoms(delays, decays, holds, shared), prior=_prior(prior_trials), starts=starts,
            max_iter=max_iter, observe=tuple(observe or ()), labels=labels,
            dropped_mass=dropped_mass, seed=seed,
        )  # fmt: skip
        chosen = within(settings_at(start.dt, chosen), longest)
        fitted.say_widened(start, longest, terminal)

        def fitted_from(*also: TeacherModel) -> FitResult:
            with terminal.progress("fitting", starts + len(also) + 2) as progress:
                return fit(
                    trials, world=world, initial=start, settings=chosen, also=also,
                    progress=lambda done, _total: progress(done),
                )  # fmt: skip

        with naming(places):
            result = fitted_from()
            result = fitted.with_intervals(result, trials, intervals, seed, jobs, terminal, again=fitted_from)
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
            "trials": len(trials),
            **fitted.document(result),
            **({} if found is None else {"comparison": found.to_json()}),
        }
    )
    fitted.say(result, len(trials), terminal)
    if found is not None:
        cues.say(found, trials, terminal)
    terminal.line(f"{out}: the model")
    if figure is not None:
        terminal.line(f"{figure}: times to the first press; {cues.numbers_of(figure)}: its numbers")
    if not result.certificate.trusted:
        terminal.message(f"{result.status}; the model says so in its provenance")
        return 4
    return 0


def _prior(trials: float) -> Prior | None:
    try:
        return Prior(trials) if trials else None
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--prior-trials") from None


def _freedoms(delays: bool, decays: bool, holds: bool, shared: bool) -> dict[str, Any]:
    """What is learned beside mistake, peaks, rises and falls, and whether one for all approval states."""
    asked = {"delays": delays, "decays": decays, "holds": holds}
    if shared and not any(asked.values()):
        raise typer.BadParameter("goes with --delays, --decays or --holds", param_hint="--shared")
    return {name: "shared" if wanted and shared else wanted for name, wanted in asked.items()}
