"""Labels from a program that knows why a press happened, over the annotator's line."""

from collections.abc import AsyncIterator, Mapping
from contextlib import aclosing
from typing import TypeVar

from taskcomm.web.bots.line import Line, LineError
from taskcomm.web.protocol import Acknowledged, Label, Open, Problem, Replay, ToClient, Welcome

Kind = TypeVar("Kind", bound=ToClient)


async def label_presses(line: Line, reasons: Mapping[str, Mapping[int, str]]) -> int:
    """As an annotator, label the presses that `reasons` knows, by trial id and step; how many there were.

    Raises LineError where the server refuses.
    """
    labelled = 0
    async with aclosing(line.messages()) as messages:
        await _answered(messages, Welcome)
        for trial, by_step in reasons.items():
            await line.send(Open(trial=trial))
            for press in (await _answered(messages, Replay)).presses:
                if press["t"] in by_step:
                    label = Label(trial=trial, press_seq=press["seq"], mental_state=by_step[press["t"]])
                    await line.send(label)
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
