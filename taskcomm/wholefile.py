"""Files that are written whole or left as they were."""

import os
from pathlib import Path


class OutputError(OSError):
    """A place that results cannot be written to; the message names it and says why."""


def unwritable(path: Path, error: OSError | None = None) -> OutputError:
    """What to raise where `path` could not be written: the folder that is missing, or what `error` says."""
    reason = "unknown" if error is None else error.strerror or str(error)
    if not path.name or path.is_dir():
        reason = "it is a directory, not a file"
    elif not path.parent.exists():
        reason = f"there is no folder {path.parent}; make it first"
    return OutputError(f"{path}: cannot be written: {reason}")


def part_of(path: Path) -> Path:
    """Where to write what is to become `path`: beside it, with the same ending.

    Raises OutputError where `path` cannot be a file.
    """
    if not path.name or path.is_dir():
        raise unwritable(path)
    return path.with_name(f".part.{os.getpid()}.{path.name}")


def write_whole(path: Path, content: bytes) -> None:
    """Write `content` to `path`; a file that is there is replaced whole, or on any error left as it was.

    Raises OutputError, naming `path`.
    """
    part = part_of(path)
    try:
        part.write_bytes(content)
        part.replace(path)
    except OSError as error:
        raise unwritable(path, error) from None
    finally:
        forget(part)


def forget(part: Path) -> None:
    """Remove `part` if it is there."""
    try:
        part.unlink(missing_ok=True)
    except OSError:  # its folder is no folder; then neither is there a part
        return
