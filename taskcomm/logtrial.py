"""One trial while its lines are read: each checked against those before it."""

from typing import Any

from taskcomm.loglines import (
    EventLine,
    LabelLine,
    Line,
    LineError,
    RatingLine,
    ResumeLine,
    StepLine,
    TaskPart,
    TrialEnd,
    TrialStart,
)
from taskcomm.logworld import WorldIndex
from taskcomm.trials import Step, Trial


class OpenTrial:
    """A trial being read. Line numbers in it leave out lines of unknown type."""

    def __init__(self, start: TrialStart, index: WorldIndex, place: str) -> None:
        self.start, self.index, self.place = start, index, place
        self.task = self._task("task card", start.task)
        self.state: Any = index.world.start()
        self.broken = False
        self.next_seq = 0
        self.places: dict[int, int] = {}  # seq in the file -> place among the lines that are known
        self.presses: dict[int, bool] = {}  # seq in the file -> pressed
        self.steps: list[Step] = []
        self.end: TrialEnd | None = None
        self.displayed: Any = None
        self.extras: dict[str, list[dict[str, Any]]] = {"events": [], "ratings": [], "labels": []}

    def add(self, seq: int, line: Line | None, document: dict[str, Any]) -> None:
        """Take in the next line of this trial, or raise LineError."""
        if seq != self.next_seq:
            raise LineError(f"seq: {seq} where {self.next_seq} was due; lines are missing or out of order")
        self.next_seq += 1
        if line is None:
            return
        self.places[seq] = place = len(self.places)
        if isinstance(line, StepLine):
            self._add_step(line)
        elif isinstance(line, TrialEnd):
            self._add_end(line)
        elif isinstance(line, LabelLine):
            if not self.presses.get(line.press_seq):
                raise LineError(f"press_seq: line {line.press_seq} of this trial is no step with a press")
            changed = {"seq": place, "press_seq": self.places[line.press_seq]}
            self.extras["labels"].append(_body(document) | changed)
        elif isinstance(line, RatingLine):
            self.extras["ratings"].append(_body(document) | {"seq": place})
        elif isinstance(line, (EventLine, ResumeLine)):
            kind = {"type": "resume"} if isinstance(line, ResumeLine) else {}
            self.extras["events"].append(kind | _body(document) | {"seq": place})

    def _task(self, what: str, part: TaskPart | None) -> Any:
        try:
            return None if part is None else self.index.task(part)
        except LineError as error:
            raise LineError(f"{what}: {error}") from None

    def _add_step(self, line: StepLine) -> None:
        if self.end is not None:
            raise LineError("step: it comes after the end of its trial")
        if line.t != len(self.steps):
            raise LineError(f"t: {line.t} where {len(self.steps)} was due; steps are missing or out of order")
        action, self.state = self.index.step(self.state, line.action)
        self.presses[line.seq] = bool(line.press)
        known = line.action_source, line.mental_state, line.timing, line.signals
        self.steps.append(Step(action, line.press, *known))

    def _add_end(self, line: TrialEnd) -> None:
        if self.end is not None:
            raise LineError("trial_end: the trial has ended before")
        if line.num_steps != len(self.steps):
            raise LineError(f"num_steps: {line.num_steps}, but the trial has {len(self.steps)} steps")
        if (line.displayed is None) == (line.reason == "final"):
            raise LineError(
                f"displayed: a trial that ends as {line.reason!r} shows "
                f"{'a' if line.displayed is None else 'no'} task"
            )
        self.displayed = self._task("displayed", line.displayed)
        self.end = line
        correct = self.trial().correct
        if line.correct is not None and line.correct != correct:
            raise LineError(f"correct: {line.correct}, but card and displayed task say {correct}")

    def trial(self) -> Trial:
        """What has been read."""
        start: dict[str, Any] = {
            name: getattr(self.start, name)
            for name in self.start.__struct_fields__
            if name not in ("seq", "schema", "world", "task")
        }
        return Trial(
            world=self.index.world,
            task=self.task,
            steps=tuple(self.steps),
            reason=None if self.end is None else self.end.reason,
            displayed=self.displayed,
            events=tuple(self.extras["events"]),
            ratings=tuple(self.extras["ratings"]),
            labels=tuple(self.extras["labels"]),
            **start,
        )


def _body(document: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in document.items() if key not in ("type", "trial_id")}
