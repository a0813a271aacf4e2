"""One participant of a study on the server: the pages one after the other, and the trials among them."""

import asyncio
import logging
from pathlib import Path
from typing import Any, Protocol

import msgspec

from taskcomm.logwriter import TrialWriter
from taskcomm.web.client import REFUSED, REPLACED, Client
from taskcomm.web.journal import Log, torn_end
from taskcomm.web.pilots import OperatorPilot, Pilot, PlannerPilot
from taskcomm.web.protocol import (
    Acknowledged,
    Answer,
    Frame,
    Page,
    PageKind,
    Press,
    Pressed,
    Problem,
    Saved,
    ToClient,
)
from taskcomm.web.services import Services
from taskcomm.web.study.answers import AnswerError, checked, rating_lines
from taskcomm.web.study.assignment import Participant, TrialPlan
from taskcomm.web.study.pages import PageSpec, declined, pages
from taskcomm.web.study.reading import StudyError
from taskcomm.web.trialfile import is_over, lines_of, writer_of
from taskcomm.web.trialrun import TrialRun, utc

log = logging.getLogger("taskcomm")


class _PageLine(msgspec.Struct):
    """What must be known of a page that was done."""

    page: int
    values: dict[str, Any]


class Surroundings(Protocol):
    """What a room needs of the study around it: its operator, and whoever looks on."""

    def refresh(self, operator: str | None) -> None: ...
    def operator_ready(self, room: "Room") -> bool: ...
    def offer(self, room: "Room") -> None: ...
    def trial_over(self, room: "Room") -> None: ...
    def watchers(self, room: "Room") -> list[Client]: ...
    def people(self, room: "Room") -> dict[str, Client]: ...
    def to_admins(self, message: ToClient) -> None: ...


class Room:
    """A participant's way through the study. What is done is in the session log; nothing else is remembered.

    It is the audience of the trial that runs in it.
    """

    def __init__(self, services: Services, around: Surroundings, participant: Participant) -> None:
        self.services, self.around, self.participant = services, around, participant
        folder = services.folder
        self.pages: tuple[PageSpec, ...] = pages(services.design, folder.texts, participant)
        self.session = folder.session_of(participant.id)
        self.client: Client | None = None
        self.run: TrialRun | None = None
        self.writer: TrialWriter | None = None  # of the last trial, for the ratings that follow it
        self.index = self._lines = 0
        self.over = self._busy = False
        self.trouble = ""
        self._task: asyncio.Task[None] | None = None
        self._recall()

    def _recall(self) -> None:
        """Where the session log says that this participant is."""
        if not self.session.exists():
            return
        torn = torn_end(self.session)
        if torn:
            self.services.note("torn", file=self.session.name, bytes=len(torn))
        for number, text in enumerate(self.session.read_bytes().splitlines(), 1):
            try:
                line = msgspec.json.decode(text, type=_PageLine)
            except ValueError as error:
                raise StudyError(f"{self.session}:{number}: is no line of a session: {error}") from None
            self._lines += 1
            self.index = line.page + 1
            self.over = self.over or line.values.get("agreed") is False

    @property
    def page(self) -> PageSpec:
        """The page that this participant is at."""
        if self.over:
            return declined(self.services.folder.texts)
        return self.pages[min(self.index, len(self.pages) - 1)]

    @property
    def plan(self) -> TrialPlan | None:
        """The trial that is next, or runs: None on pages that are about none."""
        return self.page.trial if self.page.kind in ("card", "trial") else None

    @property
    def finished(self) -> bool:
        """Whether there is nothing left to do."""
        return self.page.kind == "thanks"

    # The teacher's connection

    def attach(self, client: Client) -> None:
        """A page of this participant has connected: the newest counts."""
        if self.client is not None:
            self.client.send(Page(index=self.index, of=len(self.pages), kind="gone"))
            self.client.drop(REPLACED, "opened elsewhere")
        self.client, self.trouble = client, ""
        self.show_page()
        if self.run is not None:
            self.run.teacher_back()
            client.send(self.run.current())
        self.begin_if_ready()

    def detach(self, client: Client) -> None:
        """That connection is gone."""
        if self.client is client:
            self.client = None
            if self.run is not None:
                self.run.teacher_away()
            self.around.refresh(self.participant.operator)

    def heard(self, client: Client) -> None:
        """That connection gave a sign of life."""
        if self.client is client and self.run is not None:
            self.run.teacher_back()

    def listen(self, silence: float) -> None:
        """A page that was silent for so many seconds is away, though nobody has closed its connection."""
        if self.client is not None and self.run is not None and self.client.silent > silence:
            self.run.teacher_away(silent_ms=round(1e3 * self.client.silent))

    def show_page(self) -> None:
        """Send the page that is due: while the robot is not ready, one that says to wait."""
        if self.client is not None:
            waits = self.page.kind == "trial" and self.run is None
            kind: PageKind = "wait" if waits else self.page.kind
            content = self.page.content
            self.client.send(Page(index=self.index, of=len(self.pages), kind=kind, content=content))
        self.around.refresh(self.participant.operator)

    def press(self, client: Client, press: Press) -> None:
        """The spacebar, at most once for each number."""
        if press.n <= client.presses:
            client.drop(REFUSED, "this press was sent before")
            return
        client.presses = press.n
        if self.run is None:
            return
        done = self.run.press(n=press.n, at=press.at, **client.link.fields())
        if done is not None:
            client.acknowledge(done, Acknowledged(what="press", n=press.n))
            for other in self.watchers():
                other.send(Pressed(t=self.run.t))

    async def answer(self, client: Client, answer: Answer) -> None:
        """A page is done. Ratings are in the trial's log before the session log says so."""
        if answer.index != self.index or self._busy or self.page.kind in ("trial", "thanks"):
            self.show_page()
            return
        page = self.page
        try:
            values = checked(page, answer.values)
        except AnswerError as error:
            client.send(Problem(text=str(error)))
            return
        self._busy = True
        try:
            if page.kind == "form" and page.trial is not None:
                await self._rate(page, values)
            await self._done(page, values)
            self.trouble = ""
            client.send(Acknowledged(what="answer", n=answer.index))
        except (OSError, ValueError) as error:
            self._fail(error)
        finally:
            self._busy = False
        if not self.trouble:
            self.show_page()
            self.begin_if_ready()

    async def _rate(self, page: PageSpec, values: dict[str, Any]) -> None:
        assert page.trial is not None
        path = self.services.folder.log_of(page.trial)
        writer = self.writer or writer_of(self.services, page.trial)
        rated = {line["item"]: line["value"] for line in lines_of(path, "rating")}  # the last counts
        lines = [line for line in rating_lines(page, values) if rated.get(line["item"], ...) != line["value"]]
        self.writer = None  # should the writing fail, it is read again
        if lines:
            await self.services.journal.append(path, b"".join(writer.rating(**line) for line in lines))

    async def _done(self, page: PageSpec, values: dict[str, Any]) -> None:
        """The session log says that a page is done; then it is."""
        line = {"seq": self._lines, "type": "page", "page": self.index, "kind": page.kind, "name": page.name}
        content = msgspec.json.encode(line | {"values": values, "utc": utc()}) + b"\n"
        await self.services.journal.append(self.session, content)
        self._lines += 1
        self.index += 1
        self.over = values.get("agreed") is False

    # The trial

    def begin_if_ready(self) -> None:
        """Start the trial that is due, or go on with one that a crash cut, if everyone is there."""
        if self.page.kind != "trial" or self._task is not None or self.trouble:
            return
        if self._everyone_there():
            self._task = asyncio.create_task(self._trial(self.page))

    def _everyone_there(self) -> bool:
        """The operator is not needed for a trial whose end is on disk: a crash cut the session log alone."""
        assert self.page.trial is not None
        there = self.around.operator_ready(self) or is_over(self.services.folder.log_of(self.page.trial))
        return self.client is not None and there

    async def _trial(self, page: PageSpec) -> None:
        plan = page.trial
        assert plan is not None
        path = self.services.folder.log_of(plan)
        try:
            if not self._everyone_there():  # somebody left in the moment before
                self._task = None
                return
            self.writer = writer_of(self.services, plan)
            ended = lines_of(path, "trial_end")
            reason = ended[0]["reason"] if ended else await self._run(plan, path, self.writer)
            await self._done(page, {"trial_id": plan.trial_id, "reason": reason})
        except Exception as error:
            self._fail(error)
        self.run = self._task = None
        self.around.trial_over(self)
        if not self.trouble:
            self.show_page()

    async def _run(self, plan: TrialPlan, path: Path, writer: TrialWriter) -> str:
        services = self.services
        pilot: Pilot = OperatorPilot(services.world)
        waits_for = {"teacher"} | ({"operator"} if plan.controller == "operator" else set())
        if plan.controller == "planner":
            pilot = PlannerPilot(services.minds, services.robots[plan.condition])
        run = TrialRun(
            writer,
            pilot,
            Log(services.journal, path).append,
            self,
            services.timing,
            frozenset(waits_for),
        )
        self.run = run
        self.show_page()
        return await run.run()

    def _fail(self, error: Exception) -> None:
        """Nothing goes on in this room until its page is loaded anew, or the answer given again.

        What was acknowledged is there.
        """
        self.trouble = f"{type(error).__name__}: {error}"
        log.error("%s: stopped: %s", self.participant.id, self.trouble)
        self.services.note("stopped", participant=self.participant.id, reason=self.trouble)
        if self.page.kind == "trial":
            self.run = None
            self.show_page()
        if self.client is not None:
            self.client.send(Problem(text=self.services.folder.texts.interface.get("problem_storage", "")))

    # The audience of the trial

    def watchers(self) -> list[Client]:
        """Who sees this trial beside the teacher: its operator, and admins who watch."""
        return self.around.watchers(self)

    def show(self, frame: Frame) -> None:
        """To everyone who sees this trial."""
        for client in (*([self.client] if self.client else []), *self.watchers()):
            client.send(frame)

    def opened(self) -> None:
        """To the operator: the actions of this step."""
        self.around.offer(self)

    def saved(self, seq: int) -> None:
        """To admins: lines are on disk."""
        if self.writer is not None:
            self.around.to_admins(Saved(trial=self.writer.head.trial_id, seq=seq))

    def clocks(self) -> dict[str, Any]:
        """Of the teacher's page, and of the operator's."""
        return {
            f"{role}_{name}": value
            for role, client in self.around.people(self).items()
            for name, value in client.link.fields().items()
        }

    def status(self) -> dict[str, Any]:
        """A line of the admin's table."""
        run, plan, link = self.run, self.plan, self.client.link if self.client else None
        steps = run.writer.steps if run is not None else []
        return {
            "participant": self.participant.id,
            "page": self.index,
            "of": len(self.pages),
            "kind": self.page.kind,
            "trial": plan.trial_id if plan else None,
            "condition": plan.condition if plan else None,
            "connected": self.client is not None,
            "operator": self.participant.operator,
            "state": self.trouble or (run.mode if run else ""),
            "t": run.t if run else None,
            "late_ms": max(run.clock.late, default=None) if run else None,
            "rtt_ms": link.best[0] if link and link.best else None,
            "lost": sum(step.pressed is None for step in steps),
            "defaults": run.defaults if run else 0,
        }
