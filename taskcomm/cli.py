"""The command line: parse, call, print. The one place that knows both packages; nobody imports it.

Every command is a module of `taskcomm.commands`, loaded when it is run, so that help is instant.
"""

import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from taskcomm.commands.learning import learning
from taskcomm.commands.options import (
    ConvertDt,
    Ending,
    Horizon,
    Jobs,
    Json,
    Logs,
    MaxSteps,
    Seed,
    TableStep,
    Threshold,
)
from taskcomm.commands.serving import serve
from taskcomm.commands.study import study

DONE, FAILED, USAGE, BAD_DATA, NOT_CONVERGED = range(5)
SPREAD = ("--models", "--truth", "--sizes", "--observe")  # options that take several values at once


app = typer.Typer(
    name="taskcomm",
    help="Human-robot task communication: simulate teachers, fit them, compare robots, replay trials.",
    epilog="Exit codes: 0 done, 1 failed, 2 usage, 3 bad data, 4 a fit not to be trusted."
    " Example: taskcomm demo --out demo-results",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

app.command(epilog="Example: taskcomm serve --operator --out one-trial")(serve)
app.add_typer(study)
app.add_typer(learning)


@app.command(
    epilog="Example: taskcomm simulate --trials 40 --teacher intuitive --robot operator --out trials.jsonl"
)
def simulate(
    out: Annotated[Path, typer.Option(help="Log to write: .jsonl or .jsonl.gz, in a folder that is there.")],
    trials: Annotated[int, typer.Option(min=1, help="Number of trials.")] = 20,
    teacher: Annotated[str, typer.Option(help="The teachers: a model file, or 'intuitive'.")] = "intuitive",
    robot: Annotated[
        str, typer.Option(help="The robot: a model file, 'intuitive', or 'operator'.")
    ] = "intuitive",
    people: Annotated[
        int | None,
        typer.Option(min=1, help="Simulated people the trials are shared out to (default: one a trial)."),
    ] = None,
    horizon: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=8,
            help="Planning horizon in steps of 0.5 s (default: 5; 4 for a key that errs, 3 with signals).",
        ),
    ] = None,
    threshold: Threshold = 0.98,
    max_steps: MaxSteps = 600,
    balls: Annotated[int, typer.Option(min=2, help="Balls in the world.")] = 3,
    distances: Annotated[int, typer.Option(min=1, help="Distances on the scale.")] = 4,
    seed: Seed = 0,
    jobs: Jobs = 2,
    json: Json = False,
) -> None:
    """Run trials of a robot, or of a scripted operator, with simulated teachers; write their log."""
    settings = dict(locals())
    from taskcomm.commands import simulate as command

    raise typer.Exit(command.run(**settings))


@app.command(
    epilog="Example: taskcomm compare trials.jsonl --models intuitive fit.json --closed-loop 100 --out cmp"
)
def compare(
    logs: Logs,
    out: Annotated[Path, typer.Option(help="Directory for the report, figures and tables; made if missing.")],
    models: Annotated[
        list[str] | None,
        typer.Option(
            help="Models beside the refitted one: files or 'intuitive', several at once (default: intuitive)."
        ),
    ] = None,
    closed_loop: Annotated[int, typer.Option(min=0, help="Simulated trials per robot; 0 for none.")] = 100,
    teacher: Annotated[
        list[str] | None,
        typer.Option(
            help="Teachers of the closed loop: model files (default: the model learned from the logs)."
        ),
    ] = None,
    convert_dt: ConvertDt = False,
    folds: Annotated[int, typer.Option(min=2, help="Folds of people.")] = 5,
    decisions: Annotated[int, typer.Option(min=0, help="Logged decisions to plan anew; 0 for none.")] = 300,
    blind: Annotated[bool, typer.Option(help="The HMM that sees presses only, as an arm.")] = True,
    delays: Annotated[bool, typer.Option("--delays", help="Fit the delays too.")] = False,
    starts: Annotated[int, typer.Option(min=1, help="Starts of EM.")] = 3,
    horizon: Horizon = 3,
    threshold: Threshold = 0.98,
    max_steps: MaxSteps = 600,
    seed: Seed = 0,
    jobs: Jobs = 2,
    json: Json = False,
) -> None:
    """Compare teacher models on logged trials they were not fitted to, and as robots in a closed loop."""
    settings = dict(locals())
    from taskcomm.commands import compare as command

    raise typer.Exit(command.run(**settings))


@app.command(
    epilog="Example: taskcomm replay trials.jsonl --model learned.json --trial p01-1 --out replay.png"
)
def replay(
    log: Annotated[Path, typer.Argument(help="Trial log.", exists=True)],
    model: Annotated[str, typer.Option(help="Teacher model: a file, or 'intuitive'.")] = "intuitive",
    trial: Annotated[str | None, typer.Option(help="Id of the trial, where the log has many.")] = None,
    out: Annotated[
        Path | None, typer.Option(help="Figure to write (.png, .svg, .pdf); its numbers go beside it.")
    ] = None,
    explain: Annotated[
        int | None,
        typer.Option(
            metavar="STEP", help="Say why the planner acts as it does at this step of the log (0, 1, ...)."
        ),
    ] = None,
    horizon: Horizon = 5,
    verify: Annotated[
        bool,
        typer.Option(
            "--verify",
            help="Instead, run world and planner again and name the first step that differs from the log:"
            " of all trials, or the one named; exit code 1 where one differs.",
        ),
    ] = False,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """The belief over the time of one trial, and why each press was made, as a model sees them.

    With --explain, also the plan behind one decision; its drawing and its numbers go beside the figure.
    """
    settings = dict(locals())
    if settings.pop("verify"):
        if out is not None or explain is not None:
            raise typer.BadParameter("goes with neither --out nor --explain", param_hint="--verify")
        from taskcomm.commands import verify as verification

        raise typer.Exit(verification.run(log=log, model=model, trial=trial, json=json))
    from taskcomm.commands import replay as command

    raise typer.Exit(command.run(**settings))


@app.command(epilog="Example: taskcomm figures my-study --out figures")
def figures(
    folder: Annotated[
        Path,
        typer.Argument(metavar="DIR", help="Folder of a study, or of trial logs; or a log.", exists=True),
    ],
    out: Annotated[Path, typer.Option(help="Directory for figures, numbers and captions; made if missing.")],
    model: Annotated[
        str | None,
        typer.Option(help="Teacher model of the beliefs: a file, or 'intuitive' (default: the robot's own)."),
    ] = None,
    trial: Annotated[
        str | None, typer.Option(help="Trial of mistake recovery and task marginals (default: by rule).")
    ] = None,
    ending: Annotated[Ending, typer.Option("--format", help="Format of the figures.")] = Ending.png,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """The paper's figures and statistics from the trials of a study, practice left out.

    Each comes with its numbers and a caption; what cannot be made from these trials is named with the reason.
    """
    settings = dict(locals()) | {"ending": ending.value}
    from taskcomm.commands import figures as command

    raise typer.Exit(command.run(**settings))


@app.command(epilog="Example: taskcomm validate trials.jsonl datasets/")
def validate(
    paths: Annotated[
        list[Path],
        typer.Argument(help="Trial logs: files, or directories of them; cue tables.", exists=True),
    ],
    dt: TableStep = None,
    seed: Annotated[int, typer.Option(hidden=True)] = 0,
    json: Json = False,
) -> None:
    """List every problem of trial logs and cue tables; exit code 3 if there is one."""
    from taskcomm.commands import validate as command

    raise typer.Exit(command.run(paths=paths, dt=dt, json=json))


@app.command(epilog="Example: taskcomm demo --out demo-results")
def demo(
    out: Annotated[
        Path, typer.Option(help="Directory for the report, figures and tables; made if missing.")
    ] = Path("demo-results"),
    data: Annotated[
        Path | None, typer.Option(help="Directory of logs (default: datasets/simulated-study).", exists=True)
    ] = None,
    trials: Annotated[int, typer.Option(min=1, help="Simulated trials per robot.")] = 200,
    seed: Seed = 0,
    jobs: Jobs = 2,
    json: Json = False,
) -> None:
    """The whole loop on the shipped data: fit, draw, compare, replay, report; under three minutes."""
    settings = dict(locals())
    from taskcomm.commands import demo as command

    raise typer.Exit(command.run(**settings))


def _print_version(wanted: bool) -> None:
    if wanted:
        from taskcomm import __version__

        typer.echo(f"taskcomm {__version__}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Human-robot task communication: simulate teachers, fit them, compare robots, replay trials."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; the exit code is one of DONE, FAILED, USAGE, BAD_DATA, NOT_CONVERGED."""
    with warnings.catch_warnings():
        warnings.showwarning = _say_warning
        warnings.simplefilter("always", UserWarning)
        try:
            app(args=_spread(SPREAD, sys.argv[1:] if arguments is None else arguments))
        except SystemExit as stop:
            return stop.code if isinstance(stop.code, int) else FAILED
        except Exception as error:
            code = _code_of(error)
            if code is None:
                raise
            sys.stderr.write(f"error: {error}\n")
            return code
    return DONE


def _spread(options: Sequence[str], arguments: Sequence[str]) -> list[str]:
    """`option A B` as `option A option B`: one of `options` takes all that follow it, up to the next option.

    >>> _spread(["--models"], ["--models", "a", "b", "--out", "c"])
    ['--models', 'a', '--models', 'b', '--out', 'c']
    """
    spread: list[str] = []
    option, values = "", -1  # how many the option has taken; below 0 outside of it
    for argument in arguments:
        if argument.startswith("-"):
            option, values = argument, 0 if argument in options else -1
        elif values >= 0:
            spread += [option] if values else []
            values += 1
        spread.append(argument)
    return spread


def _code_of(error: Exception) -> int | None:
    """The exit code of an error that is the user's to mend, or None for one of ours."""
    from taskcomm import LogError
    from taskcomm.belief import ImpossibleObservation
    from taskcomm.lattice import LatticeTooLarge
    from taskcomm.observation import SignalError
    from taskcomm.teacher import ModelError
    from taskcomm.world import InvalidAction

    bad_data: tuple[type[Exception], ...]
    bad_data = (LogError, ModelError, SignalError, ImpossibleObservation, InvalidAction, LatticeTooLarge)
    if "learn.exposure" in sys.modules:
        from learn import FitError

        bad_data = (*bad_data, FitError)
    if "taskcomm.web.study.reading" in sys.modules:
        from taskcomm.web.study.reading import StudyError

        bad_data = (*bad_data, StudyError)
    if isinstance(error, bad_data):
        return BAD_DATA
    return FAILED if isinstance(error, OSError | MemoryError) else None


def _say_warning(message: Warning | str, category: Any, *_where: Any, **_more: Any) -> None:
    sys.stderr.write(f"warning: {message}\n")


if __name__ == "__main__":
    sys.exit(main())
