"""The pages: in order, the same whoever controls the robot; answers taken strictly."""

import json
import re
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskcomm.loglines import structure
from taskcomm.web.protocol import Page
from taskcomm.web.study.assignment import assign
from taskcomm.web.study.design import Consent, Design, Item, parsed
from taskcomm.web.study.folder import template
from taskcomm.web.study.pages import AnswerError, PageSpec, checked, declined, pages, rating_lines
from taskcomm.web.study.texts import parse_texts, shipped

PAPER = msgspec.structs.replace(
    parsed(template()),
    questionnaire=(
        Item(item="age", kind="integer", low=18, high=120),
        Item(item="familiarity", kind="scale", low=1, high=7),
        Item(item="remarks", kind="text", optional=True),
    ),
)
REMARKS = '\n[items.remarks]\ntext = "Anything else?"\n'


def of(design: Design, language: str = "en", row: int = 0) -> tuple[PageSpec, ...]:
    texts = parse_texts(shipped(language) + REMARKS, design, language)
    return pages(design, texts, assign(design)[row])


ALL = of(PAPER)
BY_NAME = {page.name: page for page in ALL}
FORM, RATING = BY_NAME["questionnaire"], BY_NAME["rating-P01-1"]


def test_the_order_is_consent_questions_instructions_practice_trials_thanks() -> None:
    assert [(page.kind, page.name) for page in ALL] == [
        ("consent", "consent"),
        ("form", "questionnaire"),
        ("text", "instructions"),
        ("card", "card-P01-practice"),
        ("trial", "P01-practice"),
        ("text", "after-practice"),
        ("card", "card-P01-1"),
        ("trial", "P01-1"),
        ("form", "rating-P01-1"),
        ("card", "card-P01-2"),
        ("trial", "P01-2"),
        ("form", "rating-P01-2"),
        ("thanks", "thanks"),
    ]


def test_what_the_design_leaves_out_is_not_there() -> None:
    bare = Design(
        name="a", teachers=1, consent=Consent(ask=False), questionnaire=(), ratings=(), instructions=False
    )
    assert [page.kind for page in of(bare)] == ["card", "trial", "thanks"]


def test_pages_belong_to_their_trial() -> None:
    for page in ALL:
        named = page.name.removeprefix("card-").removeprefix("rating-")
        assert (page.trial.trial_id if page.trial else None) == (named if named.startswith("P01") else None)


def test_every_page_goes_over_the_wire() -> None:
    for page in ALL:
        message = Page(index=0, of=len(ALL), kind=page.kind, content=page.content)
        assert json.loads(msgspec.json.encode(message))["content"] == page.content


def test_cards_show_the_task_of_their_trial_and_every_place_is_filled() -> None:
    for language in ("en", "de"):
        for page in of(PAPER, language):
            title, body = page.content.get("title", ""), page.content.get("body", ())
            assert re.search(r"\{\w+\}", " ".join([title, *body])) is None
            if page.kind in ("card", "trial"):
                assert page.trial is not None
                task = page.trial.task
                shown = tuple(page.content[part] for part in ("mov", "wrt", "dist"))
                assert shown == tuple(task)
                assert sorted(n for n in page.content["sentence"] if n.isdigit()) == sorted(map(str, task))
                assert page.content["distances"] == 4


def test_nothing_on_a_page_tells_who_controls_the_robot() -> None:
    """The pages of two studies that differ in the controllers alone are the same."""
    first, second = PAPER.conditions
    swapped = (
        msgspec.structs.replace(second, name=first.name),
        msgspec.structs.replace(first, name=second.name),
    )
    other = msgspec.structs.replace(PAPER, conditions=swapped)
    for row in range(PAPER.teachers):
        one, two = of(PAPER, row=row), of(other, row=row)
        assert [(p.kind, p.name, p.content) for p in one] == [(p.kind, p.name, p.content) for p in two]
        told = json.dumps([page.content for page in one])
        assert "pomdp" not in told
        assert "planner" not in told
        assert "operator" not in told


def test_who_declines_is_thanked_and_told_that_nothing_more_is_recorded() -> None:
    page = declined(parse_texts(shipped("en") + REMARKS, PAPER, "en"))
    assert (page.kind, page.name) == ("thanks", "declined")
    assert "Nothing more is recorded" in page.content["body"][0]


@pytest.mark.parametrize("agreed", [True, False])
def test_consent_is_recorded_with_the_version_of_its_words(agreed: bool) -> None:
    design = msgspec.structs.replace(PAPER, consent=Consent(version="2026-11"))
    assert checked(of(design)[0], {"agreed": agreed}) == {"agreed": agreed, "version": "2026-11"}


@pytest.mark.parametrize(
    "values", [{}, {"agreed": 1}, {"agreed": "yes"}, {"agreed": None}, {"agreed": True, "x": 1}]
)
def test_anything_else_is_no_consent(values: dict[str, Any]) -> None:
    with pytest.raises(AnswerError, match="does not belong to this page"):
        checked(ALL[0], values)


def test_answers_come_back_clean_and_in_the_order_of_the_form() -> None:
    asked: dict[str, Any] = {"remarks": "  fine \n", "familiarity": 7, "age": 18}
    assert list(checked(FORM, asked).items()) == [("age", 18), ("familiarity", 7), ("remarks", "fine")]
    for left_out in (None, "", "  "):
        assert checked(FORM, {"age": 120, "familiarity": 1, "remarks": left_out})["remarks"] is None
    assert checked(FORM, {"age": 120, "familiarity": 1})["remarks"] is None
    assert checked(RATING, {"intelligence": 10, "right": "no"}) == {"intelligence": 10, "right": "no"}
    assert checked(BY_NAME["instructions"], {}) == {}


GOOD = {"age": 30, "familiarity": 4, "remarks": None}
BAD = [
    ({"age": None}, "Please answer: How old are you"),
    ({"age": ""}, "Please answer: How old are you"),
    ({"age": 17}, "whole number from 18 to 120: How old"),
    ({"age": 121}, "whole number from 18 to 120: How old"),
    ({"age": 30.0}, "whole number from 18 to 120: How old"),
    ({"age": True}, "whole number from 18 to 120: How old"),
    ({"age": "30"}, "whole number from 18 to 120: How old"),
    ({"familiarity": 8}, "whole number from 1 to 7: How familiar"),
    ({"remarks": 3}, "no more than 2000 characters: Anything else"),
    ({"remarks": "x" * 2001}, "no more than 2000 characters: Anything else"),
    ({"name": "Ada"}, "does not belong to this page"),
]


@pytest.mark.parametrize(("change", "said"), BAD)
def test_an_answer_that_cannot_be_is_refused_in_words_for_a_person(change: dict[str, Any], said: str) -> None:
    with pytest.raises(AnswerError) as error:
        checked(FORM, GOOD | change)
    assert said in str(error.value)


def test_a_choice_must_be_one_of_those_offered_and_pages_to_read_take_no_answers() -> None:
    with pytest.raises(AnswerError, match="Please choose one of the answers: Was the robot right"):
        checked(RATING, {"intelligence": 3, "right": "Yes"})
    for page in ALL:
        if page.kind not in ("form", "consent"):
            with pytest.raises(AnswerError):
                checked(page, {"age": 30})


VALUES = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8)


@given(
    st.sampled_from(ALL),
    st.dictionaries(st.sampled_from(["age", "right", "agreed", "x"]) | st.text(), VALUES),
)
def test_any_values_give_clean_answers_or_an_answer_error(page: PageSpec, values: dict[str, Any]) -> None:
    try:
        clean = checked(page, values)
    except AnswerError as error:
        clean = {"refused": str(error)}
    asked = {item["item"] for item in page.content.get("items", ())}
    assert set(clean) in (asked, {"agreed", "version"}, {"refused"})


def test_ratings_are_lines_of_a_trial_log() -> None:
    lines = rating_lines(RATING, checked(RATING, {"intelligence": 7, "right": "yes"}))
    assert lines == [
        {"item": "intelligence", "value": 7, "scale": {"low": 1, "high": 10}},
        {"item": "right", "value": "yes", "scale": {"choices": ["yes", "no"]}},
    ]
    for seq, line in enumerate(lines, 1):
        assert structure({"type": "rating", "trial_id": "P01-1", "seq": seq, **line}) is not None
