"""Appending to files so that what is said to be there is on disk."""

import asyncio
import os
import queue
import threading
from collections import OrderedDict
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

_OPEN = 128  # files kept open


@dataclass(slots=True)
class _Job:
    path: Path
    content: bytes
    loop: asyncio.AbstractEventLoop
    done: "asyncio.Future[None]"
    log: "Log | None"


class Journal:
    """Appends whole lines; the future of `append` is done when they are on disk.

    One thread writes in the order of the calls and flushes all that waits together: one flush a file, however
    many lines. A write that fails (a full disk) leaves the file as it was before it, and its future raises.

    A file that a crash left with a torn last line must be mended first: see `torn_end`.
    """

    def __init__(self) -> None:
        self._jobs: queue.SimpleQueue[_Job | None] = queue.SimpleQueue()
        self._files: OrderedDict[Path, int] = OrderedDict()
        self._thread = threading.Thread(target=self._run, name="journal", daemon=True)
        self._thread.start()

    def append(self, path: Path, content: bytes, log: "Log | None" = None) -> "asyncio.Future[None]":
        """Have `content` (lines with their ends) written at the end of `path`, which is made if need be."""
        loop = asyncio.get_running_loop()
        job = _Job(path, content, loop, loop.create_future(), log)
        self._jobs.put(job)
        return job.done

    def close(self) -> None:
        """Write what waits, then end."""
        self._jobs.put(None)
        self._thread.join()

    def _run(self) -> None:
        closing = False
        while not closing:
            batch = [self._jobs.get()]
            while not self._jobs.empty():
                batch.append(self._jobs.get())
            closing = None in batch
            by_file: dict[Path, list[_Job]] = {}
            for job in batch:
                if job is not None:
                    by_file.setdefault(job.path, []).append(job)
            for path, jobs in by_file.items():
                self._write(path, jobs)
        for file in self._files.values():
            os.close(file)

    def _write(self, path: Path, jobs: list[_Job]) -> None:
        for job in jobs:
            if job.log is not None and job.log.lost is not None:
                _tell(job, job.log.lost)
        jobs = [job for job in jobs if job.log is None or job.log.lost is None]
        error: OSError | None = None
        try:
            if jobs:
                _append_all(self._opened(path), b"".join(job.content for job in jobs))
        except OSError as reason:
            error = reason
        except Exception as reason:  # the thread must live: whoever waits would wait for ever
            error = OSError(f"{type(reason).__name__}: {reason}")
        for job in jobs:
            if job.log is not None:
                job.log.lost = error
            _tell(job, error)

    def _opened(self, path: Path) -> int:
        if path in self._files:
            self._files.move_to_end(path)
            return self._files[path]
        new = not path.exists()
        file = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC, 0o600)
        if new:
            _flush_folder(path.parent)
        self._files[path] = file
        if len(self._files) > _OPEN:
            os.close(self._files.popitem(last=False)[1])
        return file


class Log:
    """Appends to one file lines that count on each other: after one that was lost, none is written."""

    def __init__(self, journal: Journal, path: Path) -> None:
        self._journal, self._path = journal, path
        self.lost: OSError | None = None

    def append(self, content: bytes) -> "asyncio.Future[None]":
        """As the journal's; fails with the error of the first line that was lost."""
        return self._journal.append(self._path, content, self)


def _append_all(file: int, content: bytes) -> None:
    """Write and flush; on an error nothing of it stays."""
    before = os.fstat(file).st_size
    try:
        written = 0
        while written < len(content):
            written += os.write(file, content[written:])
        (os.fdatasync if hasattr(os, "fdatasync") else os.fsync)(file)
    except OSError:
        os.ftruncate(file, before)
        raise


def _flush_folder(folder: Path) -> None:
    """A new file is on disk when its name is."""
    at = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(at)
    finally:
        os.close(at)


def _tell(job: _Job, error: OSError | None) -> None:
    with suppress(RuntimeError):  # nobody waits any more: the loop is closed
        job.loop.call_soon_threadsafe(_settle, job.done, error)


def _settle(done: "asyncio.Future[None]", error: OSError | None) -> None:
    if done.cancelled():
        return
    if error is None:
        done.set_result(None)
    else:
        done.set_exception(error)


def torn_end(path: Path) -> bytes:
    """Cut off what stands behind the last line end of `path`, as a crash may leave it, and give it back."""
    content = path.read_bytes()
    whole = content.rfind(b"\n") + 1
    torn = content[whole:]
    if torn:
        with path.open("r+b") as file:
            file.truncate(whole)
            os.fsync(file.fileno())
    return torn
