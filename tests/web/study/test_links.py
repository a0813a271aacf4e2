"""Links: random, kept from others, and found in one way whatever is asked."""

import hmac
import json
import stat
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskcomm.web.study.links import Seat, Seats, exposed, fresh, read_tokens, write_tokens
from taskcomm.web.study.reading import StudyError

TOKENS = fresh(["P01", "P02"], ["O1"], ["annotator-1"])
ALL = [(role, name, token) for role, some in TOKENS.items() for name, token in some.items()]


def test_every_token_finds_its_seat_and_no_other() -> None:
    seats = Seats(TOKENS)
    found = {seats.seat(token) for _, _, token in ALL}
    assert found == {
        Seat("teacher", "P01"),
        Seat("teacher", "P02"),
        Seat("operator", "O1"),
        Seat("admin", ""),
        Seat("annotator", "annotator-1"),
    }


@given(st.text(max_size=60) | st.sampled_from(ALL).map(lambda each: each[2][:-1]))
def test_any_other_text_finds_none(text: str) -> None:
    assert Seats(TOKENS).seat(text) is None


def test_a_lone_surrogate_finds_none() -> None:
    assert Seats(TOKENS).seat("\ud800") is None


def test_every_token_is_compared_whichever_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    seats, compared = Seats(TOKENS), list[int]()
    whole = hmac.compare_digest

    def counting(one: bytes, other: bytes) -> bool:
        compared.append(len(one))
        return bool(whole(one, other))

    monkeypatch.setattr(hmac, "compare_digest", counting)
    for token in (ALL[0][2], ALL[-1][2], "wrong"):
        compared.clear()
        seats.seat(token)
        assert compared == [32] * len(ALL)


def test_tokens_are_random_and_of_192_bits() -> None:
    tokens = [token for _ in range(50) for some in fresh(["P01"], [], []).values() for token in some.values()]
    assert len(set(tokens)) == 100
    assert {len(token) for token in tokens} == {32}


def test_the_file_is_its_owners_alone_and_reads_back(tmp_path: Path) -> None:
    path = tmp_path / "private" / "links.json"
    write_tokens(TOKENS, path)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700
    assert read_tokens(path) == TOKENS
    assert exposed(path) is None
    with pytest.raises(FileExistsError):
        write_tokens(TOKENS, path)


@pytest.mark.parametrize("place", ["private", "private/links.json"])
def test_what_others_may_read_is_said_with_the_way_out(tmp_path: Path, place: str) -> None:
    path = tmp_path / "private" / "links.json"
    write_tokens(TOKENS, path)
    (tmp_path / place).chmod(0o744)
    said = exposed(path)
    assert said is not None
    assert f"{tmp_path / place}: others than you have access (mode 744); run: chmod" in said


def _with(role: str, name: str, token: str) -> str:
    return json.dumps({**TOKENS, role: {**TOKENS[role], name: token}})  # type: ignore[index]


BAD = {
    "{": "not JSON: ",
    "[]": "expected `object`, got `array`",
    json.dumps({"teacher": {}}): "operator is missing",
    json.dumps({**TOKENS, "guest": {}}): "guest: is unknown; ",
    json.dumps({**TOKENS, "admin": {}}): "admin: must be one token, called admin",
    _with("teacher", "P03", TOKENS["operator"]["O1"]): "operator O1 has the same token as teacher P03",
    _with("teacher", "P03", "short"): "teacher[...]: expected 20 or more letters, digits, - and _",
    _with("teacher", "P03", "x" * 30 + "!"): "teacher[...]: expected 20 or more letters, digits, - and _",
}  # fmt: skip


@pytest.mark.parametrize("content", BAD)
def test_a_file_that_cannot_be_is_said_without_any_token(tmp_path: Path, content: str) -> None:
    path = tmp_path / "links.json"
    path.write_text(content)
    with pytest.raises(StudyError) as error:
        read_tokens(path)
    assert str(error.value).startswith(f"{path}: {BAD[content]}")
    assert not any(token in str(error.value) for _, _, token in ALL)
