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

from taskcomm.wholefile import OutputError, forget, part_of, unwritable, write_whole

RECORD_SCHEMA = "taskcomm.run/1"


@contextmanager
def result_file(path: Path) -> Iterator[Path]:
    """A part file beside `path`, renamed to it at the end; on any error nothing is left.

    The folder of `path` has to be there. Raises OutputError at once if `path` could not be written.
    """
    part = part_of(path)
    try:
        part.write_bytes(b"")
    except OSError as error:
        raise unwritable(path, error) from None
    try:
        yield part
        part.replace(path)
    except OutputError as error:  # of the part; its reader knows the path alone
        raise OutputError(str(error).replace(part.name, path.name)) from None
    finally:
        forget(part)


@contextmanager
def result_directory(path: Path) -> Iterator[Path]:
    """An empty directory beside `path`, whose files move into `path` at the end; on any error none do.

    `path` and the folders it stands in are made where they are missing. Files of an earlier run with
    the same names are replaced, others are left. Raises OutputError at once if `path` could not be written.
    """
    whole = path.resolve()
    if not whole.name:
        raise OutputError(f"{path}: is no place for results")
    if whole.exists() and not whole.is_dir():
        raise OutputError(f"{path}: is a file, not a directory")
    if whole.is_dir() and not os.access(whole, os.W_OK):
        raise OutputError(f"{path}: cannot be written: it may not be changed")
    part = whole.with_name(f".part.{whole.name}")
    missing = [folder for folder in whole.parents if not folder.exists()]
    try:
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir(parents=True)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from None
    try:
        yield part
        whole.mkdir(exist_ok=True)
        for file in sorted(part.iterdir()):
            file.replace(whole / file.name)
    finally:
        shutil.rmtree(part, ignore_errors=True)
        _remove_empty(missing)


def _remove_empty(folders: Iterable[Path]) -> None:
    """Take away those of the folders, the innermost first, that hold nothing."""
    for folder in folders:
        try:
            folder.rmdir()
        except OSError:
            return


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
    path.write_bytes(_readable(document))


def _readable(document: Any) -> bytes:
    return (json.dumps(document, indent=2, ensure_ascii=False) + "\n").encode()


def write_record(record: Mapping[str, Any], result: Path, written: Path | None = None) -> Path:
    """Write `record` beside the file `result`, with its hash (of `written`, if it has yet to be renamed)."""
    beside = result.with_name(result.name + ".run.json")
    document = {**record, "outputs": {result.name: sha256_of(written or result)}}
    write_whole(beside, _readable(document))
    return beside
