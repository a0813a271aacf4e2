"""The people of a study as tables: participants, and what they answered outside of trials."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from taskcomm.tables import Column, Kind, Table
from taskcomm.trialtables import OPERATOR, PARTICIPANT, SOURCE, answer

PREFIX = "answer_"


@dataclass(frozen=True)
class Person:
    """A participant: `done` are the lines of the pages done, {page, kind, name, values, utc} each."""

    participant_id: str
    operator_id: str | None
    planned: int
    source: str
    done: tuple[Mapping[str, Any], ...] = ()

    @property
    def consent(self) -> bool | None:
        """Whether consent was given and never refused; None where there is no answer or nobody was asked."""
        agreed = [line["values"].get("agreed") for line in self.done if line["kind"] == "consent"]
        return all(agreed) if agreed else None

    @property
    def answers(self) -> list[dict[str, Any]]:
        """Every answer on a form that belongs to no trial, the last one to each item of a form."""
        found = {
            (line["name"], item): {
                "form": line["name"],
                "item": item,
                "utc": line.get("utc"),
                **answer(value),
            }
            for line in self.done
            if line["kind"] == "form" and not str(line["name"]).startswith("rating-")
            for item, value in line["values"].items()
        }
        return [{"participant_id": self.participant_id, **row} for row in found.values()]


def people_tables(
    people: Sequence[Person], trials_done: Mapping[str, int], items: Mapping[str, str]
) -> list[Table]:
    """The tables `participants` and `answers`. `items` are the questions by item, in words, for descriptions.

    Whoever declined is there with the assignment alone.
    """
    kept = [person for person in people if person.consent is not False]
    return [_participants(people, trials_done, items, kept), _answers(kept)]


def _participants(
    people: Sequence[Person], trials_done: Mapping[str, int], items: Mapping[str, str], kept: Sequence[Person]
) -> Table:
    given = {row["item"]: row for person in kept for row in person.answers}
    asked = {
        item: _kind([row for person in kept for row in person.answers if row["item"] == item])
        for item in given
    }
    columns = (
        PARTICIPANT,
        OPERATOR,
        Column(
            "consent", "boolean", "Whether the participant consented; missing where not asked, or not yet"
        ),
        Column("consent_version", "string", "Version of the text of the consent"),
        Column("trials_planned", "integer", "Trials that the participant was to have, practice not counted"),
        Column("trials_done", "integer", "Trials that ran to an end, practice not counted"),
        SOURCE,
        *(
            Column(f"{PREFIX}{item}", kind, f"Answer to: {items.get(item, item)}")
            for item, kind in asked.items()
        ),
    )
    rows = [_participant(person, trials_done.get(person.participant_id, 0)) for person in people]
    return Table(
        "participants", "One row for each participant of the study", columns, rows, ("participant_id",)
    )


def _participant(person: Person, done: int) -> dict[str, Any]:
    versions = [line["values"].get("version") for line in person.done if line["kind"] == "consent"]
    row: dict[str, Any] = {
        "participant_id": person.participant_id,
        "operator_id": person.operator_id,
        "consent": person.consent,
        "consent_version": versions[-1] if versions else None,
        "trials_planned": person.planned,
        "source": person.source,
    }
    if person.consent is False:
        return row
    return row | {"trials_done": done} | {f"{PREFIX}{one['item']}": one["value"] for one in person.answers}


def _kind(rows: Sequence[Mapping[str, Any]]) -> Kind:
    """What the answers to an item are."""
    values = [row["value"] for row in rows if row["value"] is not None]
    if values and all(isinstance(value, bool) for value in values):
        return "boolean"
    if not values or any(isinstance(value, str | bool) for value in values):
        return "string"
    return "integer" if all(isinstance(value, int) for value in values) else "number"


def _answers(people: Sequence[Person]) -> Table:
    columns = (
        PARTICIPANT,
        Column("form", "string", "Page on which the question was"),
        Column("item", "string", "Question that was answered"),
        Column("value", "string", "Answer as given"),
        Column("number", "number", "Answer, where it is a number"),
        Column("utc", "datetime", "When the page was done, in UTC"),
    )
    rows = [row for person in people for row in person.answers]
    title = "One row for each question answered before the trials"
    return Table(
        "answers",
        title,
        columns,
        rows,
        ("participant_id", "form", "item"),
        {"participant_id": "participants"},
    )
