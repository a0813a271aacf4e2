"""A participant's pages: what is asked is answered in the form that the server wants, or marked."""

from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, expect
from web.pages.stage import Stage, opened, picture, served

from taskcomm.web.protocol import Page as Shown
from taskcomm.web.protocol import Problem

ITEMS: list[dict[str, Any]] = [
    {"item": "age", "text": "How old are you?", "kind": "integer", "low": 18, "high": 99},
    {
        "item": "familiarity",
        "text": "How familiar are you with artificial intelligence?",
        "kind": "scale",
        "low": 1,
        "high": 7,
        "low_label": "not at all",
        "high_label": "very",
    },
    {
        "item": "right",
        "text": "Was the robot right?",
        "kind": "choice",
        "choices": [{"value": "yes", "text": "Yes"}, {"value": "no", "text": "No"}],
    },
    {"item": "note", "text": "Anything else?", "kind": "text", "high": 200, "optional": True},
]
FORM = Shown(index=1, of=8, kind="form", content={"title": "About you", "items": ITEMS, "button": "Continue"})
CONSENT = Shown(
    index=0,
    of=8,
    kind="consent",
    content={"title": "Consent", "body": ["One.", "<b>Two</b>."], "button": "I agree", "decline": "I do not"},
)


def test_a_form_is_sent_by_item_as_numbers_and_words(browser: Browser, tmp_path: Path) -> None:
    with served(Stage("teacher", [FORM])) as stage, opened(browser, stage) as page:
        page.get_by_label("How old are you?").fill("23")
        page.get_by_role("radio", name="4").check()
        page.get_by_text("No", exact=True).click()
        picture(page, tmp_path, "form")
        page.get_by_role("button", name="Continue").click()
        values = {"age": 23, "familiarity": 4, "right": "no", "note": None}
        assert stage.until("answer")[0] == {"type": "answer", "index": 1, "values": values}
        expect(page.get_by_role("button", name="Continue")).to_be_disabled()


def test_what_is_missing_or_out_of_range_is_marked_and_nothing_is_sent(
    browser: Browser, tmp_path: Path
) -> None:
    with served(Stage("teacher", [FORM])) as stage, opened(browser, stage) as page:
        page.get_by_label("How old are you?").fill("12.5")
        page.get_by_role("button", name="Continue").click()
        expect(page.get_by_text("Please enter a whole number from 18 to 99.")).to_be_visible()
        expect(page.get_by_text("Please answer this question.")).to_have_count(2)
        expect(page.get_by_label("How old are you?")).to_be_focused()
        expect(page.get_by_label("How old are you?")).to_have_attribute("aria-invalid", "true")
        picture(page, tmp_path, "form-marked")
        assert stage.of("answer") == []


def test_what_the_server_finds_wrong_is_said_and_the_answers_stay(browser: Browser) -> None:
    with served(Stage("teacher", [FORM])) as stage, opened(browser, stage) as page:
        page.get_by_label("How old are you?").fill("23")
        page.get_by_role("radio", name="4").check()
        page.get_by_role("radio", name="Yes").check()
        page.get_by_role("button", name="Continue").click()
        stage.until("answer")
        stage.say(Problem(text="Storage is full."), FORM)
        expect(page.get_by_text("Storage is full.")).to_be_visible()
        expect(page.get_by_label("How old are you?")).to_have_value("23")
        page.get_by_role("button", name="Continue").click()
        first, second = stage.until("answer", 2)
        assert first == second


def test_an_answer_that_the_connection_lost_is_sent_again_and_a_form_keeps_what_was_typed(
    browser: Browser,
) -> None:
    with served(Stage("teacher", [FORM])) as stage, opened(browser, stage) as page:
        page.get_by_label("How old are you?").fill("23")
        stage.drop()
        stage.until_connected(2)
        expect(page.get_by_label("How old are you?")).to_have_value("23")
        page.get_by_role("radio", name="4").check()
        page.get_by_role("radio", name="Yes").check()
        page.get_by_role("button", name="Continue").click()
        stage.until("answer")
        stage.drop()
        stage.until_connected(3)
        assert stage.until("answer", 2)[1]["values"]["age"] == 23


@pytest.mark.parametrize(("button", "agreed"), [("I agree", True), ("I do not", False)])
def test_consent_is_a_yes_or_a_no_and_texts_are_never_markup(
    browser: Browser, button: str, agreed: bool
) -> None:
    with served(Stage("teacher", [CONSENT])) as stage, opened(browser, stage) as page:
        expect(page.get_by_text("<b>Two</b>.")).to_be_visible()
        page.get_by_role("button", name=button, exact=True).click()
        assert stage.until("answer")[0]["values"] == {"agreed": agreed}


@pytest.mark.parametrize(
    ("kind", "text"), [("wait", "not ready yet"), ("thanks", "Thank you"), ("gone", "another window")]
)
def test_pages_without_a_question(browser: Browser, kind: Any, text: str) -> None:
    with served(Stage("teacher", [Shown(index=0, of=1, kind=kind)])) as stage, opened(browser, stage) as page:
        expect(page.locator("#root")).to_contain_text(text)
        assert page.get_by_role("button").count() == 0


def test_without_a_token_or_with_a_wrong_one_the_page_says_so(browser: Browser) -> None:
    with served(Stage("teacher")) as stage, opened(browser, stage) as page:
        stage.until_connected(1)
        page.goto("about:blank")
        page.goto(stage.address)
        expect(page.get_by_text("needs the whole link")).to_be_visible()
        assert stage.connections == 1
