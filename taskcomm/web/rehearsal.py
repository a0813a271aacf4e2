"""A study with programs in the places of all its people: simulated, and said to be so in every log."""

import asyncio
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import aclosing
from dataclasses import dataclass, field

import msgspec
import numpy as np

from taskcomm.studies import drawn_teacher
from taskcomm.teacher import TeacherModel
from taskcomm.web.bots import Line, LineError, OperatorBot, TeacherBot, label_presses
from taskcomm.web.bots.lessons import FrameError
from taskcomm.web.protocol import Role, Saved, Status
from taskcomm.web.study.folder import StudyFolder
from taskcomm.web.study.structure import Design

ANNOTATOR = "simulated"
RUNNING = ("count", "run", "pause", "over")
Heard = Callable[[float, bytes], None]


class RehearsalError(OSError):
    """A rehearsal that could not go on; says which bot and why."""


def rehearsed(design: Design, teachers: int | None = None) -> Design:
    """The design of a rehearsal: the same, but simulated, and the annotator is a program."""
    changes = {"simulated": True, "annotators": (ANNOTATOR,)} | ({"teachers": teachers} if teachers else {})
    return msgspec.structs.replace(design, **changes)


def spread_of_teachers(folder: StudyFolder, seed: int) -> dict[str, TeacherModel]:
    """A teacher model of their own for every participant, drawn as those of the simulated study are."""
    step = folder.design.timing.step
    drawn = {}
    for number, person in enumerate(folder.participants):
        model = drawn_teacher(np.random.default_rng([seed, number]))
        drawn[person.id] = model if step == model.dt else model.with_dt(step)
    return drawn


@dataclass
class Rehearsal:
    """Everybody of a study folder, at the server at `address`; `run()` goes through the whole study.

    `at_once` participants come at the same time, one to an operator. `heard`, by participant id, gets what
    the server sends to that teacher. `saved` has, by trial, the greatest seq that the server said is on disk.
    Nobody waits longer than `patience` seconds for a server that is down, or `stall` for a study that does
    not get on.
    """

    folder: StudyFolder
    address: str
    models: Mapping[str, TeacherModel]
    seed: int = 0
    at_once: int = 8
    patience: float = 30.0
    stall: float = 60.0
    heard: Mapping[str, Heard] = field(default_factory=dict)
    progress: Callable[[int], None] = lambda _done: None
    teachers: dict[str, TeacherBot] = field(default_factory=dict)
    operators: dict[str, OperatorBot] = field(default_factory=dict)
    saved: dict[str, int] = field(default_factory=dict)
    seconds: float = 0.0

    async def run(self) -> None:
        """To the page of thanks of the last participant. Raises RehearsalError."""
        began = time.monotonic()
        self._turns = asyncio.Semaphore(self.at_once)
        self._seats = {name: asyncio.Semaphore(1) for name in self.folder.operators}
        self._seats[""] = asyncio.Semaphore(len(self.folder.participants))  # where there are no operators
        staff = [
            asyncio.create_task(self._operator(name, place))
            for place, name in enumerate(self.folder.operators)
        ]
        staff.append(asyncio.create_task(self._look_on()))
        people = [asyncio.create_task(self._teacher(n)) for n in range(len(self.folder.participants))]
        try:
            await self._all_of(people, staff)
        finally:
            for task in (*staff, *people):
                task.cancel()
            await asyncio.gather(*staff, *people, return_exceptions=True)
        self.seconds = time.monotonic() - began

    def _line(self, role: Role, name: str) -> Line:
        token = self.folder.tokens[role][name]
        heard = self.heard.get(name) if role == "teacher" else None
        return Line(self.address, token, patience=self.patience, heard=heard)

    async def _teacher(self, number: int) -> None:
        person = self.folder.participants[number]
        async with self._seats[person.operator or ""], self._turns:
            bot = TeacherBot(self._line("teacher", person.id), self.models[person.id], [self.seed, number])
            self.teachers[person.id] = bot
            await bot.run()
        self.progress(sum(teacher.finished for teacher in self.teachers.values()))

    async def _operator(self, name: str, place: int) -> None:
        bot = OperatorBot(self._line("operator", name), self.folder.design.timing.step, [self.seed, place])
        self.operators[name] = bot
        await bot.run()

    async def _look_on(self) -> None:
        """As the admin: note what is saved; raise RehearsalError where the server gave up on a trial."""
        async with aclosing(self._line("admin", "admin").messages()) as messages:
            async for message in messages:
                if isinstance(message, Saved):
                    self.saved[message.trial] = max(message.seq, self.saved.get(message.trial, -1))
                elif isinstance(message, Status):
                    for person in message.participants:
                        if person["state"] not in ("", *RUNNING):
                            raise RehearsalError(f"{person['participant']}: stopped: {person['state']}")

    async def _all_of(
        self, people: Sequence["asyncio.Task[None]"], staff: Sequence["asyncio.Task[None]"]
    ) -> None:
        """Until all people are done, or one of anybody fails, or nobody gets on."""
        waiting, before = set(people), ""
        while waiting:
            done, _ = await asyncio.wait(
                {*waiting, *staff}, timeout=self.stall, return_when=asyncio.FIRST_COMPLETED
            )
            for task in done:
                try:
                    task.result()
                except (LineError, FrameError) as error:
                    raise RehearsalError(str(error)) from None
            waiting -= done
            if not done and self._places() == before:
                raise RehearsalError(f"nobody got on for {self.stall:g} s: {before}")
            before = self._places()

    def _places(self) -> str:
        """Where everybody is who is on the way."""
        at = {name: bot for name, bot in self.teachers.items() if not bot.finished}
        return ", ".join(
            f"{name} at page {bot.page.index if bot.page else 'none'}, step"
            f" {len(bot.lessons[-1].moments) if bot.lessons else 'none'}"
            for name, bot in at.items()
        )

    def reasons(self) -> dict[str, dict[int, str]]:
        """Why the teachers pressed, by trial and step; practice is left out."""
        known: dict[str, dict[int, str]] = {}
        for person in self.folder.participants:
            lessons = self.teachers[person.id].lessons
            for plan, lesson in zip(person.trials, lessons, strict=True):
                presses = {t: m.mental_state for t, m in enumerate(lesson.moments) if m.pressed}
                known |= {} if plan.practice else {plan.trial_id: presses}
        return known

    async def label(self) -> int:
        """Have the true reason of every press written into the logs, as a label; how many there were."""
        return await label_presses(self._line("annotator", ANNOTATOR), self.reasons())
