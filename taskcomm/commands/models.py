"""Teacher models named on the command line, and the trials they are used on."""

from collections.abc import Sequence
from pathlib import Path

import typer

from taskcomm.teacher import TeacherModel

LOG_ENDINGS = (".jsonl", ".jsonl.gz")


def load_model(named: str, option: str) -> TeacherModel:
    """'intuitive', or the model of a file; a usage error names the option if there is no such file."""
    if named == "intuitive":
        return TeacherModel.intuitive()
    if not Path(named).is_file():
        raise typer.BadParameter(f"{named!r} is neither 'intuitive' nor a model file", param_hint=option)
    return TeacherModel.load(named)


def model_files(named: Sequence[str]) -> list[Path]:
    """Those of the names that are files, for their hashes."""
    return [Path(name) for name in named if Path(name).is_file()]


def log_files(paths: Sequence[Path]) -> list[Path]:
    """The log files that paths stand for: themselves, or the logs within a directory, by name."""
    files: list[Path] = []
    for path in paths:
        inside = sorted(file for file in path.rglob("*") if file.name.endswith(LOG_ENDINGS))
        files += inside if path.is_dir() else [path]
    return files
