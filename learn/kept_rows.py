"""The rows of a long run, each kept in a file as soon as it is done, so that the run can be stopped."""

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class KeptRows:
    """A JSON Lines file: first what the run is about, then a line for every row, in the order they came.

    Several processes may append at once. A last line that was torn when a run was stopped is no row, and is
    cut off by the next `begin`.
    """

    path: Path

    def begin(self, about: Mapping[str, Any]) -> None:
        """Make the file ready for rows of the run `about` (plain values), a new one or one to go on with.

        Raises ValueError where it holds those of another run, naming what differs.
        """
        whole = self.path.read_bytes() if self.path.exists() else b""
        whole = whole[: whole.rfind(b"\n") + 1]
        if not whole:
            self.path.write_bytes(_line(about))
            return
        there = json.loads(whole.split(b"\n", 1)[0])
        wanted = json.loads(_line(about))
        for key in [*wanted, *(key for key in there if key not in wanted)]:
            if there.get(key) != wanted.get(key):
                raise ValueError(
                    f"{self.path}: kept of another run, {key} {there.get(key)!r}, not {wanted.get(key)!r};"
                    " name another folder"
                )
        os.truncate(self.path, len(whole))

    def append(self, row: Mapping[str, Any]) -> None:
        """Keep one more row, of plain values."""
        with self.path.open("ab", buffering=0) as file:  # one write: rows of several processes do not mix
            file.write(_line(row))

    def rows(self) -> list[dict[str, Any]]:
        """Every row kept so far."""
        *whole, _torn = self.path.read_text(encoding="utf-8").split("\n")
        return [json.loads(line) for line in whole[1:]]


def _line(row: Mapping[str, Any]) -> bytes:
    return (json.dumps(row) + "\n").encode()
