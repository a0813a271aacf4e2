"""The teacher models that the planners of a study use."""

import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path

from taskcomm.observation import Observer
from taskcomm.teacher import ModelError, TeacherModel
from taskcomm.web.study.structure import INTUITIVE, Design, DesignError


def load_models(folder: Path, design: Design) -> Mapping[str, TeacherModel]:
    """The model of every planner by its name: the intuitive one, or a file in `folder`, read as data.

    Raises DesignError for a file that is missing or no model, and for a model that does not go with the
    world, the step, or a key as the only signal.
    """
    return {name: _load(folder, name, design) for name in design.models}


def _load(folder: Path, name: str, design: Design) -> TeacherModel:
    path = folder / name
    try:
        if name == INTUITIVE:
            path = Path(INTUITIVE)
            model = TeacherModel.intuitive().with_dt(design.timing.step)
        elif not path.is_file():
            raise DesignError(f"{path}: there is no such file, and a condition of the design names it")
        else:
            model = TeacherModel.from_json(path.read_bytes())
        world = design.ball_world
        model.parameters(world.cue_names)
        Observer(world, model)
    except ModelError as error:
        raise DesignError(f"{path}: {error}") from None
    except OSError as error:
        raise DesignError(f"{path}: cannot be read: {error.strerror or error}") from None
    step = design.timing.step
    if abs(model.dt - step) > 1e-9 * step:
        raise DesignError(f"{path}: dt: the model is for steps of {model.dt:g} s, the study has {step:g} s")
    if model.observation.channels:
        raise DesignError(f"{path}: observation.channels: a study records the key alone")
    return model


def copy_models(files: Iterable[Path], folder: Path) -> None:
    """Copy model files into `folder`, each checked to be one; DesignError where two have one name."""
    folder.mkdir()
    for file in files:
        target = folder / file.name
        if target.exists() or file.suffix != ".json":
            why = "another model has that name" if target.exists() else "a model file is NAME.json"
            raise DesignError(f"{file}: {why}")
        try:
            TeacherModel.load(file)
            shutil.copyfile(file, target)
        except ModelError as error:
            raise DesignError(str(error)) from None
        except OSError as error:
            raise DesignError(f"{file}: cannot be read: {error.strerror or error}") from None
