"""`taskcomm study new`: the folder of a study."""

from pathlib import Path

from taskcomm.commands.terminal import Terminal
from taskcomm.web.study.folder import StudyFolder, template
from taskcomm.web.study.reading import text_of
from taskcomm.web.study.tomlwriting import amended


def run(
    folder: Path,
    design: Path | None,
    models: list[Path] | None,
    texts: Path | None,
    teachers: int | None,
    language: str | None,
    seed: int | None,
    json: bool,
) -> int:
    """Make the folder; say what was drawn and where the links are."""
    terminal = Terminal(json)
    text = template() if design is None else text_of(design)
    where = "study.toml" if design is None else str(design)
    text = amended(text, where, teachers=teachers, language=language, seed=seed)
    study = StudyFolder.new(folder, text, models or (), texts)
    trials = sum(len(participant.trials) for participant in study.participants)
    terminal.document(
        {
            "command": "study new",
            "folder": str(folder),
            "participants": [participant.id for participant in study.participants],
            "operators": list(study.operators),
            "trials": trials,
            "links": str(study.links),
            "warnings": list(study.warnings),
        }
    )
    operators = f", {len(study.operators)} operators" if study.operators else ""
    terminal.line(f"{folder}: {len(study.participants)} teachers{operators}, {trials} trials drawn")
    terminal.line(f"Everyone's token is in {study.links}, which only you can read; serving prints the links.")
    terminal.line(f"The words are in {study.texts_dir}: change them before anyone takes part.")
    terminal.line(f"Next: taskcomm study serve {folder}")
    for warning in study.warnings:
        terminal.message(f"warning: {warning}")
    return 0
