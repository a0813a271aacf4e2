"""The process that reads logs for those who look on: it answers as `replaying` does, and may die."""

import asyncio
import os
import signal
from dataclasses import dataclass
from pathlib import Path

import pytest

from taskcomm.logs import read_trials, write_trials
from taskcomm.web import replaying
from taskcomm.web.archive import Archive
from taskcomm.web.protocol import Label, encode

STUDY = Path(__file__).parents[2] / "datasets" / "simulated-study" / "trials.jsonl"
NAME = "study-002-2"


@dataclass(frozen=True)
class Folder:
    trials_dir: Path
    models_dir: Path


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    (tmp_path / "trials").mkdir()
    chosen = [trial for trial in read_trials(STUDY) if trial.trial_id == NAME]
    write_trials(chosen, tmp_path / "trials" / "one.jsonl")
    return Folder(tmp_path / "trials", tmp_path / "models")


def processes(archive: Archive) -> list[int]:
    return list(getattr(archive._pool, "_processes", None) or {})


async def asked_often(archive: Archive) -> None:
    for _ in range(100):
        await archive.trials(None)


async def questions(folder: Folder) -> None:
    archive = Archive(folder)
    try:
        assert processes(archive) == []
        assert await archive.trials("ann") == replaying.trials(folder, "ann")
        shown = await archive.opened(NAME, None, None)
        assert encode(shown) == encode(replaying.opened(folder, NAME))
        label = Label(trial=NAME, press_seq=shown.presses[0]["seq"], mental_state="mistake")
        path, line = await archive.label_line(label, "ann")
        assert path == folder.trials_dir / "one.jsonl"
        assert b'"annotator":"ann"' in line
        with pytest.raises(replaying.ReplayError, match="there is no trial 'nobody'"):
            await archive.opened("nobody", None, None)
        (process,) = processes(archive)
        assert process != os.getpid()
        os.kill(process, signal.SIGKILL)
        with pytest.raises(replaying.ReplayError, match="please try again"):
            await asked_often(archive)
        assert len((await archive.trials(None)).trials) == 1
        assert processes(archive) not in ([], [process])
    finally:
        archive.close()


def test_it_answers_from_another_process_and_starts_another_when_that_dies(folder: Folder) -> None:
    asyncio.run(questions(folder))
