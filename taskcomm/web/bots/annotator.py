"""Labels from a program that knows why a press happened, over the annotator's line."""

from collections.abc import AsyncIterator, Mapping
from contextlib import aclosing
from typing import TypeVar

from taskcomm.web.bots.line import Line, LineError
from taskcomm.web.protocol import Acknowledged, Label, Open, Problem, Replay, ToClient, Welcome

Kind = TypeVar("Kind", bound=ToClient)


async def label_presses(line: Line, reasons: Mapping[str, Mapping[int, str]]) -> int:
    """As an annotator, label the presses that `reasons` knows, by trial id and step; how many there were.

    A press that came too late for its step, and so stands in the next, is known by the step before. Raises
    LineError where the server refuses.
    """
    labelled = 0
    async with aclosing(line.messages()) as messages:
        await _answered(messages, Welcome)
        for trial, by_step in reasons.items():
            await line.send(Open(trial=trial))
            presses = {press["t"]: press["seq"] for press in (await _answered(messages, Replay)).presses}
            for t, seq in presses.items():
                late = by_step.get(t - 1) if t - 1 not in presses else None
                reason = by_step.get(t, late)
                if reason is not None:
                    await line.send(Label(trial=trial, press_seq=seq, mental_state=reason))
                    await _answered(messages, Acknowledged)
                    labelled += 1
    return labelled


async def _answered(messages: AsyncIterator[ToClient], kind: type[Kind]) -> Kind:
    async for message in messages:
        if isinstance(message, Problem):
            raise LineError(f"refused: {message.text}")
        if isinstance(message, kind):
            return message
    raise LineError(f"the line ended without a {kind.__name__}")
