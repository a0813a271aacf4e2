"""Teacher models and logs named on the command line."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import typer

from taskcomm.commands.terminal import Terminal
from taskcomm.cuerows import is_cue_table
from taskcomm.logs import LogError, read_with_places
from taskcomm.observation import Observer
from taskcomm.teacher import ModelError, TeacherModel
from taskcomm.trials import Trial
from taskcomm.world import World


def load_model(named: str, option: str) -> TeacherModel:
    """'intuitive', or the model of a file; a usage error names the option if there is no such file."""
    if named == "intuitive":
        return TeacherModel.intuitive()
    if not Path(named).is_file():
        raise typer.BadParameter(f"{named!r} is neither 'intuitive' nor a model file", param_hint=option)
    return TeacherModel.load(named)


def check_model(
    model: TeacherModel, named: str, world: World, steps: Collection[float], way_out: str | None = None
) -> None:
    """Raise ModelError, naming the model, for a cue or role that the world lacks, or another dt.

    `steps` are the dt of the trials; where there are two, that is another error, and not raised here.
    `way_out` is what converts the model, as the error should say it.
    """
    try:
        model.parameters(world.cue_names)
        Observer(world, model)
    except ModelError as error:
        raise ModelError(f"{named}: {error}") from None
    dt = _other_dt(model, steps)
    if dt is not None:
        raise ModelError(
            f"{named}: dt: the model is for steps of {model.dt:g} s, the trials have {dt:g} s;"
            f" {way_out or f'TeacherModel.with_dt({dt:g})'} converts it, approximately"
        )


def at_dt_of_trials(
    model: TeacherModel, named: str, world: World, steps: Collection[float], convert: bool, terminal: Terminal
) -> TeacherModel:
    """The model, as `check_model` wants it; with `convert`, one of another dt is converted, which is said."""
    dt = _other_dt(model, steps)
    if convert and dt is not None:
        terminal.message(
            f"warning: {named}: converted from steps of {model.dt:g} s to {dt:g} s; this is approximate, as"
            " levels are sampled at the ends of steps"
        )
        model = model.with_dt(dt)
    say_marks(model, named, terminal)
    check_model(model, named, world, steps, "--convert-dt")
    return model


def say_marks(model: TeacherModel, named: str, terminal: Terminal) -> None:
    """Say of a fitted model what its file says: a fit not to be trusted, parameters without data."""
    certificate, audit = (model.provenance.get(key) for key in ("certificate", "audit"))
    if isinstance(certificate, Mapping) and certificate.get("trusted") is False:
        terminal.message(f"warning: {named}: its fit is not to be trusted: {certificate.get('status')}")
    if isinstance(audit, Mapping):
        found = [
            name for name, of in audit.items() if isinstance(of, Mapping) and of.get("verdict") == "none"
        ]
        if found:
            terminal.message(f"note: {named}: fitted without data on {', '.join(found)}")


def _other_dt(model: TeacherModel, steps: Collection[float]) -> float | None:
    """The one dt of the trials, where it is not the model's."""
    dt = next(iter(steps))
    return dt if len(set(steps)) == 1 and abs(model.dt - dt) > 1e-9 * dt else None


def model_files(named: Sequence[str]) -> list[Path]:
    """Those of the names that are files, for their hashes."""
    return [Path(name) for name in named if Path(name).is_file()]


def refuse_cue_tables(paths: Sequence[Path]) -> None:
    """Raise LogError for a cue table, where only trials in a world will do."""
    for path in paths:
        if is_cue_table(path):
            raise LogError(
                f"{path}: a cue table has no world, so nothing can be planned, replayed or drawn in one; a"
                " trial log is needed here (fit, structure and population take cue tables)"
            )


def load_trials(paths: Sequence[Path], terminal: Terminal) -> tuple[list[Trial], dict[str, str]]:
    """The trials of the logs, and the place of each (file:line, by trial_id).

    Those that broke off before the first step are named and left out. Raises LogError where none is left, and
    for a cue table.
    """
    refuse_cue_tables(paths)
    trials, places = read_with_places(paths)
    bare = [trial.trial_id for trial in trials if not trial.num_steps]
    if len(bare) == len(trials):
        raise LogError(f"{', '.join(map(str, paths))}: no trial with a step")
    if bare:
        terminal.message(f"warning: left out, since they broke off before the first step: {', '.join(bare)}")
    return [trial for trial in trials if trial.num_steps], places


@contextmanager
def naming(places: Mapping[str, str]) -> Iterator[None]:
    """Within it, a FitError that speaks of trials also says where in the logs they are."""
    from learn import FitError

    try:
        yield
    except FitError as error:
        found = "; ".join(f"trial {name} is at {places[name]}" for name in error.trial_ids if name in places)
        raise FitError(f"{error} ({found})" if found else str(error), *error.trial_ids) from None
