"""`taskcomm validate`: every problem of trial logs."""

from pathlib import Path

from taskcomm.commands.terminal import Terminal
from taskcomm.logs import validate


def run(paths: list[Path], json: bool) -> int:
    """Print every problem and notice; 3 if there is a problem."""
    terminal = Terminal(json)
    report = validate(paths)
    terminal.document(
        {
            "command": "validate",
            "ok": report.ok,
            "files": list(report.files),
            "trials": report.trials,
            "steps": report.steps,
            "problems": [str(found) for found in report.problems],
            "notices": [str(found) for found in report.notices],
        }
    )
    for found in report.problems:
        terminal.line(f"problem: {found}")
    for found in report.notices:
        terminal.line(f"notice: {found}")
    terminal.line(
        f"{len(report.files)} files, {report.trials} trials, {report.steps} steps:"
        f" {len(report.problems)} problems, {len(report.notices)} notices"
    )
    return 0 if report.ok else 3
