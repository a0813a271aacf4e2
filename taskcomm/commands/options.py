"""Options that several commands share. Loaded with the command line: no import here may take time."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer


class Intervals(StrEnum):
    """How a fit says how sure it is."""

    likelihood = "likelihood"
    wald = "wald"
    bootstrap = "bootstrap"
    none = "none"


class Ending(StrEnum):
    """The format of figures."""

    png = "png"
    pdf = "pdf"
    svg = "svg"


Logs = Annotated[list[Path], typer.Argument(help="Trial logs: files, or directories of them.", exists=True)]
LogsOrTables = Annotated[
    list[Path],
    typer.Argument(
        help="Trial logs: files, or directories of them; or cue tables (.csv, .parquet).", exists=True
    ),
]
TableStep = Annotated[
    float | None, typer.Option("--dt", help="Length of a step in seconds, of cue tables without a column dt.")
]
Longest = Annotated[
    float | None,
    typer.Option(
        min=0.01,
        help="Longest rise and fall to look for, in seconds (default: 10, or 20 steps); with a shorter one,"
        " trials with more presses can be fitted.",
    ),
]
DroppedMass = Annotated[
    float,
    typer.Option(
        min=0,
        max=0.09,
        help="Leave out memories that hold no more than this together at a step, where key states are"
        " unknown or a key may miss: smaller and faster; what it may cost is said.",
    ),
]
Seed = Annotated[int, typer.Option(min=0, help="Seed of every random draw.")]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON, and nothing else, on stdout.")]
Jobs = Annotated[int, typer.Option(min=1, help="Processes; results do not depend on it.")]
Horizon = Annotated[int, typer.Option(min=1, max=8, help="Planning horizon in steps of 0.5 s.")]
Threshold = Annotated[float, typer.Option(min=0.5, max=0.999999, help="Belief above which Final is shown.")]
ConvertDt = Annotated[
    bool, typer.Option("--convert-dt", help="Convert models to the step of the logs, approximately.")
]
MaxSteps = Annotated[int, typer.Option(min=1, help="Steps after which a trial is a timeout.")]
