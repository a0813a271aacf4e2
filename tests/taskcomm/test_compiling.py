"""Kernels are kept where that can be done, compiled anew where not, and nobody sees a traceback."""

import importlib.util
import logging
import resource
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest
from numba.core import config

KERNEL = """
from taskcomm.compiling import kernel

@kernel(__name__, "a sum")
def add(a, b):
    return a + b
"""
ONCE = "compiling a sum; this may take a minute, once per machine"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> Path:
    """A module with a kernel, no folder for compiled code but those beside it and beside the user's files."""
    monkeypatch.setattr(config, "CACHE_DIR", "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "user"))
    (tmp_path / "sums.py").write_text(KERNEL)
    caplog.set_level(logging.WARNING, "taskcomm")
    return tmp_path


def load(folder: Path) -> ModuleType:
    """The module of `folder`, as a new process would see it."""
    spec = importlib.util.spec_from_file_location("sums", folder / "sums.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def compiled(module: ModuleType) -> int:
    """How many kernels were compiled, not loaded, when the sum was taken."""
    assert module.add(2, 3) == 5
    return sum(module.add.stats.cache_misses.values())


def block(path: Path) -> None:
    """Make a folder at `path` impossible, for root too: a file stands there."""
    path.write_text("")


@pytest.fixture
def small_files() -> Iterator[None]:
    """A full disk: whatever grows beyond some bytes is an OSError."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (64, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_kernel_is_compiled_once_and_then_read(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    assert compiled(load(folder)) == 1
    assert compiled(load(folder)) == 0
    assert caplog.messages == [ONCE]


def test_the_folder_of_the_user_takes_what_cannot_lie_beside_the_module(
    folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    block(folder / "__pycache__")
    assert compiled(load(folder)) == 1
    assert compiled(load(folder)) == 0
    assert caplog.messages == [ONCE]
    assert list((folder / "user").rglob("*.nbc"))


def test_without_any_folder_to_write_a_kernel_is_compiled_in_memory(
    folder: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("__pycache__", "user", "asked"):
        block(folder / name)
    monkeypatch.setattr(config, "CACHE_DIR", str(folder / "asked" / "for"))
    for _ in range(2):
        module = load(folder)
        assert module.add(2, 3) == 5
        assert module.add.signatures
    [first, second] = caplog.messages
    assert first == second
    assert "compiling a sum" in first
    assert "in every process" in first
    assert "NUMBA_CACHE_DIR" in first


def test_a_folder_that_fills_up_is_done_without(
    folder: Path, caplog: pytest.LogCaptureFixture, small_files: None
) -> None:
    assert compiled(load(folder)) == 1
    [announced, trouble] = caplog.messages
    assert announced == ONCE
    assert "cannot be kept" in trouble
    assert str(folder / "__pycache__") in trouble


@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
@pytest.mark.parametrize("content", [b"", b"\x80\x05nothing that was ever pickled"])
def test_damaged_files_are_made_anew(
    folder: Path, caplog: pytest.LogCaptureFixture, suffix: str, content: bytes
) -> None:
    assert compiled(load(folder)) == 1
    for path in (folder / "__pycache__").glob(f"*.{suffix}"):
        path.write_bytes(content)
    assert compiled(load(folder)) == 1
    assert compiled(load(folder)) == 0
    [first, trouble, again] = caplog.messages
    assert first == again == ONCE
    assert "damaged" in trouble
    assert str(folder / "__pycache__") in trouble
