"""One operator on the server: which trial is theirs, whether they are ready, what they choose."""

from collections.abc import Sequence

from taskcomm.web.client import REFUSED, REPLACED, Client
from taskcomm.web.pilots import OperatorPilot
from taskcomm.web.protocol import Act, Choices, Done, Message, Page, Ready, Seat, SeatState
from taskcomm.web.rooms import Room


class Desk:
    """An operator has one room at a time: that of the trial which runs, else of a teacher who waits or reads.

    Every trial of these rooms begins only when the operator said to be ready, whoever will control the robot.
    """

    def __init__(self, name: str, rooms: Sequence[Room], sees_card: bool) -> None:
        self.name, self._rooms, self._sees_card = name, rooms, sees_card
        self.client: Client | None = None
        self.ready = False
        self.room: Room | None = None

    def attach(self, client: Client) -> None:
        """The operator's page has connected: the newest counts."""
        if self.client is not None:
            self.client.send(Page(index=0, of=0, kind="gone"))
            self.client.drop(REPLACED, "opened elsewhere")
        elif self.room is not None and self.room.run is not None:
            self.room.run.event("operator_back")
        self.client = client
        self.refresh()
        if self.room is not None and self.room.run is not None:
            client.send(self.room.run.current())
            self.offer(self.room)

    def detach(self, client: Client) -> None:
        """The operator's page is gone; a trial that runs goes on, without actions."""
        if self.client is client:
            self.client, self.ready = None, False
            if self.room is not None and self.room.run is not None:
                self.room.run.event("operator_away")

    def _due(self) -> Room | None:
        running = [room for room in self._rooms if room.run is not None]
        if running:
            return running[0]
        able = [room for room in self._rooms if room.client is not None and not room.trouble]
        present = [room for room in able if room.plan is not None]
        waiting = [room for room in present if room.page.kind == "trial"]
        stays = [self.room] if self.room in present else []
        return next(iter((*waiting, *stays, *present)), None)

    def refresh(self) -> None:
        """Tell the operator what is asked now."""
        due = self._due()
        if due is not self.room:
            self.ready = self.ready and due is not None and due.run is not None
            self.room = due
        if self.client is not None:
            self.client.send(self._seat())

    def _seat(self) -> Seat:
        if self.room is None or self.room.plan is None:
            return Seat(state="idle", participant="")
        plan = self.room.plan
        who = self.room.participant.id
        if self.room.run is None:
            return Seat(state="wait" if self.ready else "ask", participant=who)
        card = list(plan.task) if self._sees_card else []
        state: SeatState = "control" if plan.controller == "operator" else "watch"
        return Seat(state=state, participant=who, card=card)

    def ready_for(self, room: Room) -> bool:
        """Whether the operator is there and ready for this room's trial."""
        return self.room is room and self.ready and self.client is not None

    def trial_over(self) -> None:
        """Ready is said anew for every trial."""
        self.ready = False
        self.refresh()

    def offer(self, room: Room) -> None:
        """What can be done in this step, where the operator is in control."""
        if self.client is None or self.room is not room or room.run is None:
            return
        pilot = room.run.pilot
        if isinstance(pilot, OperatorPilot):
            self.client.send(Choices(t=room.run.t, actions=pilot.offered, chosen=pilot.chosen))

    def handle(self, client: Client, message: Message) -> None:
        """What an operator may send. An action for a step that is over, or not valid, changes nothing."""
        if self.client is not client:
            return
        room = self.room
        if isinstance(message, Ready):
            self.ready = message.on and room is not None
            self.refresh()
            if room is not None:
                room.begin_if_ready()
        elif room is None or room.run is None:
            return
        elif isinstance(message, Done) and room.run.timing.lockstep:
            room.run.done("operator", message.t)
        elif isinstance(message, Act):
            self._act(room, client, message)

    def _act(self, room: Room, client: Client, act: Act) -> None:
        run = room.run
        if run is None or not isinstance(run.pilot, OperatorPilot):
            client.drop(REFUSED, "not yours to control")
            return
        in_time = run.t - 1 <= act.t <= run.t  # a click may cross the tick on its way
        valid = in_time and not run.held and run.pilot.choose(act.action)
        said = {"action": act.action[:40], "at": act.at, "shown": act.t, "valid": valid}
        run.event("act", **said, **client.link.fields())
        self.offer(room)
