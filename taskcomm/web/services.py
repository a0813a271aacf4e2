"""What every part of a running study uses: its folder, clock rules, robots, journal and planner."""

import asyncio
import fcntl
import logging
import os
import time
from pathlib import Path
from typing import Any

import msgspec

from taskcomm.web.journal import Journal, torn_end
from taskcomm.web.study.folder import StudyFolder
from taskcomm.web.study.reading import StudyError
from taskcomm.web.thinking import Minds, RobotPlan
from taskcomm.web.trialrun import Timing, utc

log = logging.getLogger("taskcomm")


class Services:
    """The study's folder, and what runs beside the event loop: the journal's thread, the planner's processes.

    `lockstep` is for rehearsals (see TrialRun); `processes` is how many plan. Raises StudyError for lockstep
    in a study of people, and for a folder that another server has open.
    """

    def __init__(self, folder: StudyFolder, processes: int = 1, lockstep: bool = False) -> None:
        self.folder, self.design = folder, folder.design
        if lockstep and not self.design.simulated:
            raise StudyError(f"{folder.path}: lockstep is for simulated studies: no clock would run")
        self._held = _held(folder.path)
        self.world = self.design.ball_world
        asked = self.design.timing
        self.timing = Timing(
            step=asked.step,
            limit=self.design.max_steps,
            countdown=round(asked.countdown),
            grace=asked.grace,
            away=asked.away,
            lockstep=lockstep,
        )
        self.robots = {
            condition.name: RobotPlan(
                self.world, folder.model(condition.model), condition.horizon, condition.threshold
            )
            for condition in self.design.conditions
            if condition.controller == "planner"
        }
        # Made once: a trial of the planner begins as quickly as one of an operator, and so does not tell.
        self.descriptions = {name: plan.robot().description for name, plan in self.robots.items()}
        if folder.server_log.exists():
            torn_end(folder.server_log)
        self.journal = Journal()
        self._mend_trials()
        self.minds = Minds(list(dict.fromkeys(self.robots.values())), processes)

    def _mend_trials(self) -> None:
        """A crash may have torn any log: of a trial that is over, while it was labelled."""
        for path in sorted(self.folder.trials_dir.glob("*.jsonl")):
            torn = torn_end(path)
            if torn:
                self.note("torn", file=path.name, bytes=len(torn))

    def note(self, kind: str, **fields: Any) -> None:
        """A line in the server's own log."""
        content = msgspec.json.encode({"utc": utc(), "kind": kind, **fields}) + b"\n"
        try:
            self.journal.append(self.folder.server_log, content).add_done_callback(_say_failure)
        except RuntimeError:  # no loop yet: what is found while starting
            with self.folder.server_log.open("ab") as file:
                file.write(content)

    def start(self) -> None:
        """Load the planner's kernels."""
        began = time.monotonic()
        self.minds.warm_up()
        log.info("planner ready after %.1f s", time.monotonic() - began)

    def close(self) -> None:
        """Write what waits; end the planner's processes."""
        self.journal.close()
        self.minds.close()
        os.close(self._held)


def _held(folder: Path) -> int:
    """An open folder that no other server may open meanwhile; a crash sets it free."""
    at = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
    try:
        fcntl.flock(at, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(at)
        raise StudyError(f"{folder}: another server has this study open; end that one first") from None
    except OSError as error:  # a file system without locks
        log.warning("%s: cannot be kept from being served twice: %s", folder, error.strerror)
    return at


def _say_failure(done: "asyncio.Future[None]") -> None:
    error = None if done.cancelled() else done.exception()
    if error is not None:
        log.error("the server's own log: %s", error)
