"""The logs of a study's trials, found by the ids of the trials, never by a path from outside."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Protocol

from taskcomm.loglines import decode
from taskcomm.logreader import LogReader
from taskcomm.trials import Trial


class ReplayError(ValueError):
    """What cannot be shown or labelled, and why, in words for whoever asked."""


class Folder(Protocol):
    """Where a study keeps its trials (*.jsonl) and models (*.json)."""

    @property
    def trials_dir(self) -> Path: ...
    @property
    def models_dir(self) -> Path: ...


@dataclass(frozen=True)
class LogFile:
    """A file: its trials that can be read, and what is wrong with it, without its path."""

    path: Path
    trials: tuple[Trial, ...]
    problem: str | None


def trial_log(folder: Folder, trial_id: str, annotator: str | None) -> tuple[Trial, Path]:
    """A trial that `annotator` may see, and its file."""
    for log in logs(folder):
        for trial in log.trials:
            if trial.trial_id == trial_id:
                if annotator is not None and trial.reason is None:
                    raise ReplayError(f"trial {trial_id} is not over")
                return trial, log.path
        if log.problem is not None and log.path.stem == trial_id:
            raise ReplayError(f"the log of trial {trial_id} cannot be read: {log.problem}")
    raise ReplayError(f"there is no trial {trial_id!r}")


def logs(folder: Folder) -> Iterator[LogFile]:
    """Every log of the study's trials; one that has not changed is not read again."""
    if folder.trials_dir.is_dir():
        for path in sorted(folder.trials_dir.glob("*.jsonl")):
            about = path.stat()
            yield _read(path, about.st_mtime_ns, about.st_size)


@lru_cache(maxsize=512)
def _read(path: Path, changed: int, size: int) -> LogFile:
    reader = LogReader(strict=False)
    reader.read(path)
    first = next(iter(reader.problems), None)
    at = "" if first is None or first.line is None else f"line {first.line}: "
    return LogFile(path, tuple(reader.trials()), None if first is None else at + first.reason)


def places(path: Path, trial_id: str) -> tuple[list[int], int | None]:
    """The `seq` of each step of a trial in its file, and the next that is free: None behind a torn line."""
    *whole, rest = path.read_bytes().split(b"\n")
    lines = [line for line in map(decode, whole) if line.get("trial_id") == trial_id]
    return [line["seq"] for line in lines if line["type"] == "step"], None if rest else lines[-1]["seq"] + 1
