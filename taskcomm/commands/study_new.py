"""`taskcomm study new`: the folder of a study."""

from pathlib import Path

from taskcomm.commands.terminal import Terminal
from taskcomm.web.study.folder import StudyFolder, template
from taskcomm.web.study.reading import text_of
from taskcomm.web.study.tomlwriting import amended

TITLES = {"de": "Einem Roboter etwas beibringen"}  # of the shipped design in another language


def run(
    folder: Path,
    design: Path | None,
    models: list[Path] | None,
    texts: Path | None,
    teachers: int | None,
    title: str | None,
    language: str | None,
    seed: int | None,
    json: bool,
) -> int:
    """Make the folder; say what was drawn and where the links are."""
    terminal = Terminal(json)
    text = template() if design is None else text_of(design)
    where = "study.toml" if design is None else str(design)
    if design is None and title is None:
        title = TITLES.get(language or "")
    text = amended(text, where, teachers=teachers, title=title, language=language, seed=seed)
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
    if any(study.drawn):
        drawn = ", ".join(
            f"{name} {person}" for name, person in zip(study.operators, study.drawn, strict=True)
        )
        terminal.line(f"Of everybody, numbered from 1, these operate: {drawn}; the others teach, in order.")
    terminal.line(f"Everyone's token is in {study.links}, which only you can read; serving prints the links.")
    terminal.line(f"The words are in {study.texts_dir}: change them before anyone takes part.")
    terminal.line(f"Next: taskcomm study serve {folder}")
    for warning in study.warnings:
        terminal.message(f"warning: {warning}")
    return 0
