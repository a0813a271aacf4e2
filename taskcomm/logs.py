"""Trial logs: read, write, validate. Schema `taskcomm.trial/1`, JSON Lines, plain or gzipped."""

import gzip
import os
import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from taskcomm.loglines import SCHEMA, encode
from taskcomm.logreader import Finding as Finding
from taskcomm.logreader import LogError as LogError
from taskcomm.logreader import LogReader
from taskcomm.logworld import action_part, task_part, world_part
from taskcomm.trials import Step, Trial
from taskcomm.wholefile import write_whole
from taskcomm.world import World

Paths = str | os.PathLike[str] | Iterable[str | os.PathLike[str]]


class TornLogWarning(UserWarning):
    """The last line of a log is torn, as a crash leaves it; it was dropped and the rest kept."""


@dataclass(frozen=True, slots=True)
class Report:
    """What `validate` found. `ok` says that there is no problem; notices do no harm."""

    files: tuple[str, ...]
    trials: int
    steps: int
    problems: tuple[Finding, ...]
    notices: tuple[Finding, ...]

    @property
    def ok(self) -> bool:
        return not self.problems


def log_files(paths: Paths) -> list[Path]:
    """The log files that `paths` name: files, and every *.jsonl and *.jsonl.gz below folders.

    Raises LogError where there is none.
    """
    given = [paths] if isinstance(paths, (str, os.PathLike)) else list(paths)
    if not given:
        raise LogError("no log was given")
    files: list[Path] = []
    for path in map(Path, given):
        found = [path]
        if path.is_dir():
            found = sorted(file for ending in ("jsonl", "jsonl.gz") for file in path.rglob(f"*.{ending}"))
            if not found:
                raise LogError(f"{path}: no *.jsonl or *.jsonl.gz file in this folder")
        files += found
    return files


def read_trials(paths: Paths, world: World | None = None) -> list[Trial]:
    """Every trial in the logs that `paths` name: a file, a folder, or several of them.

    Worlds other than BallWorld are found by name only: give the `world`. Unknown keys and types
    of line are ignored; a torn last line is dropped with a TornLogWarning. Anything else wrong
    raises LogError with file, line and reason.
    """
    return _read(paths, world).trials()


def read_with_places(paths: Paths, world: World | None = None) -> tuple[list[Trial], dict[str, str]]:
    """`read_trials`, and where in the logs each trial begins: file:line, by trial_id."""
    reader = _read(paths, world)
    return reader.trials(), reader.places


def _read(paths: Paths, world: World | None) -> LogReader:
    reader = LogReader(world)
    for path in log_files(paths):
        reader.read(path)
    for torn in reader.torn:
        warnings.warn(TornLogWarning(str(torn)), stacklevel=3)
    return reader


def validate(paths: Paths, world: World | None = None) -> Report:
    """Every problem in the logs, not the first alone; one for each trial that a problem spoils."""
    reader = LogReader(world, strict=False)
    files = log_files(paths)
    for path in files:
        reader.read(path)
    trials = reader.trials()
    steps = sum(trial.num_steps for trial in trials)
    names = tuple(map(str, files))
    return Report(names, len(trials), steps, tuple(reader.problems), tuple(reader.notices))


def write_trials(trials: Iterable[Trial], path: str | os.PathLike[str]) -> None:
    """Write the trials to one file, gzipped where `path` ends in .gz; the same trials, the same bytes.

    An existing file is replaced whole or left as it was. Raises LogError for no trials, two of one
    id, or a trial that could not be read again, OutputError (an OSError) if the file cannot be written.
    """
    path = Path(path)
    contents: dict[str, bytes] = {}
    readers: dict[int, LogReader] = {}
    for trial in trials:
        name = trial.trial_id
        if name in contents:
            raise LogError(f"{path}: trial {name!r} is there twice")
        reader = readers.setdefault(id(trial.world), LogReader(trial.world, strict=False))
        try:
            contents[name] = _readable(trial, reader)
        except (ValueError, TypeError) as error:
            raise LogError(f"{path}: trial {name!r} cannot be written: {error}") from None
    if not contents:
        raise LogError(f"{path}: no trials to write")
    content = b"".join(contents.values())
    if path.name.endswith(".gz"):
        content = gzip.compress(content, mtime=0)
    write_whole(path, content)


def _readable(trial: Trial, reader: LogReader) -> bytes:
    content = trial_bytes(trial)
    reader.read_bytes(trial.trial_id, content)
    if reader.problems:
        raise LogError(f"line {reader.problems[0].line}: {reader.problems[0].reason}")
    return content


def trial_bytes(trial: Trial) -> bytes:
    """The lines of one trial, as they stand in a log."""
    return b"".join(map(encode, _lines(trial)))


def _lines(trial: Trial) -> Iterator[dict[str, Any]]:
    kinds = (("event", trial.events), ("rating", trial.ratings), ("label", trial.labels))
    extras = [{"type": kind} | dict(line) for kind, lines in kinds for line in lines]
    placed = {line["seq"]: line for line in extras if "seq" in line}
    loose = [line for line in extras if "seq" not in line]
    body = iter(
        [start_line(trial), *map(step_line, range(trial.num_steps), trial.steps), *end_lines(trial), *loose]
    )
    count = len(extras) - len(loose)
    if len(placed) != count or (placed and not 0 < min(placed) <= max(placed) < _length(trial)):
        raise LogError("seq: events, ratings and labels must have places of their own within the trial")
    for seq in range(_length(trial)):
        line = placed.get(seq) or next(body)
        yield {"type": line["type"], "trial_id": trial.trial_id, "seq": seq} | line | {"seq": seq}


def _length(trial: Trial) -> int:
    ended = trial.reason is not None
    return 1 + trial.num_steps + ended + len(trial.events) + len(trial.ratings) + len(trial.labels)


def start_line(trial: Trial) -> dict[str, Any]:
    """The first line of a trial, but for its place."""
    return {
        "type": "trial_start",
        "schema": SCHEMA,
        "taskcomm_version": trial.taskcomm_version,
        "participant_id": trial.participant_id,
        "operator_id": trial.operator_id,
        "session": trial.session,
        "trial_index": trial.trial_index,
        "condition": trial.condition,
        "world": world_part(trial.world),
        "dt": trial.dt,
        "task": None if trial.task is None else task_part(trial.task),
        "robot_model": None if trial.robot_model is None else dict(trial.robot_model),
        "planner": None if trial.planner is None else dict(trial.planner),
        "started_utc": trial.started_utc,
        "source": trial.source,
    }


def step_line(t: int, step: Step) -> dict[str, Any]:
    """The line of step `t`, but for trial and place."""
    line: dict[str, Any] = {"type": "step", "t": t, "action": action_part(step.action)}
    line |= {
        "action_source": step.action_source,
        "press": None if step.pressed is None else bool(step.pressed),
    }
    if step.signals is not None:
        line["signals"] = dict(step.signals)
    if step.timing is not None:
        line["timing"] = dict(step.timing)
    if step.mental_state is not None:
        line["mental_state"] = step.mental_state
    return line


def end_lines(trial: Trial) -> list[dict[str, Any]]:
    """The line of how a trial ended, but for trial and place; none where it broke off."""
    if trial.reason is None:
        return []
    displayed = None if trial.displayed is None else task_part(trial.displayed)
    line = {"type": "trial_end", "reason": trial.reason, "displayed": displayed}
    return [line | {"correct": trial.correct, "num_steps": trial.num_steps}]
