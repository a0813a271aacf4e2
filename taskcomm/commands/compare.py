"""`taskcomm compare`: teacher models against each other, into a report."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from learn.compare import Comparison, compare_models
from learn.held_out import LEARNED
from learn.outcome_files import write_comparison
from learn.report import span
from taskcomm.commands.models import at_dt_of_trials, load_model, load_trials, model_files, naming
from taskcomm.commands.output import result_directory, run_record, sha256_of, write_json
from taskcomm.commands.terminal import Terminal
from taskcomm.logs import log_files
from taskcomm.teacher import TeacherModel


def run(
    logs: list[Path],
    out: Path,
    models: list[str] | None,
    closed_loop: int,
    teacher: list[str] | None,
    convert_dt: bool,
    folds: int,
    decisions: int,
    blind: bool,
    delays: bool,
    starts: int,
    horizon: int,
    threshold: float,
    max_steps: int,
    seed: int,
    jobs: int,
    json: bool,
) -> int:
    """Compare, write the report, print a summary; 4 if the fit to all trials did not converge."""
    settings = {key: value for key, value in locals().items() if key not in ("json", "jobs", "logs")}
    terminal = Terminal(json)
    named = models or ["intuitive"]
    arms = arms_of(named)
    truths = [load_model(name, "--teacher") for name in teacher or ()]
    note = ", ".join(teacher) if teacher else f"the model learned from all of these logs, `{LEARNED}`"
    with result_directory(out) as part:
        trials, places = load_trials(logs, terminal)
        world, steps = trials[0].world, {trial.dt for trial in trials}

        def ready(models: Iterable[TeacherModel], names: Iterable[str]) -> list[TeacherModel]:
            pairs = zip(models, names, strict=True)
            return [at_dt_of_trials(one, name, world, steps, convert_dt, terminal) for one, name in pairs]

        arms = dict(zip(arms, ready(arms.values(), named), strict=True))
        truths = ready(truths, teacher or ())
        start = arms.get("intuitive") or ready([TeacherModel.intuitive()], ["intuitive, the first start"])[0]
        files = [*log_files(logs), *model_files([*named, *(teacher or ())])]
        record = run_record("compare", settings, files)
        options = {"initial": start, "delays": delays, "starts": starts}
        with naming(places):
            found = compare_models(
                trials, arms, truth=truths, truth_note=note, folds=folds, blind=blind, decisions=decisions,
                loop_trials=closed_loop, horizon=horizon, threshold=threshold, max_steps=max_steps, seed=seed,
                jobs=jobs, fit_options=options, stage=terminal.progress,
            )  # fmt: skip
        written = write_comparison(found, trials, part, title="Comparison of teacher models")
        write_json(found.to_json(), part / "comparison.json")
        outputs = {path.name: sha256_of(path) for path in [*written, part / "comparison.json"]}
        write_json({**record, "outputs": outputs}, part / "run.json")
    terminal.document({"command": "compare", "out": str(out), **found.to_json()})
    summarise(found, terminal)
    terminal.line(f"{out / 'report.md'}: the report, with figures and tables beside it")
    if not found.fitted.converged:
        terminal.message("the fit did not converge; its figures are marked")
        return 4
    return 0


def arms_of(named: Sequence[str]) -> dict[str, TeacherModel]:
    """The models by the names of their arms: 'intuitive', or the stem of the file, made distinct."""
    arms: dict[str, TeacherModel] = {}
    for name in named:
        model = load_model(name, "--models")
        stem = name if name == "intuitive" else Path(name).stem
        arm = f"{stem} (file)" if stem in (LEARNED, "input-blind") else stem
        while arm in arms:
            arm += "'"
        arms[arm] = model
    return arms


def summarise(found: Comparison, terminal: Terminal) -> None:
    """Tables for people."""
    scored, loop, base = found.held_out, found.loop, found.baseline
    terminal.table(
        f"Held-out log-likelihood, {found.trials} trials of {found.people} people (nats)",
        ["model", "per trial", f"minus {base}", "per press"],
        [
            [
                arm + (" (in-sample)" if scored.in_sample[arm].any() else ""),
                span(scored.per_trial(arm)),
                "" if arm == base else span(scored.per_trial(arm, base)),
                span(scored.per_press(arm), ".3f"),
            ]
            for arm in scored.arms
        ],
    )
    if loop is not None:
        terminal.table(
            f"Closed loop, {loop.trials} simulated trials",
            ["robot", "mean time (s)", f"time / {base}", "share right", "timeouts"],
            [
                [
                    arm,
                    span(loop.mean(arm, "time"), ".1f"),
                    "" if arm == base else span(loop.time_ratio(arm, base)),
                    span(loop.mean(arm, "correct"), ".3f"),
                    int(loop.timeout(arm).sum()),
                ]
                for arm in loop.arms
            ],
        )
