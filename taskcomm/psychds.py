"""Psych-DS: the metadata, file names and README of a data set (psych-ds.github.io).

A data set has `dataset_description.json`, a schema.org Dataset in JSON-LD that describes every column of
every CSV file; `data/` with files KEYWORD-VALUE_..._data.csv; and `data/primary_data`, the raw data.
"""

import json
import re
from collections.abc import Sequence
from typing import Any

from taskcomm.tables import UNCREDITED, Column, Credit, Table

FILE_NAME = re.compile(r"[a-z]+-[a-zA-Z0-9]+(_[a-z]+-[a-zA-Z0-9]+)*_data\.csv")
PRIMARY = "data/primary_data"


def value_of(name: str) -> str:
    """A name as the value of a keyword: letters and digits alone, words told apart by capitals.

    >>> value_of("my-first study"), value_of("***")
    ('myFirstStudy', 'study')
    """
    words = re.findall("[a-zA-Z0-9]+", name)
    return "".join([*words[:1], *(word[:1].upper() + word[1:] for word in words[1:])]) or "study"


def file_of(table: Table, study: str) -> str:
    """Where a table is, from the root of the data set."""
    return f"data/study-{value_of(study)}_description-{value_of(table.name)}_data.csv"


def description(
    name: str,
    about: str,
    tables: Sequence[Table],
    keywords: Sequence[str] = (),
    language: str | None = None,
    credit: Credit = UNCREDITED,
) -> dict[str, Any]:
    """The content of `dataset_description.json`.

    Raises ValueError where two tables give one name of a column different meanings: the standard has one
    description for each name.
    """
    columns: dict[str, Column] = {}
    for table in tables:
        for column in table.all_columns:
            if columns.setdefault(column.name, column) != column:
                raise ValueError(
                    f"column {column.name!r} has two meanings, one of them in table {table.name}"
                )
    document: dict[str, Any] = {
        "@context": "https://schema.org/",
        "@type": "Dataset",
        "name": name,
        "description": about,
        "variableMeasured": [_variable(column) for column in columns.values()],
        "keywords": list(keywords),
    }
    more = {
        "inLanguage": language,
        "author": [{"@type": "Person", "name": author} for author in credit.authors],
        "license": credit.license,
        "citation": credit.citation,
    }
    return document | {key: value for key, value in more.items() if value}


def _variable(column: Column) -> dict[str, str]:
    meaning = column.meaning
    if column.values:
        meaning += f" ({', '.join(column.values)})"
    variable = {"@type": "PropertyValue", "name": column.name, "description": meaning}
    return variable | ({"unitText": column.unit} if column.unit else {})


def ignored(names: Sequence[str]) -> str:
    """The content of `.psychdsignore`: what a validator need not look at."""
    return "".join(f"{name}\n" for name in names)


def readme(title: str, about: Sequence[str], tables: Sequence[Table], study: str, raw: str) -> str:
    """The README: what the set is, its tables with their keys and numbers of rows, and its raw data."""
    rows = [
        f"| `{file_of(table, study)}` | {table.title} | {', '.join(table.key)} | {len(table.rows)} |"
        for table in tables
    ]
    parts = [
        f"# {title}",
        *about,
        "## Tables",
        "Every column is described in `dataset_description.json` (Psych-DS) and, table by table with types"
        " and keys, in `datapackage.json` (Frictionless Data Package). Files are UTF-8, with commas; an"
        " empty cell is a missing value. The columns of the key, together, tell the rows of a table apart.",
        "\n".join(["| file | what it holds | key | rows |", "|---|---|---|---:|", *rows]),
        "## Raw data",
        raw,
    ]
    return "\n\n".join(parts) + "\n"


def as_json(document: Any) -> bytes:
    """Readable JSON."""
    return (json.dumps(document, indent=2, ensure_ascii=False) + "\n").encode()
