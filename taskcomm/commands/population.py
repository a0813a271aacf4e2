"""`taskcomm population`: what teachers have in common, how they differ, and a model of each."""

import re
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path

import numpy as np

from learn.empirical_bayes import fit_population
from learn.population import Common, Population
from learn.settings import Settings
from learn.timescale import settings_at, within
from taskcomm.commands import cues, fitted
from taskcomm.commands.models import at_dt_of_trials, load_model, load_trials, model_files, naming
from taskcomm.commands.output import result_directory, result_file, run_record, write_record
from taskcomm.commands.terminal import Terminal
from taskcomm.cuetable import read_with_places
from taskcomm.logs import log_files


def run(
    logs: list[Path],
    out: Path,
    models: Path | None,
    initial: str,
    convert_dt: bool,
    delays: bool,
    decays: bool,
    full: bool,
    longest: float | None,
    starts: int,
    draws: int,
    rounds: int,
    dt: float | None,
    seed: int,
    json: bool,
) -> int:
    """Fit, write the population and the teachers' models, print the tables; 4 if it did not converge."""
    settings = {key: value for key, value in locals().items() if key not in ("json", "logs")}
    terminal = Terminal(json)
    tables = cues.are_cue_tables(logs, {"--dt": dt})
    start = load_model(initial, "--initial")
    with result_file(out) as part, nullcontext() if models is None else result_directory(models) as folder:
        trials, places = read_with_places(logs, dt) if tables else load_trials(logs, terminal)
        if tables and initial == "intuitive":
            start = cues.start_for(trials)
        record = run_record("population", settings, [*log_files(logs), *model_files([initial])])
        steps = {trial.dt for trial in trials}
        start = at_dt_of_trials(start, initial, trials[0].world, steps, convert_dt, terminal)
        chosen = Settings(delays=delays, decays=decays, starts=starts)
        chosen = within(settings_at(start.dt, chosen), longest)
        fitted.say_widened(start, longest, terminal)
        terminal.message(f"fitting {len(trials)} trials, {sum(int(t.presses.sum()) for t in trials)} presses")
        with naming(places), terminal.progress("rounds", rounds) as progress:
            found = fit_population(
                trials, trials[0].world, start, settings=chosen, full=full, draws=draws,
                most_rounds=rounds, seed=seed, progress=lambda done, _total: progress(done),
            )  # fmt: skip
        found.save(part)
        if folder is not None:
            names = file_names([teacher.name for teacher in found.teachers])
            everybody = (*(teacher.model for teacher in found.teachers), found.model)
            for model, name in zip(everybody, names, strict=True):
                model.save(folder / f"{name}.json")
    write_record(record, out)
    report(found, out, models, terminal)
    if not found.converged:
        terminal.message(f"{found.status}; the file says so")
        return 4
    return 0


MEAN = "mean-teacher"


def file_names(teachers: Sequence[str]) -> list[str]:
    """A file name, without its ending, for each teacher as far as files can be so named, and the mean one.

    >>> file_names(["p 1", "p:1"])
    ['p_1', 'p_1~2', 'mean-teacher']
    """
    names: list[str] = []
    for teacher in (*teachers, MEAN):
        plain = re.sub(r"[^\w.-]+", "_", teacher).strip(".") or "teacher"
        again = sum(name.split("~")[0] == plain for name in names)
        names.append(f"{plain}~{again + 1}" if again else plain)
    return names


def report(found: Population, out: Path, models: Path | None, terminal: Terminal) -> None:
    """The tables, or with --json the document, which lacks the single models (they are in the files)."""
    document = found.to_dict()
    for teacher in document["teachers"]:
        del teacher["model"]
    terminal.document(
        {"command": "population", "out": str(out), "models": None if models is None else str(models)}
        | {key: value for key, value in document.items() if key not in ("schema", "space", "provenance")}
    )
    gain = found.log_marginal - found.pooled_log_likelihood
    terminal.table(
        f"{len(found.teachers)} teachers: log-likelihood {found.log_marginal:.2f} nats averaged over them,"
        f" {gain:+.2f} against one model for all",
        ["parameter", "mean teacher", "95% of teachers", "spread", "nats", "mark"],
        [
            [name, f"{at:.3g}", f"{low:.3g} to {high:.3g}", _spread(each), f"{each.gain:.1f}", each.mark]
            for each, (name, (at, low, high)) in zip(found.common, found.middle().items(), strict=True)
        ],
    )
    terminal.line("spread: standard deviation over teachers of log odds, log seconds (delay: seconds)")
    terminal.line("nats: what is lost if teachers are held to be alike in it; 1.4 is what chance may give")
    differing = [j for j, each in enumerate(found.common) if not each.mark]
    names = [found.common[j].name for j in differing]
    terminal.table(
        "Teacher by teacher, each given the others",
        ["teacher", "trials", "presses", "own share", *names],
        [
            [each.name, each.trials, each.presses, f"{100 * np.mean(each.own_share):.0f}%"]
            + [f"{found.parameter(each.model, name):.3g}" for name in names]
            for each in found.teachers
        ],
    )
    terminal.line("own share: of what is known of a teacher, how much comes from the own trials, on average")
    terminal.line(f"{out}: the population")
    if models is not None:
        terminal.line(f"{models}: a model of each teacher, and {MEAN}.json for one not met yet")


def _spread(common: Common) -> str:
    low, high = (common.spread * np.exp(way * 1.96 * common.spread_error) for way in (-1, 1))
    return f"{common.spread:.2f} ({low:.2f} to {high:.2f})"
