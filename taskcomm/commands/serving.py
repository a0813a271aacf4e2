"""`taskcomm serve` and `taskcomm study serve`: parse and call. Loaded with the command line, so light."""

from pathlib import Path
from typing import Annotated

import typer

from taskcomm.commands.study import Folder, Json, study

Host = Annotated[
    str, typer.Option(help="Address to listen on; others than this machine reach 0.0.0.0 or a name of it.")
]
Port = Annotated[int, typer.Option(min=0, max=65535, help="Port; 0 takes a free one.")]
Origins = Annotated[
    list[str] | None,
    typer.Option("--origin", help="Another address that pages may come from (behind a proxy); repeatable."),
]


def serve(
    out: Annotated[
        Path | None, typer.Option(help="New folder for the trial (default: named by the time).")
    ] = None,
    operator: Annotated[
        bool, typer.Option("--operator", help="A person controls the robot, from a page of their own.")
    ] = False,
    model: Annotated[str, typer.Option(help="The robot's model: a file, or 'intuitive'.")] = "intuitive",
    horizon: Annotated[int, typer.Option(min=1, max=8, help="Planning horizon in steps of 0.5 s.")] = 5,
    threshold: Annotated[
        float, typer.Option(min=0.5, max=0.999999, help="Belief above which Final is shown.")
    ] = 0.98,
    balls: Annotated[int, typer.Option(min=2, max=6, help="Balls in the world.")] = 3,
    distances: Annotated[int, typer.Option(min=1, max=6, help="Distances on the scale.")] = 4,
    task: Annotated[
        str | None, typer.Option(help="The card, as in 1,2,4: ball, other ball, distance (default: drawn).")
    ] = None,
    limit: Annotated[float, typer.Option(min=1, max=3600, help="Longest trial, in seconds.")] = 300.0,
    language: Annotated[str, typer.Option(help="Language of the pages: en or de.")] = "en",
    host: Host = "127.0.0.1",
    port: Port = 8000,
    origin: Origins = None,
    stay: Annotated[bool, typer.Option("--stay", help="Go on serving when the trial is over.")] = False,
    json: Json = False,
) -> None:
    """One trial in the browser, now: teach the robot with the spacebar."""
    settings = dict(locals())
    from taskcomm.commands import serve as command

    raise typer.Exit(command.one_trial(**settings))


@study.command(name="serve", epilog="Example: taskcomm study serve my-study --port 8000")
def serve_study(
    folder: Folder,
    host: Host = "127.0.0.1",
    port: Port = 8000,
    origin: Origins = None,
    processes: Annotated[int, typer.Option(min=1, max=64, help="Processes that plan.")] = 1,
    lockstep: Annotated[
        bool, typer.Option("--lockstep", help="No clock: a step ends when every bot is done with it.")
    ] = False,
    json: Json = False,
) -> None:
    """Serve a study until Ctrl-C; after that, or after a crash, the same command goes on with it."""
    settings = dict(locals())
    from taskcomm.commands import serve as command

    raise typer.Exit(command.study(**settings))
