"""A simulated participant at the teacher's page."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import aclosing
from typing import Any

import numpy as np

from taskcomm.tasks import Task
from taskcomm.teacher import TeacherModel
from taskcomm.web.bots.answers import answers
from taskcomm.web.bots.latency import latency
from taskcomm.web.bots.lessons import Lesson
from taskcomm.web.bots.line import Line, LineError, now_ms
from taskcomm.web.protocol import (
    Acknowledged,
    Answer,
    Done,
    Frame,
    FromClient,
    Page,
    Press,
    Problem,
    ToClient,
    Welcome,
)


class TeacherBot:
    """A participant whose mental state is drawn from `model`; `run()` goes through all pages.

    In real time a press comes within its step, after a `latency`; in lockstep at once, and the same `seed`
    gives the same presses and answers. `lessons` are the trials so far, true mental states included, and
    `acknowledged` what the server said is on disk: numbers by kind of message.
    """

    def __init__(self, line: Line, model: TeacherModel, seed: Sequence[int]) -> None:
        self.line, self.model, self.seed = line, model, tuple(seed)
        self.lessons: list[Lesson] = []
        self.acknowledged: dict[str, set[int]] = {}
        self.page: Page | None = None
        self.finished = False
        self._lockstep = False
        self._presses = 0
        self._rng = np.random.default_rng([*self.seed, 0])

    async def run(self) -> None:
        """Until the page of thanks. Raises LineError where the line is lost, or something refused."""
        async with aclosing(self.line.messages()) as messages:
            async for message in messages:
                await self._hear(message)
                if self.finished:
                    return

    async def _hear(self, message: ToClient) -> None:
        match message:
            case Welcome():
                self._lockstep = message.lockstep
            case Page():
                await self._turn(message)
            case Frame():
                await self._watch(message)
            case Acknowledged():
                self.acknowledged.setdefault(message.what, set()).add(message.n)
            case Problem():
                raise LineError(f"refused: {message.text}")

    async def _turn(self, page: Page) -> None:
        self.page = page
        if page.kind == "gone":
            raise LineError(f"{self.line.address}: another page took over")
        if page.kind == "thanks":
            self.finished = True
        elif page.kind == "card":
            self._begin_lesson(page)
            await self._answer(page, {})
        elif page.kind in ("text", "consent", "form"):
            await self._answer(page, self._values(page))

    def _begin_lesson(self, page: Page) -> None:
        if self.lessons and self.lessons[-1].number == page.index:
            return
        task = Task(page.content["mov"], page.content["wrt"], page.content["dist"])
        self.lessons.append(Lesson(page.index, task, self.model, [*self.seed, 1, page.index]))

    def _values(self, page: Page) -> Mapping[str, Any]:
        if page.kind == "consent":
            return {"agreed": True}
        if page.kind == "text":
            return {}
        last = self.lessons[-1] if self.lessons else None
        rng = np.random.default_rng([*self.seed, 2, page.index])
        steps = len(last.moments) if last else 0
        return answers(page.content["items"], last.right if last else None, steps, rng)

    async def _answer(self, page: Page, values: Mapping[str, Any]) -> None:
        await self._after(0.5, lambda: Answer(index=page.index, values=dict(values)))

    async def _watch(self, frame: Frame) -> None:
        if not self.lessons:
            return
        pressed = self.lessons[-1].see(frame)
        if frame.state != "run":
            return
        if pressed:
            await self._after(self.model.dt, self._press)
        if self._lockstep:
            await self.line.send(Done(t=frame.t))

    def _press(self) -> Press:
        self._presses += 1
        return Press(n=self._presses, at=now_ms())

    async def _after(self, step: float, message: Callable[[], FromClient]) -> None:
        """Send at once in lockstep, else at a human moment of a `step`."""
        if self._lockstep:
            await self.line.send(message())
        else:
            self.line.send_later(latency(step, self._rng), message)
