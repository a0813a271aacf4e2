"""The rules of Psych-DS that are errors, and some that are warnings, as the standard's schema states them.

Written from the schema of the standard: objects, rules of files, of CSV data and of compiled metadata
(psych-ds.github.io); names in capitals are its codes. The official validator, a program for Node or Deno,
could not be had from the registry.
"""

import csv
import io
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

KEYWORDS = {"study", "site", "subject", "session", "task", "condition", "trial", "stimulus", "description"}
FILE_NAME = r"([a-z]+-[a-zA-Z0-9]+)(_[a-z]+-[a-zA-Z0-9]+)*_data\.csv"
REQUIRED = ("name", "description", "variableMeasured")
CONTEXTS = {
    f"{scheme}://{host}schema.org{end}"
    for scheme in ("http", "https")
    for host in ("", "www.")
    for end in ("", "/")
}
OF_DATASET = {
    *REQUIRED,
    "keywords",
    "inLanguage",
    "author",
    "license",
    "citation",
    "url",
    "identifier",
    "funder",
}
OF_VARIABLE = {"name", "description", "unitText", "minValue", "maxValue", "value"}


def problems(root: Path) -> set[str]:
    """The codes of all rules that a data set breaks."""
    return set(_problems(root))


def _problems(root: Path) -> Iterator[str]:
    for file in root.rglob("*"):
        if file.is_file() and not file.stat().st_size:
            yield "FILE_EMPTY"
    if not (root / "data").is_dir():
        yield "MISSING_DATA_DIRECTORY"
    if not any((root / name).is_file() for name in ("README.md", "README.txt")):
        yield "MISSING_README_DOC"
    tables = sorted((root / "data").rglob("*_data.csv"))
    if not tables:
        yield "MISSING_DATAFILE"
    described = root / "dataset_description.json"
    if not described.is_file():
        yield "MISSING_DATASET_DESCRIPTION"
        return
    try:
        metadata = json.loads(described.read_bytes().decode("utf-8"))
    except UnicodeDecodeError:
        yield "JSON_ENCODING_ERROR"
        return
    except ValueError:
        yield "JSON_INVALID"
        return
    yield from _metadata(metadata)
    variables = {_name(one) for one in metadata.get("variableMeasured", [])}
    for table in tables:
        yield from _file_name(table.name)
        yield from _table(table.read_bytes(), variables)


def _metadata(metadata: dict[str, Any]) -> Iterator[str]:
    if metadata.get("@context") not in CONTEXTS:
        yield "INVALID_JSONLD_FORMATTING"
    if "@type" not in metadata:
        yield "MISSING_DATASET_TYPE"
    elif metadata["@type"] != "Dataset":
        yield "INCORRECT_DATASET_TYPE"
    if any(not metadata.get(key) for key in REQUIRED):
        yield "JSON_KEY_REQUIRED"
    if {key for key in metadata if not key.startswith("@")} - OF_DATASET:
        yield "INVALID_SCHEMAORG_PROPERTY"
    for variable in metadata.get("variableMeasured", []):
        if isinstance(variable, dict):
            if variable.get("@type") != "PropertyValue":
                yield "OBJECT_TYPE_MISSING"
            if {key for key in variable if not key.startswith("@")} - OF_VARIABLE:
                yield "INVALID_SCHEMAORG_PROPERTY"


def _name(variable: Any) -> Any:
    return variable.get("name") if isinstance(variable, dict) else variable


def _file_name(name: str) -> Iterator[str]:
    if not re.fullmatch(FILE_NAME, name):
        yield "FILENAME_KEYWORD_FORMATTING_ERROR"
    elif {pair.split("-")[0] for pair in name.removesuffix("_data.csv").split("_")} - KEYWORDS:
        yield "FILENAME_UNOFFICIAL_KEYWORD_WARNING"


def _table(content: bytes, variables: set[Any]) -> Iterator[str]:
    try:
        rows = list(csv.reader(io.StringIO(content.decode("utf-8"), newline=""), strict=True))
    except (csv.Error, UnicodeDecodeError):
        yield "CSV_FORMATTING_ERROR"
        return
    if not rows or not rows[0]:
        yield "CSV_HEADER_MISSING"
        return
    header, *rest = rows
    if len(set(header)) < len(header):
        yield "CSV_HEADER_REPEATED"
    if any(len(row) != len(header) for row in rest):
        yield "CSV_HEADER_LENGTH_MISMATCH"
    if set(header) - variables:
        yield "CSV_COLUMN_MISSING_FROM_METADATA"
    if "row_id" in header:
        ids = [row[header.index("row_id")] for row in rest]
        if len(set(ids)) < len(ids):
            yield "ROWID_VALUES_NOT_UNIQUE"
