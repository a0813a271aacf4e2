"""The lines of a trial log, one by one: what each holds, and its JSON Schema.

A log is JSON Lines, schema `taskcomm.trial/1`. The structures below are the only statement of it:
`taskcomm/schemas/trial.schema.json` is made from them by `python -m taskcomm.loglines`.
"""

import json
import re
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct

MAJOR = 1
SCHEMA = f"taskcomm.trial/{MAJOR}"
SCHEMA_FILE = Path(__file__).with_name("schemas") / "trial.schema.json"

_VERSION = re.compile(r"taskcomm\.trial/(\d+)(\.\d+)?")
Name = Annotated[str, Meta(min_length=1)]
Natural = Annotated[int, Meta(ge=0)]
Count = Annotated[int, Meta(ge=1)]
Seconds = Annotated[float, Meta(gt=0)]


class LineError(ValueError):
    """What is wrong with one line, without its place."""


class ActionPart(Struct, kw_only=True):
    """An action: the fields that it has, or the name alone in another World than BallWorld."""

    name: Name
    ball: Count | None = None
    distance: Count | None = None
    reference: Count | None = None


class TaskPart(Struct, kw_only=True):
    """A task: mov, wrt and dist, or the name alone in another World than BallWorld."""

    mov: Count | None = None
    wrt: Count | None = None
    dist: Count | None = None
    name: Name | None = None


class Line(Struct, kw_only=True, tag_field="type"):
    """Every line names its trial and its place in it, from 0."""

    trial_id: Name
    seq: Natural


class TrialStart(Line, kw_only=True, tag="trial_start"):
    """First line of a trial. `world` is what `World.spec()` says, or its name."""

    schema: Annotated[str, Meta(pattern=rf"^taskcomm\.trial/{MAJOR}(\.[0-9]+)?$")]
    world: dict[str, Any]
    dt: Seconds
    task: TaskPart | None
    source: Literal["simulated", "human"]
    taskcomm_version: str | None = None
    participant_id: str | None = None
    operator_id: str | None = None
    session: str | None = None
    trial_index: Natural = 0
    condition: Name = "other"
    robot_model: dict[str, str] | None = None
    planner: dict[str, Any] | None = None
    started_utc: str | None = None


class StepLine(Line, kw_only=True, tag="step"):
    """One time step `t`, from 0: the action, then the spacebar (null: not recorded) and other signals."""

    t: Natural
    action: ActionPart
    action_source: Literal["planner", "operator", "default"]
    press: bool | None
    timing: dict[str, float] | None = None
    mental_state: Name | None = None
    signals: dict[Name, str | float] | None = None


class EventLine(Line, kw_only=True, tag="event"):
    """Raw, between steps: keys, mouse, connects, blur, focus, with times. Its keys are free."""


class RatingLine(Line, kw_only=True, tag="rating"):
    """An answer of the teacher's to one question."""

    item: Name
    value: float | str | None
    scale: Any = None


class ResumeLine(Line, kw_only=True, tag="resume"):
    """The trial went on after a crash. Its keys are free."""


class TrialEnd(Line, kw_only=True, tag="trial_end"):
    """How the trial ended; `displayed` is the task shown with Final."""

    reason: Literal["final", "timeout", "aborted"]
    displayed: TaskPart | None = None
    correct: bool | None = None
    num_steps: Natural


class LabelLine(Line, kw_only=True, tag="label"):
    """Added by hand: the mental state behind the press in the step line `press_seq`.

    A press may be labelled again: of each annotator the last label counts.
    """

    press_seq: Natural
    mental_state: Name
    annotator: str | None = None
    utc: str | None = None


AnyLine = TrialStart | StepLine | EventLine | RatingLine | ResumeLine | TrialEnd | LabelLine
TYPES: dict[str, type[Line]] = {
    "trial_start": TrialStart,
    "step": StepLine,
    "event": EventLine,
    "rating": RatingLine,
    "resume": ResumeLine,
    "trial_end": TrialEnd,
    "label": LabelLine,
}


def known_keys(line: Line) -> frozenset[str] | None:
    """Every key such a line may have; None where its keys are free."""
    return None if isinstance(line, (EventLine, ResumeLine)) else _KEYS[type(line)]


_KEYS = {kind: frozenset(("type", *kind.__struct_fields__)) for kind in TYPES.values()}


def decode(text: bytes) -> dict[str, Any]:
    """The JSON object of one line; LineError where it is none."""
    try:
        document = msgspec.json.decode(text)
    except UnicodeDecodeError:
        raise LineError("not UTF-8 text") from None
    except msgspec.DecodeError as error:
        try:
            text.decode()
        except UnicodeDecodeError:
            raise LineError("not UTF-8 text") from None
        raise LineError(f"not JSON: {str(error).removeprefix('JSON is malformed: ')}") from None
    except RecursionError:
        raise LineError("not JSON that can be read: nested too deeply") from None
    if not isinstance(document, dict):
        raise LineError("not a line of a trial log: it must be a JSON object")
    return document


def structure(document: dict[str, Any]) -> Line | None:
    """The line that `document` holds, or None for a type of line that this version does not know.

    Raises LineError naming the field and why.

    >>> structure({"type": "step", "trial_id": "a", "seq": 1, "t": 0, "press": 1,
    ...            "action": {"name": "noa"}, "action_source": "planner"})
    Traceback (most recent call last):
    taskcomm.loglines.LineError: step line: press: expected `bool | null`, got `int`
    """
    kind = document.get("type")
    if not isinstance(kind, str):
        raise LineError("not a line of a trial log: `type` is missing or not text")
    wanted = TYPES.get(kind, Line)
    if wanted is TrialStart:
        _check_version(document.get("schema"))
    if wanted is Line:
        document = {name: document[name] for name in ("trial_id", "seq") if name in document}
    try:
        line = msgspec.convert(document, wanted)
    except msgspec.ValidationError as error:
        raise LineError(f"{kind} line: {_plain(str(error))}") from None
    return None if wanted is Line else line


def _check_version(schema: Any) -> None:
    match = _VERSION.fullmatch(schema) if isinstance(schema, str) else None
    if match is None:
        raise LineError(f"schema: expected {SCHEMA!r}, got {schema!r}")
    if int(match[1]) != MAJOR:
        raise LineError(f"schema: this version of taskcomm reads {SCHEMA!r}, not {schema!r}")


def _plain(message: str) -> str:
    what, _, where = message.partition(" - at `")
    field = where.rstrip("`").removeprefix("$").lstrip(".")
    what = re.sub("^Object missing required field (.*)$", r"\1 is missing", what)
    what = what[:1].lower() + what[1:]
    return f"{field}: {what}" if field else what


def encode(line: dict[str, Any]) -> bytes:
    """One line of a log, newline included."""
    return msgspec.json.encode(line) + b"\n"


def json_schema() -> dict[str, Any]:
    """The JSON Schema of one line. A line of a type it does not list is ignored by readers."""
    _, parts = msgspec.json.schema_components(list(TYPES.values()), ref_template="#/$defs/{name}")
    known = {"properties": {"type": {"enum": list(TYPES)}}}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"A line of a trial log, {SCHEMA}",
        "description": "Keys and line types that are not listed are ignored. Whole numbers have no point.",
        "type": "object",
        "properties": {"type": {"type": "string"}, "trial_id": {"type": "string", "minLength": 1}}
        | {"seq": {"type": "integer", "minimum": 0}},
        "required": ["type", "trial_id", "seq"],
        "if": known,
        "then": {"oneOf": [{"$ref": f"#/$defs/{kind.__name__}"} for kind in TYPES.values()]},
        "$defs": parts,
    }


if __name__ == "__main__":
    SCHEMA_FILE.parent.mkdir(exist_ok=True)
    SCHEMA_FILE.write_text(json.dumps(json_schema(), indent=2) + "\n", encoding="utf-8")
