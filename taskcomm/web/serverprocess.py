"""The server of a study folder as a process of its own: for rehearsals, which may kill it."""

import argparse
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

STARTS_WITHIN = 120.0  # s; kernels may have to be compiled
ENDS_WITHIN = 20.0


class ServerError(OSError):
    """The server did not start or end as it should; the message has its last words."""


class ServerProcess:
    """Serves `folder` on a free port of the loopback, the same one after a restart.

    It ends with the process that made it. What it says goes to `log`.
    """

    def __init__(self, folder: Path, log: Path, *, lockstep: bool, processes: int = 1) -> None:
        self.folder, self.log, self.lockstep, self.processes = folder, log, lockstep, processes
        self.port = 0
        self._process: subprocess.Popen[str] | None = None

    @property
    def address(self) -> str:
        """Of its page."""
        return f"http://127.0.0.1:{self.port}"

    @property
    def pid(self) -> int:
        """Its process number."""
        assert self._process is not None
        return self._process.pid

    @property
    def running(self) -> bool:
        """Whether the process is there."""
        return self._process is not None and self._process.poll() is None

    def start(self) -> None:
        """Start, and wait until it can be used. Raises ServerError."""
        words = [str(self.folder), "--port", str(self.port), "--processes", str(self.processes)]
        words += ["--lockstep"] if self.lockstep else []
        with self.log.open("a") as log:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "taskcomm.web.serverprocess", *words],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                text=True,
            )
        assert self._process.stdout is not None
        timer = threading.Timer(STARTS_WITHIN, self._process.kill)
        timer.start()
        said = self._process.stdout.readline()
        timer.cancel()
        if not said:
            self._close()
            raise ServerError(f"the server did not start: {self._last_words()}")
        self.port = int(said.rsplit(":", 1)[1])

    def kill(self) -> None:
        """As a crash does (SIGKILL)."""
        if self._process is not None:
            self._process.kill()
            self._close()

    def stop(self) -> None:
        """End it in good order. Raises ServerError where it does not."""
        if self._process is None:
            return
        assert self._process.stdin is not None
        self._process.stdin.close()
        try:
            code = self._process.wait(ENDS_WITHIN)
        except subprocess.TimeoutExpired:
            self.kill()
            raise ServerError(f"the server did not end within {ENDS_WITHIN:g} s") from None
        self._close()
        if code != 0:
            raise ServerError(f"the server ended with code {code}: {self._last_words()}")

    def _close(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            process.wait()
            for pipe in (process.stdin, process.stdout):
                if pipe is not None:
                    pipe.close()

    def _last_words(self) -> str:
        lines = self.log.read_text(encoding="utf-8").strip().splitlines()
        return lines[-1] if lines else "it said nothing"


def main(arguments: Sequence[str] | None = None) -> int:
    """Serve until standard input is closed."""
    from taskcomm.web.serving import serve
    from taskcomm.web.study.folder import StudyFolder

    parser = argparse.ArgumentParser(prog="python -m taskcomm.web.serverprocess")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--port", type=int, default=0)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--lockstep", action="store_true")
    chosen = parser.parse_args(arguments)
    ended = threading.Event()

    def wait() -> None:
        sys.stdin.read()
        ended.set()

    threading.Thread(target=wait, daemon=True).start()
    serve(
        StudyFolder(chosen.folder),
        port=chosen.port,
        lockstep=chosen.lockstep,
        processes=chosen.processes,
        ready=lambda address: print(address, flush=True),
        until=lambda _: ended.is_set(),
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
