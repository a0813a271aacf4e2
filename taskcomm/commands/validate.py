"""`taskcomm validate`: every problem of trial logs."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from taskcomm.commands.terminal import Terminal
from taskcomm.logs import Finding, validate

MOST = 20


def run(paths: list[Path], json: bool) -> int:
    """Print every problem and notice; 3 if there is a problem."""
    terminal = Terminal(json)
    report = validate(paths)
    problems, notices = shortened(report.problems), shortened(report.notices)
    counts = {"problems": len(report.problems), "notices": len(report.notices)}
    terminal.document(
        {
            "command": "validate",
            "ok": report.ok,
            "files": list(report.files),
            "trials": report.trials,
            "steps": report.steps,
            "problems": problems,
            "notices": notices,
            "counts": counts,
        }
    )
    for kind, lines in (("problem", problems), ("notice", notices)):
        for line in lines:
            terminal.line(f"{kind}: {line}")
    seen = {"files": len(report.files), "trials": report.trials, "steps": report.steps}
    terminal.line(f"{counted(seen)}: {counted(counts)}")
    return 0 if report.ok else 3


def shortened(findings: Sequence[Finding]) -> list[str]:
    """What was found: of each file the first MOST, and how many more there are."""
    by_file: dict[str, list[str]] = {}
    for found in findings:
        by_file.setdefault(found.path, []).append(str(found))
    lines = []
    for path, of_file in by_file.items():
        lines += of_file[:MOST]
        if len(of_file) > MOST:
            lines.append(f"{path}: and {len(of_file) - MOST} more")
    return lines


def counted(numbers: Mapping[str, int]) -> str:
    """The numbers and their plurals, as one says it.

    >>> counted({"files": 1, "trials": 0, "steps": 2})
    '1 file, 0 trials, 2 steps'
    """
    return ", ".join(f"{number} {what[:-1] if number == 1 else what}" for what, number in numbers.items())
