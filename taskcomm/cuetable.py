"""Cue tables: anybody's cues and presses, a row for each time step, as trials in a `CueWorld`.

Columns `trial_id`, `t`, `press`; optional `participant_id`, `source` and `dt`; every other column is a
cue. `t` counts the steps of a trial, 0, 1, 2, ...; `press` and the cues are 0 or 1 (or true and
false); `press` is empty, NA or NaN in a step whose key was not recorded. `dt`, the length of a step in
seconds, is the same in every row, or is given by the caller. A trial ends with its last row, and nothing is
assumed of what came after.
"""

import math
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from taskcomm.cuerows import NEEDED, OWN, columns_and_rows, count_of, flag_of, seconds_of, text_of
from taskcomm.cueworld import CueWorld
from taskcomm.loglines import LineError
from taskcomm.logreader import Finding, LogError
from taskcomm.logs import Report
from taskcomm.trials import Step, Trial

Paths = str | os.PathLike[str] | Iterable[str | os.PathLike[str]]


def read_cue_tables(paths: Paths, dt: float | None = None) -> list[Trial]:
    """Every trial of the cue tables (.csv or .parquet), in the order in which they begin.

    All are trials of one CueWorld, whose cues are in the order of the first table. `dt` is in seconds, and
    may be left out where the tables have a column of it. `source` is `cue table` where no column says
    otherwise. Raises LogError with file, line and column for anything amiss.
    """
    return _read(paths, dt, strict=True).trials()


def read_with_places(paths: Paths, dt: float | None = None) -> tuple[list[Trial], dict[str, str]]:
    """`read_cue_tables`, and where each trial begins: file:line, by trial_id."""
    reader = _read(paths, dt, strict=True)
    return reader.trials(), {name: trial.place for name, trial in reader.open.items()}


def validate_cue_tables(paths: Paths, dt: float | None = None) -> Report:
    """Every problem of the tables: one for each trial, or for each file that cannot be read at all."""
    reader = _read(paths, dt, strict=False)
    trials = reader.trials()
    steps = sum(trial.num_steps for trial in trials)
    return Report(tuple(reader.files), len(trials), steps, tuple(reader.problems), ())


def _read(paths: Paths, dt: float | None, strict: bool) -> "_Reader":
    given = [paths] if isinstance(paths, (str, os.PathLike)) else list(paths)
    if not given:
        raise LogError("no cue table was given")
    if dt is not None and not (math.isfinite(dt) and dt > 0):
        raise LogError(f"dt: must be a positive number of seconds, not {dt!r}")
    reader = _Reader(dt, strict)
    for path in given:
        reader.read(Path(path))
    return reader


@dataclass
class _Open:
    """A trial whose rows are being read."""

    trial_id: str
    participant_id: str | None
    source: str
    place: str
    steps: list[Step] = field(default_factory=list)
    broken: bool = False


class _Reader:
    """Reads tables into trials; `strict` raises LogError at the first problem, else all are kept."""

    def __init__(self, dt: float | None, strict: bool) -> None:
        self.dt, self._given, self._strict = dt, dt, strict
        self.open: dict[str, _Open] = {}
        self.problems: list[Finding] = []
        self.files: list[str] = []
        self.world: CueWorld | None = None
        self._made: dict[tuple[frozenset[str], bool | None], Step] = {}
        self._path, self._line = "", 0

    def trials(self) -> list[Trial]:
        """Every trial without a problem."""
        trials, met = [], dict[str | None, int]()
        for part in self.open.values():
            if part.broken or self.world is None or self.dt is None:
                continue
            index = met[part.participant_id] = met.get(part.participant_id, -1) + 1
            trials.append(
                Trial(
                    trial_id=part.trial_id,
                    world=self.world,
                    task=self.world.tasks[0],
                    steps=tuple(part.steps),
                    dt=self.dt,
                    participant_id=part.participant_id,
                    trial_index=0 if part.participant_id is None else index,
                    source=part.source,
                )
            )
        return trials

    def read(self, path: Path) -> None:
        """Read one file."""
        self._path = str(path)
        self.files.append(self._path)
        before = set(self.open)
        try:
            names, rows = columns_and_rows(path)
            cues = self._cues(names)
            place = {name: index for index, name in enumerate(names)}
            line = None
            for line, row in rows:
                self._line = line
                self._row({name: row[at] for name, at in place.items()}, cues, before)
            if line is None:
                raise LineError("no rows: a cue table holds a row for each step")
        except LineError as error:
            self._problem(None, str(error))

    def _cues(self, names: Sequence[str]) -> tuple[str, ...]:
        """The cues among the columns; the World, where this is the first table."""
        if not any(names):
            raise LineError("empty: a cue table begins with the names of its columns")
        for name in names:
            if not name:
                raise LineError(f"column {names.index('') + 1} has no name")
            if names.count(name) > 1:
                raise LineError(f"column {name!r} is there twice")
        lacking = [name for name in NEEDED if name not in names]
        if lacking:
            raise LineError(f"column {lacking[0]!r} is missing; there are {', '.join(names)}")
        cues = tuple(name for name in names if name not in OWN)
        if not cues:
            raise LineError(f"no cue: every column but {', '.join(OWN)} is one")
        if self.world is None:
            try:
                self.world = CueWorld(cues)
            except ValueError as error:
                raise LineError(str(error)) from None
        elif set(cues) != set(self.world.cue_names):
            raise LineError(
                f"its cues are {', '.join(cues)}, those of {self.files[0]} {', '.join(self.world.cue_names)}"
            )
        if "dt" not in names and self._given is None:
            raise LineError(
                "the length of a step is not known: give it in seconds, as a column 'dt' or with --dt"
            )
        return cues

    def _problem(self, line: int | None, reason: str) -> None:
        finding = Finding(self._path, line, reason)
        if self._strict:
            raise LogError(str(finding))
        self.problems.append(finding)

    def _row(self, row: dict[str, Any], cues: Sequence[str], before: set[str]) -> None:
        part: _Open | None = None
        try:
            part = self._trial_of(row, before)
            if not part.broken:
                self._add(part, row, cues)
        except LineError as error:
            if part is not None:
                part.broken = True
            self._problem(self._line, str(error))

    def _trial_of(self, row: dict[str, Any], before: set[str]) -> _Open:
        name = text_of("trial_id", row)
        part = self.open.get(name)
        if part is not None and name in before:
            said, part.broken = part.broken, True
            if not said:
                raise LineError(f"trial {name!r} is there twice, first in {part.place}")
        if part is None:
            person = text_of("participant_id", row) if "participant_id" in row else None
            source = text_of("source", row) if "source" in row else "cue table"
            part = self.open[name] = _Open(name, person, source, f"{self._path}:{self._line}")
        return part

    def _add(self, part: _Open, row: dict[str, Any], cues: Sequence[str]) -> None:
        """One more step of a trial."""
        for column, first in (("participant_id", part.participant_id), ("source", part.source)):
            if column in row and (value := text_of(column, row)) != first:
                raise LineError(
                    f"column {column!r}: trial {part.trial_id!r} has {value!r} here, but began with {first!r}"
                    " (every trial needs a trial_id of its own)"
                )
        t, due = count_of("t", row), len(part.steps)
        if t != due:
            raise LineError(
                f"column 't': trial {part.trial_id!r} has {t} here, where {due} is due; every step has a row"
            )
        if "dt" in row:
            self._check_dt(seconds_of("dt", row))
        pressed = flag_of("press", row, may_miss=True)
        key = frozenset(name for name in cues if flag_of(name, row)), pressed
        if key not in self._made:
            assert self.world is not None
            self._made[key] = Step(self.world.show(key[0]), pressed, action_source="operator")
        part.steps.append(self._made[key])

    def _check_dt(self, dt: float) -> None:
        if self.dt is None:
            self.dt = dt
        if abs(dt - self.dt) > 1e-9 * self.dt:
            earlier = "was given" if self._given is not None else "came before"
            raise LineError(f"column 'dt': {dt:g} s, where {self.dt:g} s {earlier}; a table has one dt")
