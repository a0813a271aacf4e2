"""The words: complete in both languages, filled in, and one error for what is missing."""

import re
import tomllib
from pathlib import Path

import pytest

from taskcomm.web.study.design import Design, Item, parsed
from taskcomm.web.study.folder import template
from taskcomm.web.study.texts import SHIPPED, Texts, TextsError, filled, load_texts, parse_texts, shipped

PAPER = parsed(template())
ENGLISH = shipped("en")


def read(text: str, design: Design = PAPER) -> Texts:
    return parse_texts(text, design, "texts/en.toml")


def places(text: str) -> list[str]:
    return sorted(re.findall(r"\{\w+\}", text))


@pytest.mark.parametrize("language", SHIPPED)
def test_the_shipped_words_are_complete(language: str, tmp_path: Path) -> None:
    path = tmp_path / f"{language}.toml"
    path.write_text(shipped(language), encoding="utf-8")
    texts = load_texts(path, PAPER)
    assert set(texts.items) == {"age", "familiarity", "intelligence", "right"}


def test_both_languages_have_the_same_keys_and_places_but_other_words() -> None:
    documents = [tomllib.loads(shipped(language)) for language in ("en", "de")]
    same = set[str]()

    def compare(key: str, english: object, german: object) -> None:
        assert type(english) is type(german), key
        if isinstance(english, dict) and isinstance(german, dict):
            assert english.keys() == german.keys(), key
            for name in english:
                compare(f"{key}.{name}".lstrip("."), english[name], german[name])
        elif isinstance(english, list) and isinstance(german, list):
            assert len(english) == len(german), key
            assert places("".join(english)) == places("".join(german)), key
        else:
            assert places(str(english)) == places(str(german)), key
            same.update({key} if english == german else ())

    compare("", *documents)
    assert same == {"interface.final", "interface.state_ball"}


def test_the_german_words_say_sie() -> None:
    assert re.search(r"\b([Dd]u|[Dd]ein\w*|[Dd]ir|[Dd]ich|[Ee]uch)\b", shipped("de")) is None
    assert "Sie" in shipped("de")


def test_the_shipped_instructions_say_what_the_robot_can_do_and_what_a_press_means() -> None:
    words = " ".join(read(ENGLISH).instructions.body)
    for said in ("approve", "light", "pick", "slide", "Final", "space bar"):
        assert said in words


BAD = {
    ('decline = "I do not agree"\n', ""): "consent: decline is missing",
    ('[declined]\ntitle = "Thank you"\n', "[declined]\n"): "declined: title is missing",
    ('final = "Final"\n', ""): "interface.final is missing",
    ('final = "Final"\nt', 'zfinal = "Final"\nzt'): "interface.final is missing (and 1 more)",
    ("[items.age]", "[items.aeg]"): "items.age is missing, which the questionnaire of the design asks",
    ('no = "No"', 'non = "No"'): "items.right.choices.no is missing",
    ("[rating]", "[ratings]"): "ratings: is unknown; did you mean rating?",
    ("distance {dist} from", "distance {dits} from"): "card.sentence: {dits} cannot be filled in here;",
    ("distance {dist} from", "a distance from"): "card.sentence: {dist} is missing",
    ("How old are you", "How old are you, {card}"): "items.age.text: {card} is for questions",
    ('button = "Begin"', "button = 3"): "card.button: expected `str`, got `int`",
    ('title = "About you"', 'title = ""'): "questionnaire.title: expected `str` of length >= 1",
    ("[thanks]", "[thanks"): "not TOML: ",
}  # fmt: skip


@pytest.mark.parametrize("edit", BAD)
def test_words_that_are_missing_or_cannot_be_are_one_error(edit: tuple[str, str]) -> None:
    before, after = edit
    assert before in ENGLISH
    with pytest.raises(TextsError) as error:
        read(ENGLISH.replace(before, after, 1))
    assert str(error.value).startswith(f"texts/en.toml: {BAD[edit]}")
    assert "\n" not in str(error.value)


def test_a_question_of_the_design_needs_its_words_and_others_do_no_harm() -> None:
    design = Design(name="a", questionnaire=(Item(item="gender", kind="text"),))
    with pytest.raises(TextsError, match=r"items\.gender is missing"):
        read(ENGLISH, design)
    texts = read(ENGLISH + '\n[items.gender]\ntext = "Your gender?"\n', design)
    assert set(texts.items) == {"age", "familiarity", "intelligence", "right", "gender"}


def test_a_language_without_words_is_said(tmp_path: Path) -> None:
    with pytest.raises(TextsError, match=r"fr\.toml: there is no such file, and the language"):
        load_texts(tmp_path / "fr.toml", PAPER)


def test_only_named_places_are_filled() -> None:
    words = "{mov} {x} {} {0} {mov!r} {{mov}} {mov.real}"
    assert filled(words, mov=2) == "2 {x} {} {0} {mov!r} {2} {mov.real}"
