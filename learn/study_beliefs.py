"""What the robot believed in a study: of the task over time, and of every press with a known reason."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from learn.bootstrap import Interval, ratio_interval
from learn.study_trials import Missing, counted, source_note, teacher_of
from taskcomm.belief import ImpossibleObservation
from taskcomm.lattice import LatticeTooLarge
from taskcomm.levels import Floats
from taskcomm.replay import BeliefPath, PressReason, belief_path, press_reasons
from taskcomm.smoother import smooth
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial

ModelOf = Callable[[Trial], TeacherModel]


@dataclass(frozen=True)
class Believed:
    """One trial under one model: the belief over time, the reasons of its presses; `truth` is the known
    reason by step, `disputed` how many presses annotators disagree on."""

    trial: Trial
    model: TeacherModel
    path: BeliefPath
    reasons: tuple[PressReason, ...]
    truth: dict[int, str]
    disputed: int


def believed(trials: Sequence[Trial], model_of: ModelOf) -> tuple[list[Believed], list[str]]:
    """Every trial under its model, and why those left out could not be replayed, a line each."""
    found, left_out = [], []
    for trial in trials:
        model = model_of(trial)
        try:
            path, reasons = belief_path(trial, model), press_reasons(trial, model)
        except (ImpossibleObservation, LatticeTooLarge, ValueError) as error:
            left_out.append(f"trial {trial.trial_id} cannot be replayed: {error}")
            continue
        truth = trial.reasons
        disputed = sum(step not in truth for step in trial.labelled)
        found.append(Believed(trial, model, path, reasons, truth, disputed))
    return found, left_out


def models_note(of: Sequence[Believed]) -> str:
    """Which models the beliefs are of, by name or hash."""
    named = {one.model.sha256: (one.trial.robot_model or {}) for one in of}
    names = sorted(
        {
            f"{model.get('name')!r}" if model.get("sha256") == sha else f"sha256 {sha[:12]}"
            for sha, model in named.items()
        }
    )
    return f"the robot's teacher model{'s' if len(names) > 1 else ''} {', '.join(names)}"


def planned_note(of: Sequence[Believed]) -> str:
    """How many trials of which source these are, and their conditions where there are several."""
    conditions = sorted({one.trial.condition for one in of})
    several = f" ({', '.join(conditions)})" if len(conditions) > 1 else ""
    return f"{source_note([one.trial for one in of])} with the planner{several}"


def accuracy_rows(of: Sequence[Believed]) -> list[dict[str, Any]]:
    """Every press with a known reason: P(that reason) as believed when it was pressed, and at the end."""
    return [
        {
            "trial_id": one.trial.trial_id,
            "teacher": teacher_of(one.trial),
            "step": reason.step,
            "time": reason.time,
            "mental_state": one.truth[reason.step],
            "at_press": reason.at_once.get(one.truth[reason.step], 0.0),
            "at_end": reason.at_end.get(one.truth[reason.step], 0.0),
        }
        for one in of
        for reason in one.reasons
        if reason.step in one.truth
    ]


def accuracy(rows: Sequence[dict[str, Any]], seed: int = 0) -> dict[str, dict[str, Interval]]:
    """By true mental state: the means of `at_press` and `at_end`, with 95% intervals, teachers resampled."""
    states = sorted({row["mental_state"] for row in rows}, key=_in_order)
    found: dict[str, dict[str, Interval]] = {}
    for state in states:
        these = [row for row in rows if row["mental_state"] == state]
        teachers = [row["teacher"] for row in these]
        ones = np.ones(len(these))
        found[state] = {
            when: ratio_interval([row[when] for row in these], ones, teachers, seed=seed)
            for when in ("at_press", "at_end")
        }
    return found


def _in_order(state: str) -> tuple[int, str]:
    known = ("mistake", "that_mov", "that_wrt", "that_dist")
    return (known.index(state) if state in known else len(known), state)


@dataclass(frozen=True)
class Recovery:
    """A mistaken press and what came of it: `wrong` is the value of `field` that the press made likely.

    `mistake` is P(that press was a mistake | the trial so far), shape (steps - step,), from the press on.
    """

    of: Believed
    step: int
    field: str
    wrong: Any
    spike: float
    mistake: Floats


def typical_recovery(of: Sequence[Believed], field: str = "mov") -> Recovery:
    """The mistaken press with the greatest spike that was undone.

    The spike is P(a wrong value of `field`) just after the press, less the greater of what it was just before
    and what it is at the end. Raises Missing where no press is known to be a mistake or none made a spike.
    """
    best: tuple[float, Believed, int, Any] | None = None
    mistaken = 0
    for one in of:
        if one.trial.task is None or field not in one.path.fields:
            continue
        columns, right = one.path.marginal_of(field), getattr(one.trial.task, field)
        for step in (step for step, state in one.truth.items() if state == "mistake"):
            mistaken += 1
            for value, column in columns.items():
                spike = float(column[step + 1] - max(column[step], column[-1]))
                if value != right and (best is None or spike > best[0]):
                    best = spike, one, step, value
    if not mistaken:
        raise Missing("no press is known to be a mistake, from a simulation or a label")
    if best is None or best[0] <= 0:
        raise Missing(
            f"none of {counted(mistaken, 'mistaken press')} raised a wrong {field} that the trial then undid"
        )
    spike, one, step, wrong = best
    return Recovery(one, step, field, wrong, spike, mistake_over_time(one, step))


def mistake_over_time(one: Believed, step: int) -> Floats:
    """P(the press in `step` was a mistake | the trial up to each later step), the step itself first."""
    blank = replace(one.trial, task=None, labels=())
    found = []
    for end in range(step + 1, one.trial.num_steps + 1):
        smoothed = smooth(replace(blank, steps=blank.steps[:end]), one.model)
        found.append(smoothed.of_press(list(smoothed.steps).index(step))["mistake"])
    return np.array(found)


def typical_trial(of: Sequence[Believed]) -> Believed:
    """The trial of median length (the shorter of two) among those that ended rightly; Missing without one."""
    right = [one for one in of if one.trial.correct]
    if not right:
        raise Missing("no trial with the planner ended rightly")
    ordered = sorted(right, key=lambda one: (one.trial.num_steps, one.trial.trial_id))
    return ordered[(len(ordered) - 1) // 2]
