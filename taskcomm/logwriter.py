"""The log of a trial while it runs: each call gives the bytes that are to be appended."""

from dataclasses import replace
from typing import Any

from taskcomm.loglines import encode
from taskcomm.logs import end_lines, start_line, step_line
from taskcomm.trials import Step, Trial


class TrialWriter:
    """One trial's lines, in order. `head` says everything that is known before the first step.

    A trial that goes on after a crash is given as it was read, with its number of lines as `next_seq`. Lines
    joined are what `read_trials` reads.

    >>> from taskcomm.world import NOA, BallWorld
    >>> writer = TrialWriter(Trial("one", BallWorld(), None, ()))
    >>> lines = writer.start() + writer.step(Step(NOA, pressed=True)) + writer.end("timeout")
    >>> lines.count(b"\\n"), writer.next_seq, len(writer.steps)
    (3, 3, 1)
    """

    def __init__(self, head: Trial, next_seq: int = 0) -> None:
        self.head, self.next_seq = head, next_seq
        self.steps: list[Step] = list(head.steps)

    def start(self) -> bytes:
        """The first line."""
        return self._line(start_line(self.head))

    def step(self, step: Step) -> bytes:
        """One step that is over."""
        line = self._line(step_line(len(self.steps), step))
        self.steps.append(step)
        return line

    def event(self, kind: str, **fields: Any) -> bytes:
        """Something raw between steps: a key, a connection, a pause."""
        return self._line({"type": "event", "kind": kind, **fields})

    def resume(self, **fields: Any) -> bytes:
        """The trial goes on after a crash."""
        return self._line({"type": "resume", **fields})

    def rating(self, item: str, value: float | str | None, scale: Any = None) -> bytes:
        """An answer of the teacher's."""
        return self._line({"type": "rating", "item": item, "value": value, "scale": scale})

    def label(self, press_seq: int, mental_state: str, annotator: str, **fields: Any) -> bytes:
        """A reason that an annotator gave for the press in line `press_seq`."""
        said = {"press_seq": press_seq, "mental_state": mental_state, "annotator": annotator}
        return self._line({"type": "label", **said, **fields})

    def end(self, reason: str, displayed: Any | None = None) -> bytes:
        """How it ended."""
        ended = replace(self.head, steps=tuple(self.steps), reason=reason, displayed=displayed)
        return self._line(end_lines(ended)[0])

    def _line(self, line: dict[str, Any]) -> bytes:
        placed = {"type": line["type"], "trial_id": self.head.trial_id, "seq": self.next_seq} | line
        self.next_seq += 1
        return encode(placed)
