"""The rows of a cue table as they stand in a CSV or Parquet file, and what a cell can hold."""

import csv
import io
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from taskcomm.loglines import LineError

ENDINGS = (".csv", ".parquet")
NEEDED = ("trial_id", "t", "press")
OWN = (*NEEDED, "participant_id", "source", "dt")
MISSING = frozenset(("", "na", "nan"))
FLAGS = {"0": False, "1": True, "0.0": False, "1.0": True, "false": False, "true": True}


def is_cue_table(path: Path) -> bool:
    """Whether a file is taken for a cue table, by the end of its name."""
    return path.suffix.lower() in ENDINGS


def columns_and_rows(path: Path) -> tuple[list[str], Iterator[tuple[int, Sequence[Any]]]]:
    """The names of the columns, and the rows, each with its line (CSV) or its number from 1 (Parquet).

    Cells of a CSV file are text. Raises LineError, which names no file, for what cannot be read; so do the
    rows, where one of them is at fault.
    """
    if path.suffix.lower() == ".parquet":
        return _parquet(path)
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError:
        raise LineError("not UTF-8 text") from None
    except FileNotFoundError:
        raise LineError("no such file") from None
    except OSError as error:
        raise LineError(f"cannot be read: {error.strerror or error}") from None
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        names = [name.strip() for name in next(reader, [])]
    except csv.Error as error:
        raise LineError(f"its first line is not CSV: {error}") from None
    if len(names) == 1 and any(mark in names[0] for mark in ";\t"):
        raise LineError("its columns must be separated by commas")
    return names, _csv_rows(reader, len(names))


def _csv_rows(reader: Any, width: int) -> Iterator[tuple[int, Sequence[str]]]:
    while True:
        try:
            row = next(reader, None)
        except csv.Error as error:
            raise LineError(f"line {reader.line_num} is not CSV: {error}") from None
        if row is None:
            return
        if not row:  # an empty line
            continue
        if len(row) != width:
            raise LineError(f"line {reader.line_num} has {len(row)} cells, the first line has {width}")
        yield reader.line_num, row


def _parquet(path: Path) -> tuple[list[str], Iterator[tuple[int, Sequence[Any]]]]:
    try:
        from pyarrow import ArrowException, parquet
    except ImportError:
        raise LineError("Parquet files need pyarrow: pip install 'taskcomm[parquet]'") from None
    try:
        file = parquet.ParquetFile(path)
    except FileNotFoundError:
        raise LineError("no such file") from None
    except (ArrowException, OSError) as error:
        raise LineError(f"not a Parquet file that can be read: {error}") from None
    names = list(file.schema_arrow.names)

    def rows() -> Iterator[tuple[int, Sequence[Any]]]:
        number = 0
        try:
            for batch in file.iter_batches():
                for row in zip(*(column.to_pylist() for column in batch.columns), strict=True):
                    number += 1
                    yield number, row
        except (ArrowException, OSError) as error:
            raise LineError(f"cannot be read after row {number}: {error}") from None
        finally:
            file.close()

    return names, rows()


def _cell(value: Any) -> str:
    """A cell as text, "" where it is empty."""
    return "" if value is None else str(value).strip()


def text_of(column: str, row: dict[str, Any]) -> str:
    """A text that is not empty. These raise LineError, naming the column, for anything else."""
    text = _cell(row[column])
    if not text:
        raise LineError(f"column {column!r}: empty")
    return text


def count_of(column: str, row: dict[str, Any]) -> int:
    """A whole number from 0."""
    text = _cell(row[column])
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not (0 <= number < 1 << 53 and number == math.floor(number)):
        raise LineError(
            f"column {column!r}: must count the steps of a trial, 0, 1, 2, ..., not be {text!r}"
            " (how long a step is, dt says)"
        )
    return int(number)


def seconds_of(column: str, row: dict[str, Any]) -> float:
    """A length of time above 0, in seconds."""
    text = _cell(row[column])
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not (math.isfinite(number) and number > 0):
        raise LineError(f"column {column!r}: must be a positive number of seconds, not {text!r}")
    return number


def flag_of(column: str, row: dict[str, Any], may_miss: bool = False) -> bool | None:
    """0 or 1; None for nothing, where that may be."""
    text = _cell(row[column]).lower()
    flag = FLAGS.get(text)
    if flag is None and not (may_miss and text in MISSING):
        hint = "; every column but " + ", ".join(OWN) + " is a cue" if column != "press" else ""
        raise LineError(f"column {column!r}: must be 0 or 1, not {text!r}{hint}")
    return flag
