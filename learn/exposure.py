"""Trials as the learner sees them: what was shown, task by task, and when the spacebar was pressed."""

import hashlib
import json
import math
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from taskcomm.beam import Beam
from taskcomm.lattice import (
    MAX_MEMORIES,
    Extent,
    Floats,
    Ints,
    Lattice,
    LatticeTooLarge,
    Unit,
    build_unit,
    join,
)
from taskcomm.smoother import Hypothesis, cue_tables, hypotheses, index_of_task, seen, task_prior
from taskcomm.teacher import ModelError, TeacherModel
from taskcomm.trials import Trial
from taskcomm.world import World

NARROWER = (1.0, 1e-2, 1e-4)  # of the mass that a beam may leave out


class FitError(ValueError):
    """Trials that cannot be fitted together, or not with this model; the message says which and why.

    `trial_ids` are those of the trials that it speaks of.
    """

    def __init__(self, message: str, *trial_ids: str) -> None:
        super().__init__(message)
        self.trial_ids = trial_ids


def trials_given(trials: object, use: str = "a fit") -> tuple[Trial, ...]:
    """`trials` as a tuple; TypeError for what are no trials, FitError where there are none for this `use`."""
    if isinstance(trials, Trial):
        raise TypeError(
            f"trials: must be a list of trials, not one; [trial] is one of trial {trials.trial_id}"
        )
    if isinstance(trials, (str, os.PathLike)):
        raise TypeError(
            f"trials: must be trials, not {trials!r}; taskcomm.read_trials reads them from a file"
        )
    if not isinstance(trials, Iterable):
        raise TypeError(f"trials: must be a list of trials, not {trials!r}")
    given = tuple(trials)
    for number, trial in enumerate(given):
        if not isinstance(trial, Trial):
            raise TypeError(f"trials[{number}]: must be a Trial, not {trial!r}")
    if not given:
        raise FitError(f"no trials: {use} needs at least one")
    return given


def trial_hash(trial: Trial) -> str:
    """What a fit depends on in a trial: sha256 of its dt, task, actions, presses and signals.

    >>> from taskcomm.world import NOA, BallWorld
    >>> from taskcomm.trials import Step
    >>> world = BallWorld()
    >>> trial = Trial("a", world, world.tasks[0], (Step(NOA, False),))
    >>> trial_hash(trial)[:8]
    '823b8693'
    """
    presses = "".join("?" if step.pressed is None else str(int(step.pressed)) for step in trial.steps)
    what: list[Any] = [
        trial.dt,
        None if trial.task is None else str(trial.task),
        [str(a) for a in trial.actions],
        presses,
    ]
    if trial.channels:
        what.append([dict(sorted((step.signals or {}).items())) for step in trial.steps])
    return hashlib.sha256(json.dumps(what).encode()).hexdigest()


@dataclass(frozen=True)
class Exposure:
    """Every trial under every task that it may have had, as one lattice.

    Unit u is trial `unit_trial[u]` under the tasks that show the same cues, whose prior is
    `unit_prior[u]` (1 where the task is known) and, task by task, `unit_tasks[u]`. `steps` counts
    those of each trial, `press_steps` are the ones with a press.
    """

    world: World
    dt: float
    trial_ids: tuple[str, ...]
    hashes: tuple[str, ...]
    steps: Ints
    press_steps: tuple[Ints, ...]
    lattice: Lattice
    unit_trial: Ints
    unit_prior: Floats
    unit_tasks: tuple[Floats, ...]
    cue_ever_on: tuple[bool, ...]

    @property
    def dropped(self) -> float:
        """A bound on what memories left out would add to the log-likelihood of all trials, in nats."""
        first = np.flatnonzero(np.diff(self.unit_trial, prepend=-1))
        return float(np.maximum.reduceat(self.lattice.unit_dropped, first).sum())


def _check(trials: Sequence[Trial], world: World, model: TeacherModel) -> None:
    for trial in trials:
        if trial.world != world:
            raise FitError(
                f"trial {trial.trial_id}: took place in {trial.world}, not in {world}", trial.trial_id
            )
        if not trial.num_steps:
            raise FitError(f"trial {trial.trial_id}: has no steps", trial.trial_id)
        if abs(trial.dt - trials[0].dt) > 1e-9 * trials[0].dt:
            raise FitError(
                f"two dt in one fit: {trials[0].dt:g} s in trial {trials[0].trial_id},"
                f" {trial.dt:g} s in trial {trial.trial_id}",
                trials[0].trial_id,
                trial.trial_id,
            )
    if abs(model.dt - trials[0].dt) > 1e-9 * trials[0].dt:
        raise FitError(
            f"dt = {trials[0].dt:g} s in the trials, but {model.dt:g} s in the model:"
            f" model.with_dt({trials[0].dt:g}) converts it, approximately"
        )


def _unit(shown: Hypothesis, trial: Trial, extent: Extent, dt: float, most: int, beam: Beam | None) -> Unit:
    """The lattice of a trial under one task, with as narrow a beam as leaves what was observed possible.

    One that leaves out what a later label or signal needs leaves out less, step by step, down to nothing.
    """

    def with_beam(narrow: Beam | None) -> Unit:
        return build_unit(shown.cues, trial.presses, extent, dt, most, shown.logs, narrow)

    found = None
    narrower = () if beam is None else [beam._replace(mass=beam.mass * less) for less in NARROWER]
    for narrow in narrower:
        try:
            found = with_beam(narrow)
        except LatticeTooLarge:
            if found is None:
                raise
            return found
        except ValueError:  # impossible for all parameters, with what is left
            continue
        if math.isfinite(found.dropped):
            return found
    try:
        return with_beam(None)
    except LatticeTooLarge:
        if found is None:
            raise
        return found


def expose(
    trials: Sequence[Trial],
    world: World,
    model: TeacherModel,
    extent: Extent | None = None,
    prior: ArrayLike | None = None,
    most: int = MAX_MEMORIES,
    use: str = "a fit",
    labels: bool = False,
    dropped_mass: float = 0.0,
    together: bool = True,
) -> Exposure:
    """The lattice of `trials`, good for every model within `extent` (by default for `model` alone).

    With `labels`, presses that annotators labelled have one of the reasons they gave. With a `dropped_mass`
    above 0, memories that hold no more than it together, at each event and under `model`, are left out where
    key states are unknown (`Lattice.unit_dropped` bounds the loss); fewer in a trial that would be impossible
    without them. Tasks that show the same are one unit, unless `together` is False.
    Trials whose task is None are taken under every task with a positive `prior` (uniform by default).
    Raises TypeError for what are no trials; FitError for zero trials (which this `use` needs), a trial
    without steps, two dt, another dt than the model's, another world, a task that the world lacks, a cue
    that it lacks, a bad prior, or a trial with more than `most` memories under one task.
    """
    trials = trials_given(trials, use)
    _check(trials, world, model)
    try:
        parameters = model.parameters(world.cue_names)
        weight = task_prior(world, prior)
    except (ModelError, ValueError) as error:
        raise FitError(str(error)) from None
    extent = Extent.of(parameters) if extent is None else extent
    beam = Beam(parameters, dropped_mass) if dropped_mass > 0 else None
    units, unit_trial, unit_tasks = [], [], []
    ever = np.zeros(len(parameters.cue), dtype=np.bool_)
    for number, trial in enumerate(trials):
        try:
            task = None if trial.task is None else index_of_task(trial, world, trial.task)
            table, logs = cue_tables(trial, world, parameters.cue), seen(trial, world, model, labels)
            shown = hypotheses(table, logs, weight, task, together)
            units += [_unit(one, trial, extent, model.dt, most, beam) for one in shown]
        except LatticeTooLarge as error:
            raise FitError(f"trial {trial.trial_id}: {error}", trial.trial_id) from None
        except ValueError as error:  # a task or an action that its world does not have
            told = (
                str(error) if f"trial {trial.trial_id}:" in str(error) else f"trial {trial.trial_id}: {error}"
            )
            raise FitError(told, trial.trial_id) from None
        ever |= np.any([one.cues.any(axis=0) for one in shown], axis=0)
        unit_trial += [number] * len(shown)
        unit_tasks += [one.share for one in shown]
    return Exposure(
        world=world,
        dt=model.dt,
        trial_ids=tuple(trial.trial_id for trial in trials),
        hashes=tuple(trial_hash(trial) for trial in trials),
        steps=np.array([trial.num_steps for trial in trials]),
        press_steps=tuple(np.flatnonzero(trial.presses) for trial in trials),
        lattice=join(units),
        unit_trial=np.array(unit_trial),
        unit_prior=np.array([share.sum() for share in unit_tasks]),
        unit_tasks=tuple(unit_tasks),
        cue_ever_on=tuple(bool(on) for on in ever),
    )
