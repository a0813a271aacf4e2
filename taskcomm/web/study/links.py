"""Who may come in as what: a random token for each, kept in a file that its owner alone can read."""

import hashlib
import hmac
import json
import os
import secrets
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

from msgspec import Struct

from taskcomm.web.study.reading import StudyError, from_json, matching, text_of

Role = Literal["teacher", "operator", "admin", "annotator"]
Token = Annotated[str, matching(r"[A-Za-z0-9_-]{20,}", "20 or more letters, digits, - and _", 200)]
Tokens = Mapping[Role, Mapping[str, str]]
ADMIN = "admin"
BYTES = 24  # of randomness in a token


class Seat(NamedTuple):
    """A role, and whose: participant, operator or annotator id; "" for the admin."""

    role: Role
    name: str


class _Links(Struct, forbid_unknown_fields=True):
    """The file: tokens by name, by role."""

    teacher: dict[str, Token]
    operator: dict[str, Token]
    admin: dict[str, Token]
    annotator: dict[str, Token]


def fresh(teachers: Iterable[str], operators: Iterable[str], annotators: Iterable[str]) -> Tokens:
    """New tokens for everyone, and for one admin."""
    names: dict[Role, Iterable[str]]
    names = {"teacher": teachers, "operator": operators, "admin": (ADMIN,), "annotator": annotators}
    return {role: {name: secrets.token_urlsafe(BYTES) for name in some} for role, some in names.items()}


def write_tokens(tokens: Tokens, path: Path) -> None:
    """Write the file, mode 0600, in its folder, which is made with mode 0700. It must not be there."""
    path.parent.mkdir(mode=0o700)
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
        file.write(json.dumps(tokens, indent=2) + "\n")


def read_tokens(path: Path) -> Tokens:
    """The tokens of a file; StudyError says what is wrong with it, and never a token."""
    links = from_json(text_of(path), _Links, str(path))
    tokens: Tokens = {
        "teacher": links.teacher,
        "operator": links.operator,
        "admin": links.admin,
        "annotator": links.annotator,
    }
    seen: dict[str, str] = {}
    for role, some in tokens.items():
        for name, token in some.items():
            who = f"{role} {name}".strip()
            if token in seen:
                raise StudyError(f"{path}: {who} has the same token as {seen[token]}")
            seen[token] = who
    if set(links.admin) != {ADMIN}:
        raise StudyError(f"{path}: admin: must be one token, called {ADMIN}")
    return tokens


def exposed(path: Path) -> str | None:
    """What others than the owner may do with the file or its folder, or None."""
    for place, wanted in ((path.parent, 0o700), (path, 0o600)):
        mode = place.stat().st_mode & 0o777
        if mode & 0o077:
            return f"{place}: others than you have access (mode {mode:03o}); run: chmod {wanted:o} {place}"
    return None


class Seats:
    """Finds the seat of a token, in a time that does not depend on how much of it is right."""

    def __init__(self, tokens: Tokens) -> None:
        self._seats = tuple(
            (_digest(token), Seat(role, "" if role == "admin" else name))
            for role, some in tokens.items()
            for name, token in some.items()
        )

    def seat(self, token: str) -> Seat | None:
        """Who has this token, or None. Every token is compared, by digest, to the end."""
        wanted, found = _digest(token), None
        for digest, seat in self._seats:
            if hmac.compare_digest(digest, wanted):
                found = seat
        return found


def _digest(token: str) -> bytes:
    return hashlib.sha256(token.encode("utf-8", "surrogatepass")).digest()
