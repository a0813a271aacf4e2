"""Logged trials of a study that runs: read and computed in a process of their own.

What a replay computes takes a share of a second, its first one loads libraries: neither may hold up a tick.
"""

import asyncio
import os
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import TypeVar

from taskcomm.web import replaying
from taskcomm.web.protocol import Label, Replay, Trials
from taskcomm.web.thinking import end_with_parent

Told = TypeVar("Told")
_NICE = 10  # it gives way to the planner


@dataclass(frozen=True)
class _Shelf:
    """A study's folder, as far as another process needs it."""

    trials_dir: Path
    models_dir: Path


class Archive:
    """Answers what `replaying` says, one question after the other. The process starts with the first.

    If it dies, a ReplayError says so, and the next question finds another.
    """

    def __init__(self, folder: replaying.Folder) -> None:
        self._shelf = _Shelf(folder.trials_dir.resolve(), folder.models_dir.resolve())
        self._pool: ProcessPoolExecutor | None = None

    async def trials(self, annotator: str | None) -> Trials:
        """The trials that can be opened."""
        return await self._ask(replaying.trials, annotator)

    async def opened(self, trial: str, model: str | None, annotator: str | None) -> Replay:
        """A trial to be shown."""
        return await self._ask(replaying.opened, trial, model, annotator)

    async def label_line(self, label: Label, annotator: str) -> tuple[Path, bytes]:
        """The log that a label belongs into, and its line."""
        return await self._ask(replaying.label_line, label, annotator)

    async def _ask(self, question: Callable[..., Told], *values: object) -> Told:
        if self._pool is None:
            self._pool = ProcessPoolExecutor(1, mp_context=get_context("spawn"), initializer=_begin)
        pool = self._pool
        try:
            asked = pool.submit(question, self._shelf, *values)
            return await asyncio.wrap_future(asked)
        except BrokenProcessPool:
            self._pool = None if self._pool is pool else self._pool
            raise replaying.ReplayError("reading the logs broke off; please try again") from None

    def close(self) -> None:
        """End the process."""
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)


def _begin() -> None:
    """In the new process: it gives way, ends with its parent, and has loaded what replays need."""
    import taskcomm.smoother  # noqa: F401

    end_with_parent()
    os.nice(_NICE)
