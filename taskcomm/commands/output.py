"""Results that are written whole or not at all, and the record of how they came about."""

import hashlib
import json
import os
import platform
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path
from typing import Any

RECORD_SCHEMA = "taskcomm.run/1"


class OutputError(OSError):
    """A place that results cannot be written to; the message names it."""


def _reason(error: OSError) -> str:
    return error.strerror or str(error)


def _part_of(path: Path) -> Path:
    if not path.name:
        raise OutputError(f"{path}: is no place for results")
    return path.with_name(f".part.{path.name}")


@contextmanager
def result_file(path: Path) -> Iterator[Path]:
    """A part file beside `path`, renamed to it at the end; on any error nothing is left.

    Raises OutputError at once if `path` could not be written.
    """
    try:
        if path.is_dir():
            raise OutputError(f"{path}: is a directory, not a file")
        part = _part_of(path)  # the ending stays, since it says what to write
        part.write_bytes(b"")
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {_reason(error)}") from None
    try:
        yield part
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


@contextmanager
def result_directory(path: Path) -> Iterator[Path]:
    """An empty directory beside `path`, whose files move into `path` at the end; on any error none do.

    Files of an earlier run with the same names are replaced, others are left. Raises OutputError at
    once if `path` could not be written.
    """
    part = _part_of(path.resolve())
    try:
        if path.exists() and not path.is_dir():
            raise OutputError(f"{path}: is a file, not a directory")
        if path.is_dir() and not os.access(path, os.W_OK):
            raise OutputError(f"{path}: cannot be written")
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir(parents=True)
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {_reason(error)}") from None
    try:
        yield part
        path.mkdir(exist_ok=True)
        for file in sorted(part.iterdir()):
            file.replace(path / file.name)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def sha256_of(path: Path) -> str:
    """Hash of a file's bytes."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def versions() -> dict[str, str]:
    """Python's version and those of the packages that results depend on, where installed."""
    found = {"python": platform.python_version()}
    for name in ("taskcomm", "numpy", "scipy", "numba", "pomegranate", "torch"):
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


def run_record(command: str, settings: Mapping[str, Any], inputs: Iterable[Path]) -> dict[str, Any]:
    """What a result rests on: the command, every setting as resolved, versions, hashes of the inputs.

    It holds no clock, so that equal runs leave equal records.
    """
    return {
        "schema": RECORD_SCHEMA,
        "command": command,
        "settings": {
            key: str(value) if isinstance(value, Path) else value for key, value in settings.items()
        },
        "versions": versions(),
        "inputs": {str(path): sha256_of(path) for path in sorted(set(inputs))},
    }


def write_json(document: Any, path: Path) -> None:
    """Write `document` as readable JSON."""
    path.write_text(json.dumps(document, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def write_record(record: Mapping[str, Any], result: Path, written: Path | None = None) -> Path:
    """Write `record` beside the file `result`, with its hash (of `written`, if it has yet to be renamed)."""
    beside = result.with_name(result.name + ".run.json")
    part = beside.with_name(beside.name + ".part")
    try:
        write_json({**record, "outputs": {result.name: sha256_of(written or result)}}, part)
        part.replace(beside)
    finally:
        part.unlink(missing_ok=True)
    return beside
