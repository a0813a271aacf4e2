"""From lines to trials: every check of a trial log, with file, line and reason."""

import gzip
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from taskcomm.loglines import Line, LineError, TrialStart, decode, known_keys, structure
from taskcomm.logtrial import OpenTrial
from taskcomm.logworld import WorldIndex, world_of
from taskcomm.trials import Trial
from taskcomm.world import World


class LogError(ValueError):
    """A log that cannot be read or written: file, line and reason."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing found in a log; `line` is None where it concerns the whole file."""

    path: str
    line: int | None
    reason: str

    def __str__(self) -> str:
        place = self.path if self.line is None else f"{self.path}:{self.line}"
        return f"{place}: {self.reason}"


class LogReader:
    """Reads files into trials. `strict` raises LogError at the first problem; else all are kept.

    `problems` make a log unfit; `notices` do not: unknown keys and types of line, which are
    ignored, a torn last line, which is dropped, a trial that broke off.
    """

    def __init__(self, world: World | None = None, strict: bool = True) -> None:
        self.problems: list[Finding] = []
        self.notices: list[Finding] = []
        self.torn: list[Finding] = []
        self._given, self._strict = world, strict
        self._path = ""
        self._line: int | None = None
        self._worlds: dict[str, WorldIndex] = {}
        self._trials: dict[str, OpenTrial | None] = {}
        self._noticed: set[tuple[str, str]] = set()

    def trials(self) -> list[Trial]:
        """Every trial without a problem, in the order in which they began."""
        return [part.trial() for part in self._trials.values() if part is not None and not part.broken]

    @property
    def places(self) -> dict[str, str]:
        """Where each trial began, as file:line, by trial_id."""
        return {name: part.place for name, part in self._trials.items() if part is not None}

    def read(self, path: Path) -> None:
        """Read one file, .jsonl or .jsonl.gz."""
        self._path, self._line = str(path), None
        try:
            content = _bytes_of(path)
        except LineError as error:
            self._problem(str(error))
            return
        self.read_bytes(str(path), content)

    def read_bytes(self, name: str, content: bytes) -> None:
        """Read the unpacked content of a log, called `name` in what is found."""
        self._path, self._line = name, None
        self._opened: list[OpenTrial] = []
        lines = content.removeprefix(b"\xef\xbb\xbf").split(b"\n")
        if not any(line.strip() for line in lines):
            self._problem("empty: a log holds at least one line")
            return
        for number, text in enumerate(lines, 1):
            self._line = number
            try:
                self._read_line(text)
            except LineError as error:
                if number == len(lines) and _is_torn(text):
                    self.torn.append(Finding(self._path, number, "torn last line, dropped"))
                    self.notices.append(self.torn[-1])
                else:
                    self._problem(str(error))
        self._line = None
        if not self._opened and not self.problems:
            self._problem("no trial in it")
        for part in self._opened:
            if part.end is None and not part.broken:
                self._notice(f"trial {part.start.trial_id!r} broke off after {len(part.steps)} steps")

    def _problem(self, reason: str) -> None:
        finding = Finding(self._path, self._line, reason)
        if self._strict:
            raise LogError(str(finding))
        self.problems.append(finding)

    def _notice(self, reason: str) -> None:
        if (self._path, reason) not in self._noticed:
            self._noticed.add((self._path, reason))
            self.notices.append(Finding(self._path, self._line, reason))

    def _read_line(self, text: bytes) -> None:
        if not text.strip():
            return
        document = decode(text)
        try:
            line = structure(document)
        except LineError:
            self._give_up(document.get("trial_id"))
            raise
        if isinstance(line, TrialStart):
            self._begin(line)
        name = document["trial_id"]
        if name not in self._trials:
            self._trials[name] = None
            raise LineError(f"trial {name!r} has no trial_start line before this {document['type']} line")
        part = self._trials[name]
        if part is None or part.broken:
            return
        try:
            part.add(document["seq"], line, document)
        except LineError:
            part.broken = True
            raise
        finally:
            self._notice_unknown(line, document)

    def _notice_unknown(self, line: Line | None, document: dict[str, Any]) -> None:
        if line is None:
            self._notice(f"lines of type {document['type']!r} are unknown and ignored")
            return
        for key in sorted(set(document) - (known_keys(line) or set(document))):
            self._notice(f"key {key!r} of {document['type']} lines is unknown and ignored")

    def _begin(self, line: TrialStart) -> None:
        if line.trial_id in self._trials:
            before = self._trials[line.trial_id]
            self._give_up(line.trial_id)
            place = f", first in {before.place}" if before is not None else ""
            raise LineError(f"trial {line.trial_id!r} is there twice{place}")
        self._trials[line.trial_id] = None
        key = repr(sorted(line.world.items()))
        if key not in self._worlds:
            self._worlds[key] = WorldIndex(world_of(line.world, self._given))
        part = OpenTrial(line, self._worlds[key], f"{self._path}:{self._line}")
        self._trials[line.trial_id] = part
        self._opened.append(part)

    def _give_up(self, name: Any) -> None:
        part = self._trials.get(name) if isinstance(name, str) else None
        if part is not None:
            part.broken = True
        elif isinstance(name, str):
            self._trials[name] = None


def _bytes_of(path: Path) -> bytes:
    try:
        content = path.read_bytes()
        packed = content.startswith(b"\x1f\x8b")
        if path.name.endswith(".gz") and not packed:
            raise LineError("not a gzip file")
        return gzip.decompress(content) if packed else content
    except FileNotFoundError:
        raise LineError("no such file") from None
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise LineError(f"its gzip data cannot be unpacked: {error}") from None
    except OSError as error:
        raise LineError(f"cannot be read: {error.strerror or error}") from None


def _is_torn(text: bytes) -> bool:
    try:
        msgspec.json.decode(text)
    except ValueError:
        return True
    return False
