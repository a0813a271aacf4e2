"""Tables of a data set as data: columns with their meaning, rows, keys; written as CSV."""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

Kind = Literal["string", "integer", "number", "boolean", "datetime"]
ROW = "row_id"


@dataclass(frozen=True)
class Credit:
    """Who made a data set, its licence (a name such as CC-BY-4.0, or a URL), and how to cite it."""

    authors: tuple[str, ...] = ()
    license: str | None = None
    citation: str | None = None


UNCREDITED = Credit()


@dataclass(frozen=True)
class Column:
    """A column: its name, kind of values, meaning and unit; `values` are all that it can have."""

    name: str
    kind: Kind
    meaning: str
    unit: str | None = None
    values: tuple[str, ...] = ()


@dataclass(frozen=True)
class Table:
    """A table: `key` names the columns that tell its rows apart, `refers` the table that a column points to.

    Rows are mappings by column; what they lack is missing. A first column, `row_id`, counts rows from 1.
    """

    name: str
    title: str
    columns: tuple[Column, ...]
    rows: Sequence[Mapping[str, Any]]
    key: tuple[str, ...]
    refers: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        known = {column.name for column in self.columns}
        if len(known) < len(self.columns) or ROW in known:
            raise ValueError(f"table {self.name}: a column is there twice")
        unknown = {name for row in self.rows for name in row} - known
        if unknown:
            raise ValueError(f"table {self.name}: no column is called {min(unknown)!r}")

    @property
    def all_columns(self) -> tuple[Column, ...]:
        """`row_id`, then the others."""
        return (Column(ROW, "integer", "Number of the row in its table, from 1"), *self.columns)

    def csv(self) -> bytes:
        """The table as CSV (UTF-8, commas, points in numbers, true and false, nothing where missing)."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow([column.name for column in self.all_columns])
        for number, row in enumerate(self.rows, 1):
            writer.writerow([number, *(_cell(row.get(column.name)) for column in self.columns)])
        return text.getvalue().encode()


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    return str(value).replace("\r\n", "\n").replace("\r", "\n").replace("\0", "\ufffd")
