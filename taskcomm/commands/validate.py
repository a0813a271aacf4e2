"""`taskcomm validate`: every problem of trial logs and cue tables."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from taskcomm.commands.terminal import Terminal
from taskcomm.cuerows import is_cue_table
from taskcomm.cuetable import validate_cue_tables
from taskcomm.logs import Finding, Report, validate

MOST = 20


def run(paths: list[Path], dt: float | None, json: bool) -> int:
    """Print every problem and notice; 3 if there is a problem."""
    terminal = Terminal(json)
    report = report_of(paths, dt)
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


def report_of(paths: Sequence[Path], dt: float | None) -> Report:
    """What there is to say of all the paths, logs first; `dt` is for cue tables that do not say theirs."""
    tables = [path for path in paths if is_cue_table(path)]
    logs = [path for path in paths if path not in tables]
    reports = [validate(logs)] if logs else []
    reports += [validate_cue_tables(tables, dt)] if tables else []
    files, problems, notices = (
        tuple(each for report in reports for each in getattr(report, name))
        for name in ("files", "problems", "notices")
    )
    trials, steps = sum(report.trials for report in reports), sum(report.steps for report in reports)
    return Report(files, trials, steps, problems, notices)


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
