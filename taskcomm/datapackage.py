"""Frictionless: the descriptor `datapackage.json` of a data set of CSV tables (datapackage.org, v2)."""

from collections.abc import Mapping, Sequence
from typing import Any

from taskcomm.tables import UNCREDITED, Column, Credit, Table

PROFILE = "https://datapackage.org/profiles/2.0/datapackage.json"


def datapackage(
    name: str,
    title: str,
    about: str,
    tables: Sequence[Table],
    files: Mapping[str, str],
    credit: Credit = UNCREDITED,
) -> dict[str, Any]:
    """The descriptor: a resource for each table, with types, meanings, keys and references of its columns.

    `files` are the paths of the tables from the root, by name.
    """
    document: dict[str, Any] = {"$schema": PROFILE, "name": name, "title": title, "description": about}
    if credit.authors:
        document["contributors"] = [{"title": author, "roles": ["author"]} for author in credit.authors]
    if credit.license:
        document["licenses"] = [{"path" if "://" in credit.license else "name": credit.license}]
    return document | {"resources": [_resource(table, files[table.name]) for table in tables]}


def _resource(table: Table, path: str) -> dict[str, Any]:
    schema: dict[str, Any] = {
        "fields": [_field(column, table) for column in table.all_columns],
        "missingValues": [""],
        "primaryKey": list(table.key),
    }
    if table.refers:
        schema["foreignKeys"] = [
            {"fields": [column], "reference": {"resource": other, "fields": [column]}}
            for column, other in table.refers.items()
        ]
    return {
        "name": table.name,
        "title": table.title,
        "type": "table",
        "path": path,
        "format": "csv",
        "mediatype": "text/csv",
        "encoding": "utf-8",
        "schema": schema,
    }


def _field(column: Column, table: Table) -> dict[str, Any]:
    meaning = column.meaning if column.unit is None else f"{column.meaning} ({column.unit})"
    field: dict[str, Any] = {"name": column.name, "type": column.kind, "description": meaning}
    constraints: dict[str, Any] = {"required": True} if column.name in table.key else {}
    if column.values:
        constraints["enum"] = list(column.values)
    return field | ({"constraints": constraints} if constraints else {})
