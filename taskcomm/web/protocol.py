"""What browser and server say to each other: JSON objects over one WebSocket, each with its `type`.

A client sends `hello` first, with the token of its role; `welcome` answers it, and from then on the server
speaks when there is something to say. Times of the server are milliseconds since the trial's first step was
due; times of a client (`at`) are milliseconds since 1970 by the clock of its browser.

What a teacher receives has the same form whoever controls the robot: `Frame` has no field that tells, comes
at the same moment of the step, and is padded to one size (`padded`).
"""

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct

VERSION = 1
LONGEST = 16 * 1024  # bytes of one message from a client
FRAME_BYTES = 512

Name = Annotated[str, Meta(min_length=1, max_length=200)]
Natural = Annotated[int, Meta(ge=0, le=2**53)]
Moment = Annotated[float, Meta(ge=0, le=1e15)]


class FromClient(Struct, tag_field="type", forbid_unknown_fields=True, kw_only=True):
    """Anything that a client may send."""


class Hello(FromClient, tag="hello"):
    """First message: the token of a role, from the link."""

    token: Annotated[str, Meta(max_length=200)]
    version: int = VERSION


class Pong(FromClient, tag="pong"):
    """Answers the ping `n` at once: gives round-trip time and clock offset."""

    n: Natural
    at: Moment


class Press(FromClient, tag="press"):
    """Teacher: the spacebar went down (a held key once). `n` counts presses of this page from 1."""

    n: Natural
    at: Moment


class Focus(FromClient, tag="focus"):
    """Teacher: the page lost or got back the keyboard."""

    on: bool
    at: Moment


class Answer(FromClient, tag="answer"):
    """Teacher: done with the page `index`; the answers by item (consent, forms), {} where there are none."""

    index: Natural
    values: dict[Name, str | int | float | bool | None] = {}


class Act(FromClient, tag="act"):
    """Operator: `action` as it prints (`light_on(1)`), or `final`, chosen while step `t` was shown.

    It counts if it is valid when it comes, in that step or the one after; the last of a step is taken."""

    t: Annotated[int, Meta(ge=-1, le=2**53)]
    action: Name
    at: Moment = 0.0


class Ready(FromClient, tag="ready"):
    """Operator: ready for the next trial (`on` false: not any more)."""

    on: bool = True


class Done(FromClient, tag="done"):
    """Bots, in lockstep only: nothing more to come in step `t`."""

    t: int


class Watch(FromClient, tag="watch"):
    """Admin: send the frames of this participant; null: of none."""

    participant: Name | None


class Order(FromClient, tag="order"):
    """Admin: pause, go on with, or abort the running trial of this participant."""

    participant: Name
    what: Literal["pause", "go_on", "abort"]


class Open(FromClient, tag="open"):
    """Admin or annotator: a logged trial. An admin may name a `model`; an annotator gets no belief."""

    trial: Name
    model: Name | None = None


class Label(FromClient, tag="label"):
    """Annotator: why the press in the step line `press_seq` of a trial happened."""

    trial: Name
    press_seq: Natural
    mental_state: Name


class Listing(FromClient, tag="list"):
    """Admin or annotator: the trials that can be opened."""


Message = Hello | Pong | Press | Focus | Answer | Act | Ready | Done | Watch | Order | Open | Label | Listing
_decoder = msgspec.json.Decoder(Message)


def decode(text: str | bytes) -> Message:
    """A client's message; msgspec.DecodeError (a ValueError) for anything else."""
    try:
        message: Message = _decoder.decode(text)
    except RecursionError:
        raise msgspec.DecodeError("nested too deeply") from None
    return message


class ToClient(Struct, tag_field="type", kw_only=True):
    """Anything that the server may send."""


PageKind = Literal["text", "consent", "form", "card", "wait", "trial", "thanks", "gone"]
SeatState = Literal["idle", "ask", "wait", "watch", "control"]
Role = Literal["teacher", "operator", "admin", "annotator"]


class Welcome(ToClient, tag="welcome"):
    """Answers `hello`. `texts` are the words of the interface in the study's language, by key."""

    role: Role
    title: str
    name: str  # participant, operator or annotator id; "" for the admin
    language: str
    texts: dict[str, str]
    lockstep: bool = False


class Page(ToClient, tag="page"):
    """Teacher: show this page. Pages `kind`:

    text: title, body (list of paragraphs), button. consent: the same with `decline`. form: title, items (list
    of {item, text, kind: integer|scale|choice|text, low, high, low_label, high_label, choices, optional}),
    button. card: the task's sentence, mov/wrt/dist, button "begin". wait: the robot is not ready yet.
    trial: frames follow. thanks: the end. gone: this tab was replaced by a newer one, or the study is closed.
    """

    index: int
    of: int
    kind: PageKind
    content: dict[str, Any] = {}


class Frame(ToClient, tag="frame"):
    """The world during step `t`, to teacher, operator and admin. t = -1: before the first step.

    `lit`: balls; `held`: ball or 0; `placements`: [ball, reference ball, distance] of each placed ball;
    `slid`: [ball, reference, distance] if the step's action was a slide, else []; `final`: [mov, wrt, dist]
    displayed, or []. `count` is the seconds left before the clock starts, 0 when it runs; `state` is
    `count`, `run`, `pause` or `over`.
    """

    t: int
    balls: int
    distances: int
    lit: list[int]
    held: int
    placements: list[list[int]]
    slid: list[int]
    final: list[int]
    count: int
    state: Literal["count", "run", "pause", "over"]
    action: str  # as it prints; "" before the first, "final" at the end


class Pressed(ToClient, tag="pressed"):
    """To operator and admin: a press arrived. (The teacher's page draws its own at once.)"""

    t: int


class Seat(ToClient, tag="seat"):
    """Operator: what is asked now. `state`: idle (no teacher yet), ask (say ready), wait (teacher is
    reading), watch (this trial is not yours to control, but look ready), control (yours)."""

    state: SeatState
    participant: str
    card: list[int] = []  # only where the study says so


class Choices(ToClient, tag="choices"):
    """Operator in control: valid actions in the world of step `t` as they print, `final` among them where
    a ball is placed; and what was chosen for the next step so far, or ""."""

    t: int
    actions: list[str]
    chosen: str


class Acknowledged(ToClient, tag="ack"):
    """It is on disk: `what` of the client's message (press, answer, label, focus) and its `n` or index."""

    what: str
    n: int


class Saved(ToClient, tag="saved"):
    """Admin: the lines of this trial's log up to `seq` are on disk. (Their number could tell a teacher who
    controls the robot.)"""

    trial: str
    seq: int


class Ping(ToClient, tag="ping"):
    n: int


class Status(ToClient, tag="status"):
    """Admin: every participant: {participant, page, of, kind, condition, connected, operator, state, t,
    late_ms, rtt_ms, lost}, and the server: {trials, lateness, missed, load}."""

    participants: list[dict[str, Any]]
    server: dict[str, Any]


class Trials(ToClient, tag="trials"):
    """Admin or annotator: [{trial, participant, index, steps, presses, source, labelled}], to an admin also
    condition, reason, correct, lost, defaults, or instead of all of them a `problem` of the log."""

    trials: list[dict[str, Any]]
    models: list[str]


class Replay(ToClient, tag="replay"):
    """A logged trial: its frames; presses [{t, seq, label}], to an admin with labels by annotator and the
    state noted in a simulated log; `states` that a label may name. Only to an admin: `belief` as the replay
    gives it (time, entropy, marginals, model), `reasons` [{at_once, at_end}] by press, and `about` the trial.
    """

    trial: str
    dt: float
    frames: list[dict[str, Any]]
    presses: list[dict[str, Any]]
    card: list[int]
    belief: dict[str, Any] | None
    reasons: list[dict[str, Any]] | None
    source: str = "human"
    states: list[str] = []
    about: dict[str, Any] = {}


class Problem(ToClient, tag="problem"):
    """What was wrong with a client's message, in words for a person; nothing of the server's insides."""

    text: str


ToAny = (
    Welcome
    | Page
    | Frame
    | Pressed
    | Seat
    | Choices
    | Acknowledged
    | Saved
    | Ping
    | Status
    | Trials
    | Replay
    | Problem
)
_encoder = msgspec.json.Encoder()


def encode(message: ToClient) -> bytes:
    """One message to a client; a frame has always the same size."""
    content = _encoder.encode(message)
    return padded(content) if isinstance(message, Frame) else content


def padded(content: bytes, size: int = FRAME_BYTES) -> bytes:
    """With blanks before the last brace, to the next multiple of `size` bytes."""
    return content[:-1] + b" " * (-len(content) % size) + content[-1:]
