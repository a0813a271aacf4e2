"""A design as the text of a `study.toml`: in full, or an existing text with a few keys changed."""

import json
import re
from collections.abc import Mapping
from typing import Any

import msgspec

from taskcomm.web.study.design import Design, DesignError, Operators, parsed


def toml_of(design: Design) -> str:
    """The text that reads back as `design`.

    >>> parsed(toml_of(Design(name="pilot"))) == Design(name="pilot")
    True
    """
    fields = {key: value for key, value in msgspec.to_builtins(design).items() if value is not None}
    flat = {key: value for key, value in fields.items() if not _is_table(value)}
    lines = [f"{key} = {_value(value)}" for key, value in flat.items()]
    for key, value in fields.items():
        if isinstance(value, Mapping):
            lines += ["", f"[{key}]", *_pairs(value)]
        elif _is_table(value):
            for each in value:
                lines += ["", f"[[{key}]]", *_pairs(each)]
    return "\n".join(lines) + "\n"


def _is_table(value: Any) -> bool:
    return isinstance(value, Mapping) or (
        isinstance(value, list | tuple) and bool(value) and isinstance(value[0], Mapping)
    )


def _pairs(table: Mapping[str, Any]) -> list[str]:
    return [f"{key} = {_value(value)}" for key, value in table.items() if value is not None]


def _value(value: Any) -> str:
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_value, value))}]"
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def amended(text: str, where: str, **changes: Any) -> str:
    """The text of a design with the keys changed that are not None; comments are kept if possible.

    With another number of teachers a pool of everybody, and the draw from it, go along.
    """
    design, wanted = parsed(text, where), {key: value for key, value in changes.items() if value is not None}
    if not wanted:
        return text
    operators = design.operators
    if operators is not None and "teachers" in wanted and not isinstance(operators.pool, tuple):
        wanted["operators"] = Operators(draw=min(operators.draw, wanted["teachers"]))
    changed = msgspec.structs.replace(design, **wanted)
    for key in ("teachers", "seed", "language", "title"):
        if key in wanted:
            text = _set(text, key, wanted[key])
    if "operators" in wanted:
        text = re.sub(r"(?m)^pool\s*=.*\n", "", text)
        text = re.sub(r"(?m)^draw\s*=\s*\d+", f"draw = {wanted['operators'].draw}", text)
    try:
        if parsed(text, where) == changed:
            return text
    except DesignError:
        pass
    return toml_of(changed)


def _set(text: str, key: str, value: Any) -> str:
    """`text` with a key above its first table set."""
    first = re.search(r"(?m)^\s*\[", text)
    end = len(text) if first is None else first.start()
    line = re.compile(rf'(?m)^{key}\s*=\s*("[^"\n]*"|[^\s#]+)')
    head, found = line.subn(lambda _: f"{key} = {_value(value)}", text[:end])
    return (head if found else f"{key} = {_value(value)}\n{head}") + text[end:]
