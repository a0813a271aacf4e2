"""The folder of a data set: written whole, and over an earlier export only where nobody has changed that."""

import json
import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from taskcomm.commands.output import sha256_of, write_json
from taskcomm.wholefile import OutputError

RECORD = "run.json"


def put_dataset(out: Path, content: Mapping[str, bytes], record: Mapping[str, Any]) -> None:
    """Write the files of `content` (by path from the root) and the record into `out`, or leave it as it was.

    An earlier export by the same command is replaced; files beside it that are somebody's own stay. Raises
    OutputError for a folder that is not such an export, or one of whose files was changed since.
    """
    whole = out.resolve()
    if whole.exists() and not whole.is_dir():
        raise OutputError(f"{out}: is a file, not a directory")
    own = _own_files(out, whole, str(record["command"]), content)
    part, old = (whole.with_name(f".{word}.{os.getpid()}.{whole.name}") for word in ("part", "old"))
    try:
        part.mkdir(parents=True)
        for name, data in content.items():
            (part / name).parent.mkdir(parents=True, exist_ok=True)
            (part / name).write_bytes(data)
        write_json({**record, "outputs": {name: sha256_of(part / name) for name in content}}, part / RECORD)
        for name in own:
            (part / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(whole / name, part / name)
        if whole.exists():
            whole.rename(old)
        part.rename(whole)
    except OSError as error:
        if old.exists() and not whole.exists():
            old.rename(whole)
        raise OutputError(f"{out}: cannot be written: {error.strerror or error}") from None
    finally:
        shutil.rmtree(part, ignore_errors=True)
        if whole.exists():
            shutil.rmtree(old, ignore_errors=True)


def _own_files(out: Path, whole: Path, command: str, content: Mapping[str, bytes]) -> list[str]:
    """Files in the folder that no export wrote, by path from its root."""
    files = [path for path in whole.rglob("*") if not path.is_dir()]
    there = sorted(path.relative_to(whole).as_posix() for path in files)
    if not there:
        return []
    earlier = _earlier(whole / RECORD, command)
    if earlier is None:
        raise OutputError(f"{out}: is there and no export of a study; name another folder")
    changed = [name for name in there if name in earlier and sha256_of(whole / name) != earlier[name]]
    own = [name for name in there if name not in earlier and name != RECORD]
    in_the_way = changed or [name for name in own if name in content]
    if in_the_way:
        raise OutputError(
            f"{out}: {in_the_way[0]} was changed since it was exported and would be lost; name another folder"
        )
    return own


def _earlier(path: Path, command: str) -> dict[str, str] | None:
    """The hashes of what an export wrote, by path; None where there was none."""
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    if not isinstance(record, dict) or record.get("command") != command:
        return None
    outputs = record.get("outputs")
    return outputs if isinstance(outputs, dict) else None
