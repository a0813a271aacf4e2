"""`taskcomm replay`: one trial as a model sees it."""

from pathlib import Path
from typing import Any

import typer

from taskcomm.commands.models import check_model, load_model, model_files, refuse_cue_tables, say_marks
from taskcomm.commands.output import result_file, run_record, write_json, write_record
from taskcomm.commands.terminal import Terminal
from taskcomm.explain import Explanation
from taskcomm.logs import LogError, log_files, read_trials
from taskcomm.planner import EntropyPlanner
from taskcomm.replay import BeliefPath, PressReason, belief_path, press_reasons, situation
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial

FIGURES = (".png", ".svg", ".pdf")


def run(
    log: Path,
    model: str,
    trial: str | None,
    out: Path | None,
    explain: int | None,
    horizon: int,
    seed: int,
    json: bool,
) -> int:
    """Replay, write the figure with its numbers, print what was believed; explain one decision if asked."""
    terminal = Terminal(json)
    if out is not None and out.suffix not in FIGURES:
        raise typer.BadParameter(f"{out.name}: must end in {', '.join(FIGURES)}", param_hint="--out")
    teacher = load_model(model, "--model")
    one = _the_trial(log, trial)
    check_model(teacher, model, one.world, {one.dt})
    say_marks(teacher, model, terminal)
    path, reasons = belief_path(one, teacher), press_reasons(one, teacher)
    document = replay_document(one, teacher, path, reasons)
    why = None if explain is None else _explained(one, teacher, explain, horizon)
    if out is not None:
        from learn.replay_figure import replay_figure

        settings = {"log": log, "model": model, "trial": one.trial_id, "out": out, "seed": seed}
        settings |= {} if why is None else {"explain": explain, "horizon": horizon}
        record = run_record("replay", settings, [*log_files([log]), *model_files([model])])
        numbers = out.with_suffix(".json")
        with result_file(out) as figure, result_file(numbers) as table:
            title = f"Trial {one.trial_id} ({one.source}), as {model_name(model)} sees it"
            replay_figure(path, reasons, one.task, title=title).savefig(figure, dpi=150)
            write_json(document, table)
        write_record(record, out)
        terminal.line(f"{out}: the figure; {numbers}: its numbers")
        if why is not None:
            drawing, plan = _write_plan(*why, out)
            terminal.line(f"{drawing}: the plan at step {explain}; {plan}: all of it")
    terminal.document(document if why is None else {**document, "explanation": why[1]})
    _say(one, path, reasons, terminal)
    if why is not None:
        _say_why(*why, terminal)
    return 0


def _explained(
    trial: Trial, model: TeacherModel, step: int, horizon: int
) -> tuple[Explanation, dict[str, Any]]:
    """Why the planner would act as it would before a step of the trial, and that as plain values.

    The plan is over the key; signals up to the step are in the belief.
    """
    try:
        belief, state = situation(trial, model, step)
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--explain") from None
    if model.observation.miss or model.observation.false_press:
        raise typer.BadParameter("plans are explained for keys that never err", param_hint="--explain")
    planner = EntropyPlanner(trial.world, model, horizon, signals=False)
    why = planner.plan(belief, state, exact_values=True).explain()
    moment = {"trial_id": trial.trial_id, "step": step, "time": step * trial.dt}
    return why, {**moment, "logged": str(trial.steps[step].action), **why.to_json()}


def _write_plan(why: Explanation, document: dict[str, Any], out: Path) -> tuple[Path, Path]:
    """Draw the plan beside the figure `out`, and write all of it as JSON; gives both paths."""
    from learn.plan_figure import plan_figure

    drawing = out.with_name(f"{out.stem}-step{document['step']}{out.suffix}")
    with result_file(drawing) as figure, result_file(drawing.with_suffix(".json")) as table:
        title = (
            f"Trial {document['trial_id']}, the decision at step {document['step']} ({document['time']:g} s)"
        )
        plan_figure(why, title).savefig(figure, dpi=150)
        write_json(document, table)
    return drawing, drawing.with_suffix(".json")


def _say_why(why: Explanation, document: dict[str, Any], terminal: Terminal) -> None:
    logged, time = document["logged"], document["time"]
    agrees = "as in the log" if logged == document["action"] else f"the log has {logged}"
    likeliest = max(zip(document["marginal"], document["tasks"], strict=True))
    terminal.line(
        f"\nThe decision at step {document['step']} ({time:g} s; {agrees}), "
        f"{likeliest[1]} being likeliest with {likeliest[0]:.3f}:\n{why}"
    )


def model_name(named: str) -> str:
    """How to call a model in a title."""
    return f"the {named} model" if named == "intuitive" else f"the model {Path(named).stem}"


def replay_document(
    trial: Trial, model: TeacherModel, path: BeliefPath, reasons: tuple[PressReason, ...]
) -> dict[str, Any]:
    """Everything of a replay as plain values."""
    return {
        "trial_id": trial.trial_id,
        "source": trial.source,
        "task": None if trial.task is None else str(trial.task),
        "displayed": None if trial.displayed is None else str(trial.displayed),
        "reason": trial.reason,
        "correct": trial.correct,
        "model": model.sha256,
        "actions": [str(action) for action in trial.actions],
        **path.to_json(),
        "presses": [reason.to_json() for reason in reasons],
    }


def _the_trial(log: Path, wanted: str | None) -> Trial:
    refuse_cue_tables([log])
    trials = read_trials(log)
    if wanted is None and len(trials) == 1:
        return trials[0]
    found = [trial for trial in trials if trial.trial_id == wanted]
    if found:
        return found[0]
    ids = ", ".join(trial.trial_id for trial in trials[:5]) + (", ..." if len(trials) > 5 else "")
    if wanted is None:
        if not trials:
            raise LogError(f"{log}: holds no trial")
        raise typer.BadParameter(f"{log} holds {len(trials)} trials: name one of {ids}", param_hint="--trial")
    raise typer.BadParameter(f"no trial {wanted!r} in {log}; it holds {ids}", param_hint="--trial")


def _say(trial: Trial, path: BeliefPath, reasons: tuple[PressReason, ...], terminal: Terminal) -> None:
    likeliest = path.world.tasks[int(path.marginal[-1].argmax())]
    terminal.line(
        f"trial {trial.trial_id}: {trial.num_steps} steps, {trial.duration:g} s, {len(reasons)} presses;"
        f" task {trial.task}, shown {trial.displayed}; at the end {likeliest} with {path.highest[-1]:.3f},"
        f" entropy {path.entropy[-1]:.3f} nats"
    )
    if not reasons:
        return
    states = list(reasons[0].at_end)
    noted = any(reason.noted is not None for reason in reasons)
    rows = [
        [f"{reason.time:g}", *(f"{reason.at_once[s]:.2f} > {reason.at_end[s]:.2f}" for s in states)]
        + ([reason.noted or ""] if noted else [])
        for reason in reasons
    ]
    columns = ["press at (s)", *states, *(["truly"] if noted else [])]
    terminal.table("Why each press was made: as believed then > with the whole trial known", columns, rows)
