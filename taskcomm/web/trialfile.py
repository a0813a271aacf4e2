"""The log of a trial of a study on disk: begun, or found as a crash left it."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec

from taskcomm import __version__
from taskcomm.logreader import LogReader
from taskcomm.logwriter import TrialWriter
from taskcomm.trials import Trial
from taskcomm.web.journal import torn_end
from taskcomm.web.services import Services
from taskcomm.web.study.assignment import TrialPlan
from taskcomm.web.study.reading import StudyError
from taskcomm.web.trialrun import utc


def writer_of(services: Services, plan: TrialPlan) -> TrialWriter:
    """Of a new trial, or of one that is on disk, without what a crash tore.

    Raises LogError for a log that cannot be read, and StudyError for a trial that the study would now go
    on with in another way than it began.
    """
    path = services.folder.log_of(plan)
    if path.exists():
        torn = torn_end(path)
        if torn:
            services.note("torn", file=path.name, bytes=len(torn))
        content = path.read_bytes()
        if content:
            reader = LogReader(services.world)
            reader.read_bytes(path.name, content)
            [found] = reader.trials()
            if found.reason is None:
                _check_unchanged(path, found, _head(services, plan))
            return TrialWriter(replace(found, reason=None, displayed=None), content.count(b"\n"))
    return TrialWriter(_head(services, plan))


def _check_unchanged(path: Path, began: Trial, now: Trial) -> None:
    """What the first line says holds for all that follow."""
    for name in ("participant_id", "operator_id", "condition", "task", "dt", "robot_model", "planner"):
        then, today = getattr(began, name), getattr(now, name)
        if then != today:
            raise StudyError(
                f"{path}: was broken off with {name} {then!r}, which is {today!r} now; put the study back as"
                " it was to go on with this trial"
            )


def _head(services: Services, plan: TrialPlan) -> Trial:
    """What the first line of a trial says."""
    described = services.descriptions.get(plan.condition, {})
    return Trial(
        trial_id=plan.trial_id,
        world=services.world,
        task=plan.task,
        steps=(),
        dt=services.timing.step,
        participant_id=plan.participant_id,
        operator_id=plan.operator_id,
        session=services.design.name,
        trial_index=plan.index,
        condition=plan.condition,
        source=services.design.source,
        robot_model=described.get("robot_model"),
        planner=described.get("planner"),
        started_utc=None if services.timing.lockstep else utc(),
        taskcomm_version=__version__,
    )


def is_over(path: Path) -> bool:
    """Whether the log of a trial has its end, on a whole line."""
    if not path.exists():
        return False
    whole = path.read_bytes().rpartition(b"\n")[0]
    return any(line.startswith(b'{"type":"trial_end"') for line in whole.split(b"\n"))


def lines_of(path: Path, kind: str) -> list[dict[str, Any]]:
    """The lines of one type in the log of a trial, if there is one."""
    if not path.exists():
        return []
    lines = [msgspec.json.decode(text) for text in path.read_bytes().splitlines()]
    return [line for line in lines if line["type"] == kind]
