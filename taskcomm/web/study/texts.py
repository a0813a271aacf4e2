"""The words of a study in one language (`texts/en.toml`): all that a participant reads."""

import re
from collections.abc import Iterator, Mapping
from importlib import resources
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta, Struct

from taskcomm.web.study.reading import StudyError, from_toml, text_of
from taskcomm.web.study.structure import Design, Item

SHIPPED = ("en", "de")
OF_DESIGN = {"title", "balls", "distances", "trials", "minutes"}
TOLD = ("consent", "instructions", "after_practice", "thanks")  # where these may be filled in

Words = Annotated[str, Meta(min_length=1, max_length=4000)]
Paragraphs = Annotated[tuple[Words, ...], Meta(min_length=1, max_length=40)]


class TextsError(StudyError):
    """Words that are missing or cannot be: file, key, why."""


class _Part(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A part of the words."""


class ConsentText(_Part, frozen=True, kw_only=True):
    """What participants agree to; `button` agrees, `decline` does not."""

    title: Words
    body: Paragraphs
    button: Words
    decline: Words


class PageText(_Part, frozen=True, kw_only=True):
    """A page to read."""

    title: Words
    body: Paragraphs
    button: Words


class FormText(_Part, frozen=True, kw_only=True):
    """The frame of a form; its items are in `items`."""

    title: Words
    button: Words


class CardText(_Part, frozen=True, kw_only=True):
    """The card before a trial; `sentence` names {mov}, {wrt} and {dist}, `title` {trial} and {trials}."""

    title: Words
    practice: Words
    sentence: Words
    button: Words


class LastText(_Part, frozen=True, kw_only=True):
    """The end: nothing is to be done any more."""

    title: Words
    body: Paragraphs


class ItemText(_Part, frozen=True, kw_only=True):
    """A question; what the ends of its scale mean; its choices by value."""

    text: Words
    low_label: str = ""
    high_label: str = ""
    choices: dict[str, Words] = {}


class ProblemTexts(_Part, frozen=True, kw_only=True):
    """What is said of an answer that cannot be taken; {text} is the question."""

    missing: Words
    whole: Words
    choice: Words
    text: Words
    other: Words


class Texts(_Part, frozen=True, kw_only=True):
    """The words of one language. `interface` goes to every page of the browser."""

    consent: ConsentText
    declined: LastText
    questionnaire: FormText
    instructions: PageText
    after_practice: PageText
    card: CardText
    rating: FormText
    thanks: LastText
    problems: ProblemTexts
    items: dict[str, ItemText]
    interface: dict[str, Words]


def shipped(language: str) -> str:
    """The text of a shipped file of words; TextsError for a language that is not shipped."""
    if language not in SHIPPED:
        raise TextsError(
            f"texts/{language}.toml: there is no such file, and shipped are {', '.join(SHIPPED)}; copy one of"
            " them and translate it"
        )
    template = resources.files("taskcomm.web.study") / "template"
    return (template / "texts" / f"{language}.toml").read_text(encoding="utf-8")


def load_texts(path: Path, design: Design) -> Texts:
    """The words of a file, complete for this design; TextsError says file, key and why."""
    if not path.is_file():
        raise TextsError(
            f"{path}: there is no such file, and the language of the design is {design.language!r}"
        )
    try:
        return parse_texts(text_of(path), design, str(path))
    except TextsError:
        raise
    except StudyError as error:
        raise TextsError(str(error)) from None


def parse_texts(text: str, design: Design, where: str) -> Texts:
    """The words of a TOML text, complete for this design."""
    try:
        texts = from_toml(text, Texts, where)
        model = from_toml(shipped("en"), Texts, "texts/en.toml")
    except StudyError as error:
        raise TextsError(str(error)) from None
    missing = sorted(set(model.interface) - set(texts.interface))
    if missing:
        more = f" (and {len(missing) - 1} more)" if len(missing) > 1 else ""
        raise TextsError(f"{where}: interface.{missing[0]} is missing{more}")
    for name, items in (("questionnaire", design.questionnaire), ("ratings", design.ratings)):
        for item in items:
            _check_item(texts, item, where, name)
    for item in design.questionnaire:
        if "{card}" in texts.items[item.item].text:
            raise TextsError(f"{where}: items.{item.item}.text: {{card}} is for questions after a trial")
    _check_places(texts, model, where)
    return texts


def _check_item(texts: Texts, item: Item, where: str, of: str) -> None:
    words = texts.items.get(item.item)
    if words is None:
        raise TextsError(f"{where}: items.{item.item} is missing, which the {of} of the design asks")
    for choice in item.choices:
        if choice not in words.choices:
            raise TextsError(f"{where}: items.{item.item}.choices.{choice} is missing")


def _check_places(texts: Texts, model: Texts, where: str) -> None:
    """Every {place} must be one that is filled in there; the card must name its whole task."""
    known = {key: set(_places(words)) for key, words in _leaves(msgspec.to_builtins(model))}
    for key, words in _leaves(msgspec.to_builtins(texts)):
        part = key.partition(".")[0]
        allowed = {"card"} if part == "items" else known.get(key, set())
        allowed = allowed | (OF_DESIGN if part in TOLD else set())
        for place in _places(words):
            if place not in allowed:
                have = ", ".join(f"{{{name}}}" for name in sorted(allowed)) or "none"
                raise TextsError(f"{where}: {key}: {{{place}}} cannot be filled in here; there is {have}")
    for place in ("mov", "wrt", "dist"):
        if place not in _places(texts.card.sentence):
            raise TextsError(f"{where}: card.sentence: {{{place}}} is missing")


def _places(words: str) -> list[str]:
    return re.findall(r"\{(\w*)\}", words)


def _leaves(value: Any, key: str = "") -> Iterator[tuple[str, str]]:
    """All words by key; the paragraphs of one body are one."""
    if isinstance(value, str):
        yield key, value
    elif isinstance(value, Mapping):
        for name, inside in value.items():
            yield from _leaves(inside, f"{key}.{name}" if key else name)
    else:
        yield key, "\n".join(value)


def filled(words: str, **places: object) -> str:
    """`words` with every {place} of that name filled in; others are left, and braces mean nothing else.

    >>> filled("Put ball {mov} there. {x} {}", mov=2)
    'Put ball 2 there. {x} {}'
    """
    return re.sub(r"\{(\w+)\}", lambda found: str(places.get(found[1], found[0])), words)
