"""Scripts in processes of their own."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def run(script: str, path: Path = ROOT, **settings: str) -> subprocess.CompletedProcess[str]:
    """`script` in a new process that finds the package in the folder `path`; warnings are errors.

    Of numba's settings it has those in `settings` alone.
    """
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("NUMBA_", "PYTHON"))}
    kept["PYTHONPATH"] = os.pathsep.join([str(path), str(ROOT / "tests")])
    command = [sys.executable, "-P", "-W", "error", "-c", script]
    return subprocess.run(command, env=kept | settings, capture_output=True, text=True, timeout=600)
