"""`taskcomm study ...`: parse and call. It loads with the command line: no import here may take time."""

from pathlib import Path
from typing import Annotated

import typer

study = typer.Typer(
    name="study",
    help="A study in the browser: make its folder, serve it, see how it stands, export it.",
    no_args_is_help=True,
)

NewFolder = Annotated[Path, typer.Argument(metavar="DIR", help="Folder to make; it must be new or empty.")]
Folder = Annotated[
    Path, typer.Argument(metavar="DIR", help="Folder of the study.", exists=True, file_okay=False)
]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON, and nothing else, on stdout.")]


@study.callback()
def group() -> None:
    """A study in the browser: make its folder, serve it, see how it stands, export it."""


@study.command(epilog="Example: taskcomm study new my-study --design design.toml --seed 7")
def new(
    folder: NewFolder,
    design: Annotated[
        Path | None,
        typer.Option(help="Design to start from (default: the one shipped).", exists=True, dir_okay=False),
    ] = None,
    models: Annotated[
        list[Path] | None,
        typer.Option(
            "--model", help="Model file that the design names; repeatable.", exists=True, dir_okay=False
        ),
    ] = None,
    texts: Annotated[
        Path | None,
        typer.Option(
            help="Folder of words (en.toml, ...), over those shipped.", exists=True, file_okay=False
        ),
    ] = None,
    teachers: Annotated[int | None, typer.Option(min=1, help="Teachers, instead of the design's.")] = None,
    language: Annotated[str | None, typer.Option(help="Language, instead of the design's: en, de.")] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed, instead of the design's.")] = None,
    json: Json = False,
) -> None:
    """Make the folder of a study: its design and texts, the assignment drawn, a link for everyone."""
    settings = dict(locals())
    from taskcomm.commands import study_new as command

    raise typer.Exit(command.run(**settings))


@study.command(epilog="Example: taskcomm study status my-study")
def status(folder: Folder, json: Json = False) -> None:
    """Who is where, how the trials went and what was lost, from what is on disk."""
    from taskcomm.commands import study_status as command

    raise typer.Exit(command.run(folder=folder, json=json))
