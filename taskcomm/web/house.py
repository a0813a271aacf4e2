"""A study on the server: its rooms, its operators' desks, who looks on, what is written where."""

import asyncio
import itertools
import logging
import time
from typing import Self

from taskcomm.web.archive import Archive
from taskcomm.web.client import REFUSED, REPLACED, Client
from taskcomm.web.desk import Desk
from taskcomm.web.protocol import (
    Acknowledged,
    Act,
    Answer,
    Done,
    Focus,
    Label,
    Listing,
    Message,
    Open,
    Order,
    Pong,
    Press,
    Problem,
    Ready,
    Status,
    ToClient,
    Watch,
)
from taskcomm.web.rooms import Room
from taskcomm.web.services import Services
from taskcomm.web.study.folder import Seat, StudyFolder

# What each role may send, beside pongs.
_ALLOWED: dict[str, tuple[type, ...]] = {
    "teacher": (Press, Focus, Answer, Done),
    "operator": (Act, Ready, Done),
    "admin": (Watch, Order, Open, Listing),
    "annotator": (Open, Label, Listing),
}
PING_EVERY, LOG_CLOCK_EVERY, STATUS_EVERY = 2.0, 10.0, 1.0
SILENCE = 5.0  # seconds without a word, pongs neither, after which a teacher's page counts as away

log = logging.getLogger("taskcomm")


class House:
    """Everything that a running study holds. One event loop uses it; only the journal has a thread."""

    def __init__(self, services: Services) -> None:
        self.services, self.folder, self.design = services, services.folder, services.design
        self.timing = services.timing
        self.rooms = {person.id: Room(services, self, person) for person in self.folder.participants}
        self.desks = {
            name: Desk(
                name,
                [room for room in self.rooms.values() if room.participant.operator == name],
                self.design.operator_sees_card,
            )
            for name in self.folder.operators
        }
        self.admins: set[Client] = set()
        self.annotators: dict[str, Client] = {}
        self.clients: set[Client] = set()
        self.archive = Archive(self.folder)
        self._labelling = asyncio.Lock()

    @classmethod
    def of(cls, folder: StudyFolder, *, processes: int = 1, lockstep: bool = False) -> Self:
        """Of a study's folder, ready to be served."""
        services = Services(folder, processes, lockstep)
        services.start()
        return cls(services)

    # Who comes, speaks and goes

    def attach(self, client: Client, seat: Seat) -> None:
        """A client has shown its token."""
        client.role, client.name = seat.role, seat.name
        self.clients.add(client)
        self.services.note("connect", role=seat.role, name=seat.name)
        if seat.role == "teacher":
            self.rooms[seat.name].attach(client)
        elif seat.role == "operator":
            self.desks[seat.name].attach(client)
        elif seat.role == "admin":
            self.admins.add(client)
            client.send(self.status())
        else:
            before = self.annotators.get(seat.name)
            if before is not None:
                before.drop(REPLACED, "opened elsewhere")
            self.annotators[seat.name] = client

    def detach(self, client: Client) -> None:
        """A client has gone."""
        self.clients.discard(client)
        self.admins.discard(client)
        if client.role == "teacher":
            self.rooms[client.name].detach(client)
        elif client.role == "operator":
            self.desks[client.name].detach(client)
        elif self.annotators.get(client.name) is client:
            del self.annotators[client.name]
        if client.role is not None:
            self.services.note("disconnect", role=client.role, name=client.name)

    async def handle(self, client: Client, message: Message) -> None:
        """One message of a client that said hello; one that its role may not send drops it."""
        if client.role == "teacher":
            self.rooms[client.name].heard(client)
        if isinstance(message, Pong):
            if not client.link.pong(message):
                client.drop(REFUSED, "no such ping")
        elif not isinstance(message, _ALLOWED[client.role or ""]):
            client.drop(REFUSED, "not yours to send")
        elif client.role == "teacher":
            await self._of_teacher(client, message)
        elif client.role == "operator":
            self.desks[client.name].handle(client, message)
        elif isinstance(message, Watch):
            self._watch(client, message.participant)
        elif isinstance(message, Order):
            self._order(client, message)
        else:
            await self._of_reader(client, message)

    async def _of_teacher(self, client: Client, message: Message) -> None:
        room = self.rooms[client.name]
        if room.client is not client:
            return
        if isinstance(message, Press):
            room.press(client, message)
        elif isinstance(message, Answer):
            await room.answer(client, message)
        elif room.run is not None:
            if isinstance(message, Focus):
                room.run.event("focus", on=message.on, at=message.at)
            elif isinstance(message, Done) and self.timing.lockstep:
                room.run.done("teacher", message.t)

    def _watch(self, client: Client, participant: str | None) -> None:
        room = self.rooms.get(participant or "")
        client.watched = room.participant.id if room else None
        if room is not None and room.run is not None:
            client.send(room.run.current())

    def _order(self, client: Client, order: Order) -> None:
        room = self.rooms.get(order.participant)
        if room is None or room.run is None:
            client.send(Problem(text="no trial is running there"))
            return
        room.run.order(order.what)

    async def _of_reader(self, client: Client, message: Message) -> None:
        """Replays and labels."""
        annotator = None if client.role == "admin" else client.name
        try:
            if isinstance(message, Listing):
                client.send(await self.archive.trials(annotator))
            elif isinstance(message, Open):
                client.send(await self.archive.opened(message.trial, message.model, annotator))
            elif isinstance(message, Label):
                await self._label(client, message)
        except ValueError as error:
            client.send(Problem(text=str(error)))
        except OSError as error:
            log.error("a label, or what was asked of the logs: %s", error)
            client.send(Problem(text="the logs cannot be read or written now"))

    async def _label(self, client: Client, label: Label) -> None:
        async with self._labelling:
            at = [room.page.trial for room in self.rooms.values()]
            if any(plan is not None and plan.trial_id == label.trial for plan in at):
                raise ValueError("this trial is not over yet")
            path, line = await self.archive.label_line(label, client.name)
            await self.services.journal.append(path, line)
        client.send(Acknowledged(what="label", n=label.press_seq))

    # Operators

    def refresh(self, operator: str | None) -> None:
        """An operator may have something else to do now."""
        if operator is not None and self.desks:
            self.desks[operator].refresh()

    def operator_ready(self, room: Room) -> bool:
        """Whether the trial of a room may begin; where there are no operators, at once."""
        operator = room.participant.operator
        return operator is None or self.desks[operator].ready_for(room)

    def offer(self, room: Room) -> None:
        """Tell the operator in control what can be done in this step."""
        if room.participant.operator is not None:
            self.desks[room.participant.operator].offer(room)

    def trial_over(self, room: Room) -> None:
        """The operator is asked again before the next trial."""
        if room.participant.operator is not None:
            self.desks[room.participant.operator].trial_over()

    # Whoever looks on

    def watchers(self, room: Room) -> list[Client]:
        """The operator at this room's trial, and the admins who watch it."""
        desk = self.desks.get(room.participant.operator or "")
        seen = [desk.client] if desk is not None and desk.room is room and desk.client is not None else []
        return [*seen, *(admin for admin in self.admins if admin.watched == room.participant.id)]

    def people(self, room: Room) -> dict[str, Client]:
        """Who takes part in the trial of a room and is connected, by role."""
        desk = self.desks.get(room.participant.operator or "")
        at_desk = desk.client if desk is not None and desk.room is room else None
        both = {"teacher": room.client, "operator": at_desk}
        return {role: client for role, client in both.items() if client is not None}

    def to_admins(self, message: ToClient) -> None:
        """To every admin."""
        for admin in self.admins:
            admin.send(message)

    def status(self) -> Status:
        """What the admin page shows."""
        rooms = [room.status() for room in self.rooms.values()]
        running = [room.run for room in self.rooms.values() if room.run is not None]
        late = [ms for run in running for ms in run.clock.late[-20:]]
        server = {
            "trials": len(running),
            "clients": len(self.clients),
            "late_ms": round(max(late, default=0.0), 3),
            "missed": sum(run.clock.summary()["missed"] for run in running),
            "simulated": self.design.simulated,
        }
        return Status(participants=rooms, server=server)

    # Running

    async def beat(self) -> None:
        """Pings, clocks of clients into the logs, tables of the admins: as long as the server runs."""
        stalled = False
        for number in itertools.count():
            try:
                self._beat(number, stalled)
            except Exception:  # the next one may go well; without any, nobody would be pinged
                log.exception("the beat of the server")
            began = time.monotonic()
            await asyncio.sleep(STATUS_EVERY)
            stalled = time.monotonic() - began > 2 * STATUS_EVERY

    def _beat(self, number: int, stalled: bool) -> None:
        """`stalled`: this server was silent itself, and has yet to read what came meanwhile."""
        if number % round(PING_EVERY / STATUS_EVERY) == 0:
            for client in list(self.clients):
                client.send(client.link.ping())
        if number % round(LOG_CLOCK_EVERY / STATUS_EVERY) == 0:
            self._log_clocks()
        if not (self.timing.lockstep or stalled):
            for room in self.rooms.values():
                room.listen(SILENCE)
        if self.admins:
            self.to_admins(self.status())

    def _log_clocks(self) -> None:
        """Round-trip time and offset of the clients of every trial that runs, beside its steps."""
        if self.timing.lockstep:
            return
        for room in self.rooms.values():
            if room.run is None or room.run.mode != "run":
                continue
            for role, client in self.people(room).items():
                if client.link.best is not None:
                    room.run.event("clock", role=role, **client.link.fields())

    def close(self) -> None:
        """Write what waits; end the other processes."""
        self.archive.close()
        self.services.close()
