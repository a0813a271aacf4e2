"""How one trial went, from the lines of its log: quickly, and whatever state the file is in."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any, Literal

from taskcomm.web.study.assignment import TrialPlan
from taskcomm.web.study.sessions import lines_of

State = Literal["not begun", "unfinished", "final", "timeout", "aborted"]


@dataclass(frozen=True, kw_only=True)
class Timings:
    """Lateness of ticks and round-trip time of the teacher's page, in ms; ticks late by a step or more."""

    late_ms_p99: float | None = None
    late_ms_max: float | None = None
    missed: int = 0
    rtt_ms: float | None = None


@dataclass(frozen=True, kw_only=True)
class TrialStatus:
    """A trial: how it stands, and what was lost.

    `lost` are steps whose key state was not recorded; `defaults` those in which nobody chose an action: the
    planner was late, or the operator did nothing, which is no loss; `resumes` how often it went on after a
    crash. `torn`: its last line is not whole; `problem`: the first line that is no JSON object, by number.
    """

    trial_id: str
    condition: str
    controller: str
    practice: bool
    state: State
    correct: bool | None
    steps: int
    presses: int
    lost: int
    defaults: int
    resumes: int
    torn: bool
    problem: str | None
    timings: Timings


def trial_status(path: Path, plan: TrialPlan) -> TrialStatus:
    """What the log at `path` says of the trial planned."""
    lines, torn, problem = lines_of(path)
    steps = [line for line in lines if line.get("type") == "step"]
    ends = [line for line in lines if line.get("type") == "trial_end"]
    state: State = "unfinished" if lines or torn or problem else "not begun"
    if ends and ends[0].get("reason") in ("final", "timeout", "aborted"):
        state = ends[0]["reason"]
    return TrialStatus(
        trial_id=plan.trial_id,
        condition=plan.condition,
        controller=plan.controller,
        practice=plan.practice,
        state=state,
        correct=ends[0].get("correct") if ends else None,
        steps=len(steps),
        presses=sum(step.get("press") is True for step in steps),
        lost=sum(step.get("press") is None for step in steps),
        defaults=sum(step.get("action_source") == "default" for step in steps),
        resumes=sum(line.get("type") == "resume" for line in lines),
        torn=torn,
        problem=problem,
        timings=_timings(steps, [line for line in lines if line.get("type") == "event"]),
    )


def _timings(steps: Sequence[Mapping[str, Any]], events: Sequence[Mapping[str, Any]]) -> Timings:
    """From the steps; missed ticks from the summary that ends a trial."""
    timed = [step["timing"] for step in steps if isinstance(step.get("timing"), dict)]
    late = sorted(_numbers(timed, "late_ms"))
    trips = _numbers([event for event in events if event.get("role") == "teacher"], "rtt_ms")
    missed = _numbers([event for event in events if event.get("kind") == "timing"], "missed")
    return Timings(
        late_ms_p99=late[min(len(late) - 1, int(0.99 * len(late)))] if late else None,
        late_ms_max=late[-1] if late else None,
        missed=round(sum(missed)),
        rtt_ms=median(trips) if trips else None,
    )


def _numbers(lines: Sequence[Mapping[str, Any]], key: str) -> list[float]:
    return [float(line[key]) for line in lines if isinstance(line.get(key), int | float)]
