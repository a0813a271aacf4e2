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
    title: Annotated[str | None, typer.Option(help="Title, instead of the design's.")] = None,
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


@study.command(epilog="Example: taskcomm study export my-study --out my-data-set")
def export(
    folder: Folder,
    out: Annotated[
        Path, typer.Option(help="Folder of the data set: new, empty, or an earlier export.", file_okay=False)
    ],
    authors: Annotated[
        list[str] | None, typer.Option("--author", help="Who made the data set; repeatable.")
    ] = None,
    license: Annotated[str | None, typer.Option(help="Its licence: a name (CC-BY-4.0) or a URL.")] = None,
    citation: Annotated[str | None, typer.Option(help="How to cite it.")] = None,
    json: Json = False,
) -> None:
    """Write the study as a Psych-DS data set with Frictionless metadata: tables, raw logs, no links.

    Of participants who declined, nothing but their place in the study is exported.
    """
    settings = dict(locals())
    from taskcomm.commands import study_export as command

    raise typer.Exit(command.run(**settings))


@study.command(epilog="Example: taskcomm study rehearse my-study --out my-study-rehearsal")
def rehearse(
    folder: Folder,
    out: Annotated[
        Path | None, typer.Option(help="New folder for everything (default: DIR-rehearsal).")
    ] = None,
    teachers: Annotated[int | None, typer.Option(min=1, help="Teachers, instead of the design's.")] = None,
    teacher: Annotated[
        str, typer.Option(help="The teachers: a model file, 'intuitive', or 'spread', a new one for each.")
    ] = "spread",
    at_once: Annotated[int, typer.Option(min=1, help="Teachers at a time; one to each operator.")] = 8,
    processes: Annotated[int, typer.Option(min=1, max=64, help="Processes that plan.")] = 1,
    real_time: Annotated[
        bool, typer.Option("--real-time", help="At the pace of people, instead of full speed.")
    ] = False,
    analysis: Annotated[
        bool, typer.Option(help="Verification, fit and comparison, after export and figures.")
    ] = True,
    seed: Annotated[int, typer.Option(min=0, help="Seed of every random draw.")] = 0,
    json: Json = False,
) -> None:
    """Run a copy of the study with programs in all places, to its export, figures, fit and comparison."""
    settings = dict(locals())
    from taskcomm.commands import study_rehearse as command

    raise typer.Exit(command.run(**settings))
