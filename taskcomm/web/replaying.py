"""Logged trials to look at again: the list, a trial under a model, labels of presses.

What a client names (a trial, a model) is looked up among the files of the study, never made a path. Whoever
reads is an admin (None) or an annotator, by id: an annotator sees no belief, condition or controller, and of
the labels only their own. Everything here reads files and computes; the server does it off its event loop.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec

from taskcomm.logwriter import TrialWriter
from taskcomm.replay import belief_path, is_at_dt, press_reasons
from taskcomm.teacher import ModelError, TeacherModel
from taskcomm.trials import Trial
from taskcomm.web.frames import frame
from taskcomm.web.protocol import Frame, Label, Replay, Trials
from taskcomm.web.triallogs import Folder as Folder
from taskcomm.web.triallogs import ReplayError as ReplayError
from taskcomm.web.triallogs import logs, places, trial_log
from taskcomm.web.trialrun import utc
from taskcomm.world import BallState, BallWorld

INTUITIVE = "intuitive"
_DIGITS = 6  # of a probability on a page


def trials(folder: Folder, annotator: str | None = None) -> Trials:
    """The trials that can be opened; to an admin also the logs that cannot be read, and why."""
    rows = []
    for log in logs(folder):
        rows += [_row(trial, annotator) for trial in log.trials if annotator is None or trial.reason]
        if log.problem is not None and annotator is None:
            rows.append({"trial": log.path.stem, "problem": log.problem})
    return Trials(trials=rows, models=list(_model_files(folder)) if annotator is None else [])


def _row(trial: Trial, annotator: str | None) -> dict[str, Any]:
    row = {
        "trial": trial.trial_id,
        "participant": trial.participant_id,
        "index": trial.trial_index,
        "steps": trial.num_steps,
        "presses": int(trial.presses.sum()),
        "source": trial.source,
    }
    if annotator is not None:
        return row | {"labelled": sum(annotator in said for said in trial.labelled.values())}
    return row | {
        "labelled": len(trial.labelled),
        "condition": trial.condition,
        "reason": trial.reason,
        "correct": trial.correct,
        "lost": int((~trial.recorded).sum()),
        "defaults": sum(step.action_source == "default" for step in trial.steps),
    }


def opened(folder: Folder, trial_id: str, model: str | None = None, annotator: str | None = None) -> Replay:
    """A trial to be shown: to an admin with the belief under `model` and the reasons of its presses.

    Without a `model`, it is the robot's own, where the folder has it, else the intuitive one; a model of
    another step is converted, which is said. Raises ReplayError for a trial or a model that is not there, and
    ModelError for a model that does not fit.
    """
    trial, path = trial_log(folder, trial_id, annotator)
    if not isinstance(trial.world, BallWorld):
        raise ReplayError(f"trial {trial_id} is of another world; only ball worlds can be shown")
    seqs, _ = places(path, trial_id)
    shown = Replay(
        trial=trial_id,
        dt=trial.dt,
        frames=[msgspec.to_builtins(each) for each in _frames(trial)],
        presses=_presses(trial, seqs, annotator),
        card=list(trial.task) if trial.task else [],
        belief=None,
        reasons=None,
        source=trial.source,
        states=states(folder),
    )
    if annotator is not None:
        return shown
    name, known = _model(folder, model, trial)
    return _believed(shown, trial, name, known)


def _frames(trial: Trial) -> Iterator[Frame]:
    """The world before the first step, during each, and with Final where it was shown."""
    world = trial.world
    assert isinstance(world, BallWorld)
    last = frame(world, world.start(), -1)
    yield last
    for t, (step, state) in enumerate(zip(trial.steps, trial.states, strict=True)):
        assert isinstance(state, BallState)
        last = frame(world, state, t, step.action)
        yield last
    if trial.displayed is not None:
        ended: dict[str, Any] = {"t": trial.num_steps, "state": "over", "action": "final", "slid": []}
        yield msgspec.structs.replace(last, final=list(trial.displayed), **ended)


def _presses(trial: Trial, seqs: list[int], annotator: str | None) -> list[dict[str, Any]]:
    found = []
    for t, step in enumerate(trial.steps):
        if step.pressed:
            said = trial.labelled.get(t, {})
            press: dict[str, Any] = {"t": t, "seq": seqs[t], "label": said.get(annotator)}
            if annotator is None:
                press["labels"] = {name or "unnamed": state for name, state in said.items()}
                press["label"] = trial.reasons.get(t) if said else None
                press["noted"] = step.mental_state
            found.append(press)
    return found


def _believed(shown: Replay, trial: Trial, name: str, model: TeacherModel) -> Replay:
    """With the belief of a robot that has `model`, the reasons, and the numbers that go with them."""
    path = belief_path(trial, model)
    belief = _rounded(path.to_json()) | {"model": name, "robot": dict(trial.robot_model or {})}
    belief["likeliest"] = [list(trial.world.tasks[index]) for index in path.marginal.argmax(axis=1)]
    notes = []
    if "conversion" in model.provenance:
        notes.append(f"The model {name} was converted {model.provenance['conversion']}.")
    try:
        reasons = [_rounded(reason.to_json()) for reason in press_reasons(trial, model)]
    except ValueError as error:  # too many presses, or impossible ones
        reasons = []
        notes.append(f"The reasons of presses cannot be computed: {error}")
    about = _row(trial, None) | {"operator": trial.operator_id, "notes": notes}
    about["displayed"] = list(trial.displayed) if trial.displayed else []
    return msgspec.structs.replace(shown, belief=belief, reasons=reasons, about=about)


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, _DIGITS)
    if isinstance(value, dict):
        return {key: _rounded(each) for key, each in value.items()}
    return [_rounded(each) for each in value] if isinstance(value, list) else value


def states(folder: Folder) -> list[str]:
    """The mental states that may be behind a press: those of all models, but waiting."""
    known = [TeacherModel.intuitive(), *(model for model in _models(folder).values() if model is not None)]
    return list(
        dict.fromkeys(state for model in known for state in model.mental_states if state != "waiting")
    )


def label_line(folder: Folder, label: Label, annotator: str) -> tuple[Path, bytes]:
    """The log that a label belongs into, and its line.

    The line takes the next place in the log as it is on disk: nothing else may be on its way there. Raises
    ReplayError for a trial that is not there or not over, a log with a torn line, a line that is no step with
    a press, or a mental state that no model has.
    """
    trial, path = trial_log(folder, label.trial, annotator)
    if label.mental_state not in states(folder):
        raise ReplayError(f"{label.mental_state!r} is no reason of a press: {', '.join(states(folder))}")
    seqs, following = places(path, label.trial)
    if following is None:
        raise ReplayError("the last line of this log is torn; it is mended when the study is served again")
    pressed = {seq for seq, step in zip(seqs, trial.steps, strict=True) if step.pressed}
    if label.press_seq not in pressed:
        raise ReplayError(f"line {label.press_seq} of trial {label.trial} is no step with a press")
    writer = TrialWriter(trial, following)
    return path, writer.label(label.press_seq, label.mental_state, annotator, utc=utc())


def _model_files(folder: Folder) -> dict[str, Path | None]:
    """By name: the intuitive model (no file), then those of the folder."""
    files = sorted(folder.models_dir.glob("*.json")) if folder.models_dir.is_dir() else []
    return {INTUITIVE: None} | {path.stem: path for path in files if path.stem != INTUITIVE}


def _models(folder: Folder) -> dict[str, TeacherModel | None]:
    """By name; None for a file that cannot be read."""
    found: dict[str, TeacherModel | None] = {}
    for name, path in _model_files(folder).items():
        try:
            found[name] = _loaded(name, path)
        except ReplayError:
            found[name] = None
    return found


def _loaded(name: str, path: Path | None) -> TeacherModel:
    try:
        return TeacherModel.intuitive() if path is None else TeacherModel.from_json(path.read_bytes())
    except (ModelError, OSError) as error:
        raise ReplayError(f"the model {name} cannot be read: {error}") from None


def _model(folder: Folder, name: str | None, trial: Trial) -> tuple[str, TeacherModel]:
    if name is None:
        own = (trial.robot_model or {}).get("sha256")
        known = {each: _fitting(model, trial) for each, model in _models(folder).items() if model}
        name = next((each for each, model in known.items() if model.sha256 == own), INTUITIVE)
    files = _model_files(folder)
    if name not in files:
        raise ReplayError(f"there is no model {name!r}; there are {', '.join(files)}")
    return name, _fitting(_loaded(name, files[name]), trial)


def _fitting(model: TeacherModel, trial: Trial) -> TeacherModel:
    """The model at the trial's step."""
    return model if is_at_dt(trial, model) else model.with_dt(trial.dt)
