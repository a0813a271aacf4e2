"""Study files into checked structures: every error says which file, which key, and why."""

import ast
import difflib
import json
import re
import tomllib
import types
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import msgspec

LARGEST = 1 << 20  # bytes of a file of words or settings
_SAID: dict[str, str] = {}  # patterns in words

T = TypeVar("T")


class StudyError(ValueError):
    """A file of a study that cannot be: which, where in it, and why."""


def matching(pattern: str, words: str, longest: int) -> msgspec.Meta:
    """Text that is wholly as `pattern`, which errors state in `words`."""
    _SAID[f"^({pattern})$"] = words
    return msgspec.Meta(pattern=f"^({pattern})$", max_length=longest)


def text_of(path: Path) -> str:
    """The text of a file of words or settings; StudyError where there is none that can be read."""
    try:
        if path.stat().st_size > LARGEST:
            raise StudyError(f"{path}: is larger than {LARGEST >> 20} MiB")
        return path.read_bytes().removeprefix(b"\xef\xbb\xbf").decode().replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        raise StudyError(f"{path}: not UTF-8 text, from byte {error.start}") from None
    except OSError as error:
        raise StudyError(f"{path}: cannot be read: {error.strerror or error}") from None


def from_toml(text: str, kind: type[T], where: str) -> T:
    """The `kind` that a TOML text holds; `where` names the text in errors.

    >>> class Size(msgspec.Struct, forbid_unknown_fields=True):
    ...     balls: int
    >>> from_toml("bals = 3", Size, "world.toml")
    Traceback (most recent call last):
    taskcomm.web.study.reading.StudyError: world.toml: bals: is unknown; did you mean balls?
    """
    try:
        document = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise StudyError(f"{where}: not TOML: {error}") from None
    return converted(document, kind, where)


def from_json(text: str, kind: type[T], where: str) -> T:
    """The `kind` that a JSON text holds."""
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise StudyError(f"{where}: not JSON: {error}") from None
    return converted(document, kind, where)


def converted(document: Any, kind: type[T], where: str) -> T:
    """`document` as a `kind`, strictly: no key that it does not know, no type changed."""
    _check_names(document, kind, where, "")
    try:
        return msgspec.convert(document, kind, strict=True)
    except msgspec.ValidationError as error:
        raise StudyError(f"{where}: {plain(str(error))}") from None


def plain(message: str) -> str:
    """A message of the decoder as `key: why`.

    >>> plain("Expected `int` >= 1 - at `$.world.balls`")
    'world.balls: expected `int` >= 1'
    """
    what, _, place = message.partition(" - at `")
    field = place.rstrip("`").removeprefix("$").lstrip(".")
    what = re.sub("^Object missing required field `(.*)`$", r"\1 is missing", what)
    what = re.sub("^Expected `str` matching regex (.*)$", _in_words, what)
    what = what[:1].lower() + what[1:]
    return f"{field}: {what}" if field else what


def _in_words(found: re.Match[str]) -> str:
    pattern = str(ast.literal_eval(found[1]))
    return f"expected {_SAID.get(pattern, found[0])}"


def nearest(name: str, known: typing.Iterable[str]) -> str:
    """`; did you mean ...?`, or which names there are.

    >>> nearest("teacher", ["teachers", "title"]), nearest("x", ["seed", "name"])
    ('; did you mean teachers?', '; known are name, seed')
    """
    known = sorted(known)
    close = difflib.get_close_matches(name, known, n=1, cutoff=0.6)
    return f"; did you mean {close[0]}?" if close else f"; known are {', '.join(known)}"


def _check_names(document: Any, kind: Any, where: str, place: str) -> None:
    """Walk `document` along the structure `kind`; StudyError at the first name that it does not know."""
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        if not isinstance(document, Mapping):
            return
        fields = typing.get_type_hints(kind)
        known = {field.encode_name: fields[field.name] for field in msgspec.structs.fields(kind)}
        for key, value in document.items():
            inside = f"{place}.{key}" if place else str(key)
            if key not in known:
                raise StudyError(f"{where}: {inside}: is unknown{nearest(str(key), known)}")
            _check_names(value, known[key], where, inside)
        return
    origin, parts = typing.get_origin(kind), typing.get_args(kind)
    if origin in (typing.Union, types.UnionType):
        for part in parts:
            _check_names(document, part, where, place)
    elif origin is typing.Literal and isinstance(document, str) and document not in parts:
        raise StudyError(f"{where}: {place}: {document!r} is unknown{nearest(document, parts)}")
    elif origin in (tuple, list) and isinstance(document, list):
        for index, value in enumerate(document):
            _check_names(value, parts[0], where, f"{place}[{index}]")
    elif origin is dict and isinstance(document, Mapping):
        for key, value in document.items():
            _check_names(value, parts[1], where, f"{place}.{key}")
