"""How one trial went, from the lines of its log: quickly, and whatever state the file is in."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any, Literal

import msgspec

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

    `lost` are steps whose key state was not recorded, `defaults` those in which the robot acted by default,
    `resumes` how often it went on after a crash. `torn`: its last line is not whole; `problem`: the first
    line that is no JSON object, by number.
    """

    trial_id: str
    condition: str
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


def lines_of(path: Path) -> tuple[list[dict[str, Any]], bool, str | None]:
    """The objects in a JSON Lines file, whether its last line is torn, and the first that is no object."""
    if not path.exists():
        return [], False, None
    whole, _, rest = path.read_bytes().rpartition(b"\n")
    lines, problem = [], None
    for number, text in enumerate(whole.split(b"\n") if whole else [], 1):
        try:
            line = msgspec.json.decode(text, type=dict)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            problem = problem or f"{path.name}:{number}: not a JSON object"
            continue
        lines.append(line)
    return lines, bool(rest), problem


def trial_status(path: Path, trial_id: str, condition: str, practice: bool = False) -> TrialStatus:
    """What the log at `path` says of its trial."""
    lines, torn, problem = lines_of(path)
    steps = [line for line in lines if line.get("type") == "step"]
    ends = [line for line in lines if line.get("type") == "trial_end"]
    state: State = "unfinished" if lines or torn or problem else "not begun"
    if ends and ends[0].get("reason") in ("final", "timeout", "aborted"):
        state = ends[0]["reason"]
    return TrialStatus(
        trial_id=trial_id,
        condition=condition,
        practice=practice,
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
    late = sorted(float(timing["late_ms"]) for timing in timed if "late_ms" in timing)
    of_teacher = [event for event in events if event.get("role") == "teacher" and "rtt_ms" in event]
    missed = sum(int(event.get("missed", 0)) for event in events if event.get("kind") == "timing")
    return Timings(
        late_ms_p99=late[min(len(late) - 1, int(0.99 * len(late)))] if late else None,
        late_ms_max=late[-1] if late else None,
        missed=missed,
        rtt_ms=median(float(event["rtt_ms"]) for event in of_teacher) if of_teacher else None,
    )
