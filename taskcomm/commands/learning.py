"""`taskcomm fit, population, structure, recover`: parse and call. No import here may take time."""

from pathlib import Path
from typing import Annotated

import typer

from taskcomm.commands.options import (
    ConvertDt,
    DroppedMass,
    Horizon,
    Intervals,
    Jobs,
    Json,
    LogsOrTables,
    Longest,
    MaxSteps,
    Seed,
    TableStep,
    Threshold,
)

learning = typer.Typer()


@learning.command(epilog="Example: taskcomm fit trials.jsonl --out learned.json --delays")
def fit(
    logs: LogsOrTables,
    out: Annotated[Path, typer.Option(help="Model file to write, in a folder that is there.")],
    initial: Annotated[str, typer.Option(help="Model to start from: a file, or 'intuitive'.")] = "intuitive",
    convert_dt: ConvertDt = False,
    delays: Annotated[bool, typer.Option("--delays", help="Fit the delays too.")] = False,
    decays: Annotated[bool, typer.Option("--decays", help="Fit the decays of the plateaus too.")] = False,
    holds: Annotated[
        bool, typer.Option("--holds", help="Fit how long a plateau holds before it decays.")
    ] = False,
    shared: Annotated[
        bool, typer.Option("--shared", help="Fitted delays, decays and holds: one for all approval states.")
    ] = False,
    observe: Annotated[
        list[str] | None,
        typer.Option(
            help="Fit how M shows: miss, false_press (errors of the key), or channels; several at once."
        ),
    ] = None,
    labels: Annotated[
        bool, typer.Option("--labels", help="Take the reasons that annotators gave for presses as known.")
    ] = False,
    prior_trials: Annotated[
        float, typer.Option(min=0, help="Hold the fit to the initial model, as so many trials would.")
    ] = 0.0,
    intervals: Annotated[
        Intervals, typer.Option(help="95% intervals: from the likelihood, or from teachers drawn again.")
    ] = Intervals.likelihood,
    longest: Longest = None,
    dropped_mass: DroppedMass = 0.0,
    starts: Annotated[int, typer.Option(min=1, help="Starts of EM; the first is the initial model.")] = 6,
    max_iter: Annotated[int, typer.Option(min=1, help="Iterations of EM from each start.")] = 500,
    task_unknown: Annotated[
        bool, typer.Option("--task-unknown", help="Leave the task cards unused, as if they were lost.")
    ] = False,
    dt: TableStep = None,
    folds: Annotated[
        int, typer.Option(min=0, help="Folds of people for the comparison of a cue table; 0 for none.")
    ] = 5,
    figure: Annotated[
        Path | None,
        typer.Option(help="Figure of the times to the first press in a cue table (.png, .svg, .pdf)."),
    ] = None,
    seed: Seed = 0,
    jobs: Jobs = 2,
    json: Json = False,
) -> None:
    """Fit the teacher model to logged trials by EM (not to be trusted: model marked, exit code 4).

    Cue tables, anybody's cues and presses with a row for each step, need no World; the fit to them is set
    beside a constant, the intuitive model, a plateau that decays, and free bins.
    """
    settings = dict(locals()) | {"intervals": intervals.value}
    from taskcomm.commands import fit as command

    raise typer.Exit(command.run(**settings))


@learning.command(epilog="Example: taskcomm population trials.jsonl --out population.json --models teachers")
def population(
    logs: LogsOrTables,
    out: Annotated[Path, typer.Option(help="Population file to write, in a folder that is there.")],
    models: Annotated[
        Path | None, typer.Option(help="Directory for a model file of each teacher; made if missing.")
    ] = None,
    initial: Annotated[str, typer.Option(help="Model to start from: a file, or 'intuitive'.")] = "intuitive",
    convert_dt: ConvertDt = False,
    delays: Annotated[bool, typer.Option("--delays", help="Fit the delays too.")] = False,
    decays: Annotated[bool, typer.Option("--decays", help="Fit the decays of the plateaus too.")] = False,
    full: Annotated[
        bool, typer.Option("--full", help="Let parameters go together; needs many teachers.")
    ] = False,
    longest: Longest = None,
    starts: Annotated[int, typer.Option(min=1, help="Starts of EM for the one model of all.")] = 6,
    draws: Annotated[int, typer.Option(min=20, help="Draws for each teacher in each round.")] = 400,
    rounds: Annotated[int, typer.Option(min=1, help="Rounds at most.")] = 60,
    dt: TableStep = None,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Fit what teachers have in common and how they differ (not converged: marked, exit code 4).

    A teacher is a participant_id. Each one's model leans on the others' as far as the own trials say little.
    """
    settings = dict(locals())
    from taskcomm.commands import population as command

    raise typer.Exit(command.run(**settings))


@learning.command(epilog="Example: taskcomm structure trials.jsonl --out model.json --rest 0 --rest 1")
def structure(
    logs: LogsOrTables,
    out: Annotated[Path, typer.Option(help="Model file to write, in a folder that is there.")],
    initial: Annotated[str, typer.Option(help="Model to start from: a file, or 'intuitive'.")] = "intuitive",
    convert_dt: ConvertDt = False,
    rests: Annotated[
        list[float] | None,
        typer.Option("--rest", min=0, help="Rest to try, in seconds; repeatable (default: 0 to 4 steps)."),
    ] = None,
    confidence: Annotated[
        float, typer.Option(min=0.5, max=0.999, help="How often what is named shall hold the truth.")
    ] = 0.9,
    folds: Annotated[int, typer.Option(min=2, help="Folds of people.")] = 10,
    longest: Longest = None,
    starts: Annotated[int, typer.Option(min=1, help="Starts of EM in thorough fits.")] = 6,
    thorough: Annotated[int, typer.Option(min=1, help="How many structures to fit thoroughly.")] = 3,
    task_unknown: Annotated[
        bool, typer.Option("--task-unknown", help="Leave the task cards unused, as if they were lost.")
    ] = False,
    dt: TableStep = None,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Search which cue drives each mental state, and whether there is a delay, a decay or a rest.

    A greedy search, one factor at a time, by the log-likelihood of people left out. Chosen is the structure
    with the fewest parameters within one standard error of the best, and said is what the trials cannot tell.
    """
    settings = dict(locals())
    from taskcomm.commands import structure as command

    raise typer.Exit(command.run(**settings))


@learning.command(
    epilog="Example: taskcomm recover --truth prompt --sizes 22 44 --closed-loop 50 --out recovery"
)
def recover(
    out: Annotated[Path, typer.Option(help="Directory for rows, report, figures, tables; made if missing.")],
    truth: Annotated[
        list[str] | None,
        typer.Option(
            help="Teachers to recover: prompt, hesitant, intuitive, or model files; several at once"
            " (default: prompt)."
        ),
    ] = None,
    sizes: Annotated[
        list[int] | None,
        typer.Option(min=1, help="Trials in a study, several at once (default: 22 44 200)."),
    ] = None,
    robot: Annotated[
        list[str] | None,
        typer.Option(help="Who moves the robot: operator, planner, or both in turn (default: each of them)."),
    ] = None,
    repeats: Annotated[int, typer.Option(min=1, help="Studies of each size, where the pool has them.")] = 10,
    pool: Annotated[int, typer.Option(min=1, help="Trials simulated of each kind, at most.")] = 400,
    loops: Annotated[
        int, typer.Option(min=0, help="Closed-loop recoveries: plan, log, refit, plan again; 0 for none.")
    ] = 0,
    loop_trials: Annotated[int, typer.Option(min=1, help="Trials of each of these.")] = 200,
    batch: Annotated[int, typer.Option(min=1, help="About so many trials between two refits.")] = 22,
    held_out: Annotated[int, typer.Option(min=1, help="Fresh trials that models are scored on.")] = 200,
    closed_loop: Annotated[
        int, typer.Option(min=0, help="Simulated trials per robot with a learned model; 0 for none.")
    ] = 0,
    intervals: Annotated[
        bool,
        typer.Option("--intervals", help="How often intervals hold the truth; takes several times as long."),
    ] = False,
    delays: Annotated[bool, typer.Option("--delays", help="Fit the delays too.")] = False,
    decays: Annotated[bool, typer.Option("--decays", help="Fit the decays too.")] = False,
    starts: Annotated[int, typer.Option(min=1, help="Starts of EM.")] = 3,
    horizon: Horizon = 3,
    threshold: Threshold = 0.98,
    max_steps: MaxSteps = 600,
    balls: Annotated[int, typer.Option(min=2, help="Balls in the world.")] = 3,
    distances: Annotated[int, typer.Option(min=1, help="Distances on the scale.")] = 4,
    seed: Seed = 0,
    jobs: Jobs = 2,
    json: Json = False,
) -> None:
    """Would a fit find the truth? Simulate studies of known teachers, fit them, compare with the truth.

    Every fit is kept in --out as soon as it is done: the same command goes on where it was stopped.
    """
    settings = dict(locals())
    from taskcomm.commands import recover as command

    raise typer.Exit(command.run(**settings))
