"""Teacher models named on the command line."""

from collections.abc import Sequence
from pathlib import Path

import typer

from taskcomm.teacher import TeacherModel


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
