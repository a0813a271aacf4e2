"""The journal: what is acknowledged is on disk, in order; what fails leaves nothing."""

import asyncio
import os
from pathlib import Path

import pytest

from taskcomm.web import journal as module
from taskcomm.web.journal import Journal, Log, torn_end


def test_lines_are_in_the_file_when_their_future_is_done_and_in_the_order_of_the_calls(
    tmp_path: Path,
) -> None:
    path = tmp_path / "a.jsonl"

    async def write() -> list[bytes]:
        journal, seen = Journal(), []
        futures = [journal.append(path, f"{number}\n".encode()) for number in range(50)]
        for number, future in enumerate(futures):
            await future
            seen.append(path.read_bytes().splitlines()[number])
        journal.close()
        return seen

    assert asyncio.run(write()) == [str(number).encode() for number in range(50)]


def test_lines_that_wait_together_share_one_flush(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    flushes: list[int] = []
    real = os.fdatasync

    def slow(file: int) -> None:
        flushes.append(file)
        real(file)
        if len(flushes) == 1:
            asyncio.run(asyncio.sleep(0.05))

    monkeypatch.setattr(os, "fdatasync", slow)

    async def write() -> None:
        journal = Journal()
        await asyncio.gather(*(journal.append(tmp_path / "a", b"line\n") for _ in range(100)))
        journal.close()

    asyncio.run(write())
    assert (tmp_path / "a").read_bytes() == b"line\n" * 100
    assert len(flushes) < 10


def test_a_write_that_fails_says_so_and_leaves_the_file_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.jsonl"
    real = os.write

    def full(file: int, content: bytes) -> int:
        if b"too much" in content:
            real(file, content[:4])
            raise OSError(28, "No space left on device")
        return real(file, content)

    monkeypatch.setattr(os, "write", full)

    async def write() -> None:
        journal = Journal()
        await journal.append(path, b"kept\n")
        with pytest.raises(OSError, match="No space left"):
            await journal.append(path, b"too much\n")
        await journal.append(path, b"after\n")
        journal.close()

    asyncio.run(write())
    assert path.read_bytes() == b"kept\nafter\n"


def test_in_a_log_nothing_follows_a_line_that_was_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.jsonl"
    real = os.write
    full = [False]

    def write(file: int, content: bytes) -> int:
        if full[0]:
            raise OSError(28, "No space left on device")
        return real(file, content)

    monkeypatch.setattr(os, "write", write)

    async def lines() -> None:
        journal = Journal()
        log = Log(journal, path)
        await log.append(b"0\n")
        full[0] = True
        with pytest.raises(OSError, match="No space left"):
            await log.append(b"1\n")
        full[0] = False
        with pytest.raises(OSError, match="No space left"):
            await log.append(b"2\n")
        await Log(journal, path).append(b"1\n")
        journal.close()

    asyncio.run(lines())
    assert path.read_bytes() == b"0\n1\n"


def test_whatever_goes_wrong_in_writing_is_told_and_the_journal_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = os.open

    def odd(path: Path, *rest: int) -> int:
        if str(path).endswith("odd"):
            raise ValueError("no such thing")
        return real(path, *rest)

    monkeypatch.setattr(os, "open", odd)

    async def write() -> None:
        journal = Journal()
        with pytest.raises(OSError, match="ValueError: no such thing"):
            await asyncio.wait_for(journal.append(tmp_path / "odd", b"line\n"), 5)
        await asyncio.wait_for(journal.append(tmp_path / "a", b"line\n"), 5)
        journal.close()

    asyncio.run(write())
    assert (tmp_path / "a").read_bytes() == b"line\n"


def test_more_files_than_are_kept_open_are_all_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_OPEN", 3)

    async def write() -> None:
        journal = Journal()
        for turn in range(2):
            await asyncio.gather(
                *(journal.append(tmp_path / str(number), b"%d\n" % turn) for number in range(10))
            )
        journal.close()

    asyncio.run(write())
    assert {(tmp_path / str(number)).read_bytes() for number in range(10)} == {b"0\n1\n"}


def test_a_torn_end_is_cut_off_and_given_back(tmp_path: Path) -> None:
    path = tmp_path / "a.jsonl"
    path.write_bytes(b'{"whole":1}\n{"torn":')
    assert torn_end(path) == b'{"torn":'
    assert path.read_bytes() == b'{"whole":1}\n'
    assert torn_end(path) == b""
