"""`taskcomm figures`: the paper's figures and statistics, from the logs of a study."""

from pathlib import Path
from typing import Any

import typer

from taskcomm.commands.models import check_model, load_model, load_trials, model_files
from taskcomm.commands.output import result_directory, run_record, sha256_of, write_json
from taskcomm.commands.terminal import Terminal
from taskcomm.studylogs import study_logs
from taskcomm.teacher import ModelError, TeacherModel
from taskcomm.trials import Trial
from taskcomm.web.study.sessions import declined, lines_of


def run(
    folder: Path, out: Path, model: str | None, trial: str | None, ending: str, seed: int, json: bool
) -> int:
    """Draw, write figures, numbers, captions and statistics, and say what could not be made and why."""
    from learn.study_report import study_report, write_study_report
    from learn.study_statistics import paired_rows, summary_rows

    terminal = Terminal(json)
    files = study_logs(folder)
    with result_directory(out) as part:
        trials, _ = load_trials(files, terminal)
        if trial is not None and trial not in {one.trial_id for one in trials}:
            raise typer.BadParameter(f"no trial {trial!r} in {folder}", param_hint="--trial")
        models = _Models(folder, model)
        found = study_report(trials, models.of, trial, seed)
        answers = _answers(folder)
        written = write_study_report(found, trials, part, ending=ending, answers=answers, seed=seed)
        settings = {
            "folder": folder,
            "out": out,
            "model": model,
            "trial": trial,
            "format": ending,
            "seed": seed,
        }
        record = run_record("figures", settings, [*files, *model_files([model] if model else [])])
        write_json({**record, "outputs": {path.name: sha256_of(path) for path in written}}, part / "run.json")
    document = {
        "command": "figures",
        "out": str(out),
        "trials": len(trials),
        "figures": {figure.name: figure.caption for figure in found.figures},
        "statistics": summary_rows(trials),
        "paired": paired_rows(trials, seed),
        "not_made": found.not_made,
        "left_out": list(found.left_out),
    }
    terminal.document(document)
    for figure in found.figures:
        terminal.line(f"{out / figure.name}.{ending}: {figure.caption.split('. ')[0]}")
    for name, why in found.not_made.items():
        terminal.message(f"not made: {name}: {why}")
    for why in found.left_out:
        terminal.message(f"left out: {why}")
    terminal.line(f"{out / 'figures.md'}: all of them, with the statistics")
    return 0


def _answers(folder: Path) -> dict[str, list[float]]:
    """What the participants of a study answered in numbers before the trials, by item; {} of other logs."""
    values: dict[str, list[float]] = {}
    for path in sorted((folder / "sessions").glob("*.jsonl")):
        lines = lines_of(path)[0]
        if declined(lines):
            continue
        given: dict[str, Any] = {}
        for line in lines:
            if line.get("kind") == "form" and line.get("name") == "questionnaire":
                given |= line.get("values") or {}
        for item, value in given.items():
            if isinstance(value, int | float) and not isinstance(value, bool):
                values.setdefault(item, []).append(value)
    return values


class _Models:
    """The model of each trial's robot: the one named, or that of the log's hash among those at hand."""

    def __init__(self, folder: Path, named: str | None) -> None:
        self.named = named
        self.model = None if named is None else load_model(named, "--model")
        at_hand = [TeacherModel.intuitive()]
        for path in sorted((folder / "models").glob("*.json")) if folder.is_dir() else ():
            try:
                at_hand.append(TeacherModel.load(path))
            except ModelError:  # a model that no trial asks for does no harm
                continue
        self.at_hand = {one.sha256: one for one in at_hand}

    def of(self, trial: Trial) -> TeacherModel:
        """Raises Missing where the log's model is not at hand, ModelError where it does not fit the world."""
        from learn.study_trials import Missing

        asked = trial.robot_model or {}
        model = self.model or self.at_hand.get(asked.get("sha256", ""))
        name = self.named or str(asked.get("name"))
        if model is None:
            known = (
                f"was run with model {name!r}, which is not at hand"
                if asked
                else "names no model of its robot"
            )
            raise Missing(f"trial {trial.trial_id} {known}; name a file with --model")
        check_model(model, name, trial.world, {trial.dt})
        return model
