"""Cue tables on the command line: read as trials, and the fit to them beside other accounts."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from taskcomm.commands.output import result_file
from taskcomm.commands.terminal import Terminal
from taskcomm.cuerows import ENDINGS, is_cue_table
from taskcomm.cueworld import CueWorld, intuitive_for
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial

if TYPE_CHECKING:
    from learn.baselines import Baselines
    from learn.result import FitResult

FIGURES = (".png", ".svg", ".pdf")
INTUITIVE, INITIAL = "intuitive table-top", "initial table-top"


def are_cue_tables(paths: Sequence[Path], options: Mapping[str, object]) -> bool:
    """Whether the paths are cue tables, all of them; a usage error where some are not.

    `options` are those for cue tables alone, by their names; one that is given otherwise is another.
    """
    tables = [path for path in paths if is_cue_table(path)]
    if tables and len(tables) < len(paths):
        other = next(path for path in paths if path not in tables)
        raise typer.BadParameter(f"{tables[0]} is a cue table, {other} is not: give one kind at a time")
    idle = [name for name, value in options.items() if value is not None]
    if idle and not tables:
        raise typer.BadParameter(f"is for cue tables ({', '.join(ENDINGS)}) only", param_hint=idle[0])
    return bool(tables)


def start_for(trials: Sequence[Trial]) -> TeacherModel:
    """The intuitive model of the trials' cues and step, where 'intuitive' is asked for."""
    world = trials[0].world
    assert isinstance(world, CueWorld)
    return intuitive_for(world, trials[0].dt)


def need_people(trials: Sequence[Trial]) -> None:
    """FitError, before anything is fitted, where the comparison has nobody to leave out."""
    from learn.exposure import FitError
    from learn.held_out import person_of

    if len({person_of(trial) for trial in trials}) < 2:
        raise FitError(
            "the comparison with other accounts leaves people out in turn, and all trials are of one"
            " (participant_id): --folds 0 fits without it"
        )


def compared(
    trials: Sequence[Trial],
    fitted: "FitResult",
    *,
    given: bool,
    folds: int,
    seed: int,
    jobs: int,
    terminal: Terminal,
) -> "Baselines":
    """The fitted table-top beside the other accounts of the same presses; `given` says that its initial
    model was, by the user."""
    from learn.baselines import compare_baselines

    models = {INTUITIVE: start_for(trials)} | ({INITIAL: fitted.initial} if given else {})
    people = len({trial.participant_id for trial in trials})
    count = min(folds, people if people > 1 else len(trials)) + 1
    with terminal.progress("comparing", count) as progress:
        return compare_baselines(trials, fitted, models, folds=folds, seed=seed, jobs=jobs, progress=progress)


def say(found: "Baselines", trials: Sequence[Trial], terminal: Terminal) -> None:
    """The table for people."""
    from learn.baselines import CONSTANT
    from learn.report import span

    sources = ", ".join(sorted({trial.source for trial in trials}))
    terminal.table(
        f"Accounts of the presses of {len(found.fold)} trials ({sources}); held out by {found.held_out_by},"
        " nats per trial",
        ["account", "parameters", "log-likelihood", "BIC", "held out", f"minus {CONSTANT}"],
        [
            [
                name if arm.converged else f"{name} (a fit did not converge)",
                arm.parameters,
                f"{arm.log_likelihood.sum():.2f}",
                f"{found.bic(name):.1f}",
                f"{found.per_trial(name).estimate:.3f}",
                "" if name == CONSTANT else span(found.per_trial(name, CONSTANT), ".3f"),
            ]
            for name, arm in found.arms.items()
        ],
    )


@contextmanager
def figure_files(
    figure: Path | None, folds: int, inputs: Sequence[Path]
) -> Iterator[tuple[Path, Path] | None]:
    """Where to draw the waits and write their numbers, if asked; said at once if it cannot be done."""
    if figure is None:
        yield None
        return
    if figure.suffix not in FIGURES:
        raise typer.BadParameter(f"{figure.name}: must end in {', '.join(FIGURES)}", param_hint="--figure")
    if folds < 2:
        raise typer.BadParameter("draws what is compared: --folds must be 2 or more", param_hint="--figure")
    numbers = numbers_of(figure)
    if numbers.resolve() in [path.resolve() for path in inputs]:
        raise typer.BadParameter(f"its numbers would overwrite {numbers}", param_hint="--figure")
    with result_file(figure) as drawing, result_file(numbers) as table:
        yield drawing, table


def numbers_of(figure: Path) -> Path:
    """Where the numbers behind a figure go; not to be taken for the cue table that it is drawn from.

    >>> numbers_of(Path("cues.png")).name
    'cues-numbers.csv'
    """
    return figure.with_name(f"{figure.stem}-numbers.csv")


def draw_waits(trials: Sequence[Trial], found: "Baselines", files: tuple[Path, Path] | None) -> None:
    """The time to the first press after each cue came on, under every teacher model, and as it was."""
    if files is None:
        return
    from learn.plots import csv_text
    from learn.survival import press_probability, waits_figure

    models = {name: arm.model for name, arm in found.arms.items() if arm.model is not None}
    figure, rows = waits_figure(
        trials, {name: partial(press_probability, model=model) for name, model in models.items()}
    )
    figure.savefig(files[0], dpi=150)
    files[1].write_text(csv_text(rows), encoding="utf-8")
