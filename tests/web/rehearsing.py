"""Small studies for programs, and what is on disk after one."""

import asyncio
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import msgspec

from taskcomm.teacher import TeacherModel
from taskcomm.web.rehearsal import Heard, Rehearsal, rehearsed
from taskcomm.web.serverprocess import ServerProcess
from taskcomm.web.study.folder import StudyFolder
from taskcomm.web.study.structure import Condition, Design, Operators, Timing

OPERATOR = Condition(name="operator", controller="operator")
EAGER = TeacherModel.from_dict(
    TeacherModel.intuitive().to_dict()
    | {
        "mistake": 0.002,
        "approvals": {
            state: {"cue": top.cue, "peak": 0.28, "rise": 0.5, "fall": 0.5}
            for state, top in TeacherModel.intuitive().approvals.items()
        },
        "provenance": {"made_by": "a test"},
    }
)


def robot(horizon: int = 3) -> Condition:
    """The planner's condition, looking ahead so far."""
    return Condition(name="pomdp", controller="planner", horizon=horizon)


def study(path: Path, teachers: int, *, operators: int = 1, **changes: Any) -> StudyFolder:
    """A study: each teacher has a trial of the planner and, where there are operators, one of theirs."""
    conditions = (robot(), OPERATOR) if operators else (robot(),)
    asked: dict[str, Any] = {
        "conditions": conditions,
        "operators": Operators(draw=operators) if operators else None,
        "timing": Timing(limit=150.0),
        "instructions": False,
    }
    design = Design(name="rehearsal", teachers=teachers, **(asked | changes))
    return StudyFolder.new(path, rehearsed(design))


def everybody(
    folder: StudyFolder, address: str, model: TeacherModel = EAGER, *, seed: int = 0, **options: Any
) -> Rehearsal:
    """A rehearsal in which all teachers have one model."""
    models = {person.id: model for person in folder.participants}
    return Rehearsal(folder, address, models, seed, **options)


def run_through(
    folder: StudyFolder,
    *,
    lockstep: bool = True,
    processes: int = 1,
    seed: int = 0,
    heard: Mapping[str, Heard] | None = None,
    after: Callable[[Rehearsal], Any] | None = None,
) -> Rehearsal:
    """Rehearse the whole study at a server of its own; `after` is done before the server ends."""
    log = folder.path / "server.err"
    server = ServerProcess(folder.path, log, lockstep=lockstep, processes=processes)
    server.start()
    try:
        rehearsal = everybody(folder, server.address, seed=seed, heard=heard or {})
        asyncio.run(rehearsal.run())
        if after is not None:
            after(rehearsal)
        server.stop()
    finally:
        server.kill()
    assert log.read_text() == ""
    return rehearsal


def lines(path: Path) -> list[dict[str, Any]]:
    """The lines of a log."""
    return [msgspec.json.decode(line) for line in path.read_bytes().splitlines()]


def logs(folder: StudyFolder) -> dict[str, list[dict[str, Any]]]:
    """The lines of every trial, practice included, by trial id."""
    files = sorted([*folder.trials_dir.glob("*.jsonl"), *folder.practice_dir.glob("*.jsonl")])
    return {file.stem: lines(file) for file in files}
