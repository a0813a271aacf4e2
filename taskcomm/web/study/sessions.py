"""The pages that a participant has done (`sessions/P01.jsonl`), and what they are by the design of today."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from taskcomm.web.study.answers import PageSpec
from taskcomm.web.study.reading import StudyError


def lines_of(path: Path) -> tuple[list[dict[str, Any]], bool, str | None]:
    """The objects in a JSON Lines file, whether its last line is torn, and the first that is no object."""
    if not path.exists():
        return [], False, None
    whole, _, rest = path.read_bytes().rpartition(b"\n")
    lines, problem = [], None
    for number, text in enumerate(whole.split(b"\n") if whole else [], 1):
        try:
            line = msgspec.json.decode(text, type=dict)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            problem = problem or f"{path.name}:{number}: not a JSON object"
            continue
        lines.append(line)
    return lines, bool(rest), problem


def check_session(path: Path, specs: Sequence[PageSpec]) -> None:
    """Raise StudyError where a page done is another one by now: going on would skip or repeat some."""
    for line in lines_of(path)[0]:
        page, name = line.get("page"), line.get("name")
        if not isinstance(page, int):
            continue
        now = specs[page].name if 0 <= page < len(specs) else "none"
        if now != name:
            raise StudyError(
                f"{path}: page {page} was {name} when it was done, by the design it is now {now}; put"
                " study.toml back as it was, or make a new study"
            )


def consented(lines: Sequence[dict[str, Any]]) -> str | None:
    """The version of the words that a session agrees to, or None."""
    for values in (line.get("values") for line in lines if line.get("kind") == "consent"):
        if isinstance(values, dict) and values.get("agreed") is True:
            return str(values.get("version"))
    return None


def declined(lines: Sequence[dict[str, Any]]) -> bool:
    """Whether a session says that consent was not given."""
    given = [line.get("values") for line in lines if line.get("kind") == "consent"]
    return any(isinstance(values, dict) and values.get("agreed") is False for values in given)
