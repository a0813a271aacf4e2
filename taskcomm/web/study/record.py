"""What was drawn and fixed when a study was made (`participants.json`), and what has changed since."""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import msgspec
from msgspec import Struct

from taskcomm import __version__
from taskcomm.web.study.assignment import Participant, assign, drawn_people, operator_ids
from taskcomm.web.study.design import Design
from taskcomm.web.study.reading import StudyError, from_json, text_of
from taskcomm.web.study.structure import Id

SCHEMA: Literal["taskcomm.study/1"] = "taskcomm.study/1"
GONE = "which the design does not have any more; make a new study"


class Operator(Struct, frozen=True):
    """An operator; `person` is the number in a pool of everybody, from 1."""

    id: Id
    person: int | None = None


class Record(Struct, frozen=True, kw_only=True):
    """`models` and `texts` are hashes by name; `design` is what the design said."""

    schema: Literal["taskcomm.study/1"] = SCHEMA
    taskcomm_version: str = __version__
    design_sha256: str
    design: dict[str, Any]
    models: dict[str, str]
    texts: dict[str, str]
    operators: tuple[Operator, ...]
    participants: tuple[Participant, ...]


def record_of(design: Design, models: Mapping[str, str], texts: Mapping[str, str]) -> Record:
    """The record of a study that is made now: the assignment is drawn here."""
    people = drawn_people(design) or [None] * len(operator_ids(design))
    return Record(
        design_sha256=design.sha256,
        design=msgspec.to_builtins(design),
        models=dict(models),
        texts=dict(texts),
        operators=tuple(map(Operator, operator_ids(design), people)),
        participants=assign(design),
    )


def write_record(record: Record, path: Path) -> None:
    """Write the file, readable, one participant a line."""
    fields = msgspec.to_builtins(record)
    participants = ",\n".join(f"    {json.dumps(each)}" for each in fields.pop("participants"))
    head = json.dumps(fields, indent=2, ensure_ascii=False).removesuffix("\n}")
    path.write_text(f'{head},\n  "participants": [\n{participants}\n  ]\n}}\n', encoding="utf-8")


def read_record(path: Path, design: Design) -> Record:
    """The record in a file, which must be possible in the world and conditions of `design`."""
    text = text_of(path)
    schema = _schema(text)
    if schema not in (None, SCHEMA):
        raise StudyError(f"{path}: schema: this version of taskcomm reads {SCHEMA!r}, not {schema!r}")
    record = from_json(text, Record, str(path))
    controllers = {condition.name: condition.controller for condition in design.conditions}
    tasks = set(design.ball_world.tasks)
    seen = set[str]()
    for participant in record.participants:
        for name in (participant.id, *(trial.trial_id for trial in participant.trials)):
            if name in seen:
                raise StudyError(f"{path}: {name} is there twice")
            seen.add(name)
        for trial in participant.trials:
            if controllers.get(trial.condition) != trial.controller:
                lost = f"in condition {trial.condition!r} ({trial.controller})"
                raise StudyError(f"{path}: trial {trial.trial_id} was drawn {lost}, {GONE}")
            if trial.task not in tasks:
                raise StudyError(f"{path}: trial {trial.trial_id} was drawn with {trial.task}, {GONE}")
    return record


def _schema(text: str) -> Any:
    try:
        document = json.loads(text)
    except (ValueError, RecursionError):
        return None
    return document.get("schema") if isinstance(document, dict) else None


def changes(
    record: Record, design: Design, models: Mapping[str, str], texts: Mapping[str, str]
) -> tuple[str, ...]:
    """What differs from when the study was made, a sentence each."""
    said = []
    if design.sha256 != record.design_sha256:
        before, now = dict(_flat(record.design)), dict(_flat(msgspec.to_builtins(design)))
        keys = [key for key in dict.fromkeys((*before, *now)) if before.get(key) != now.get(key)]
        said += [f"study.toml: {key} was {before.get(key)!r}, is {now.get(key)!r}" for key in keys]
    for kind, then, after in (("models", record.models, models), ("texts", record.texts, texts)):
        said += [f"{kind}/{name} is not what it was" for name in after if then.get(name) != after[name]]
    return tuple(f"{change}: changed since the study was made" for change in said)


def _flat(value: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping):
        for name, inside in value.items():
            yield from _flat(inside, f"{key}.{name}" if key else name)
    elif isinstance(value, Sequence) and not isinstance(value, str):
        for index, inside in enumerate(value):
            yield from _flat(inside, f"{key}[{index}]")
    else:
        yield key, value


def sha256_of_text(text: str) -> str:
    """Hash of a text, whatever the ends of its lines were."""
    return hashlib.sha256(text.encode()).hexdigest()
