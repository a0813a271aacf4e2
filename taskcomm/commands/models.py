"""Teacher models and logs named on the command line."""

from collections.abc import Collection, Sequence
from pathlib import Path

import typer

from taskcomm.commands.terminal import Terminal
from taskcomm.logs import LogError, read_trials
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


def check_model(model: TeacherModel, named: str, world: World, steps: Collection[float]) -> None:
    """Raise ModelError, naming the model, for a cue that the world lacks or a dt other than the trials'.

    `steps` are the dt of the trials; where there are two, that is another error, and not raised here.
    """
    try:
        model.parameters(world.cue_names)
    except ModelError as error:
        raise ModelError(f"{named}: {error}") from None
    for dt in steps if len(set(steps)) == 1 else ():
        if abs(model.dt - dt) > 1e-9 * dt:
            raise ModelError(
                f"{named}: dt: the model is for steps of {model.dt:g} s, the trials have {dt:g} s;"
                f" TeacherModel.with_dt({dt:g}) converts it, approximately"
            )


def model_files(named: Sequence[str]) -> list[Path]:
    """Those of the names that are files, for their hashes."""
    return [Path(name) for name in named if Path(name).is_file()]


def load_trials(paths: Sequence[Path], terminal: Terminal) -> list[Trial]:
    """The trials of the logs; those that broke off before the first step are named and left out.

    Raises LogError where none is left.
    """
    trials = read_trials(paths)
    bare = [trial.trial_id for trial in trials if not trial.num_steps]
    if len(bare) == len(trials):
        raise LogError(f"{', '.join(map(str, paths))}: no trial with a step")
    if bare:
        terminal.message(f"warning: left out, since they broke off before the first step: {', '.join(bare)}")
    return [trial for trial in trials if trial.num_steps]
