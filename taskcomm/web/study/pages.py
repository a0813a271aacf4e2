"""The pages that a participant goes through, in their order, with the words of the study."""

from collections.abc import Iterator, Mapping
from typing import Any

from taskcomm.web.study.answers import AnswerError as AnswerError
from taskcomm.web.study.answers import PageSpec as PageSpec
from taskcomm.web.study.answers import checked as checked
from taskcomm.web.study.answers import rating_lines as rating_lines
from taskcomm.web.study.assignment import Participant, TrialPlan
from taskcomm.web.study.structure import Design, Item
from taskcomm.web.study.texts import ConsentText, FormText, LastText, PageText, Texts, filled


def pages(design: Design, texts: Texts, participant: Participant) -> tuple[PageSpec, ...]:
    """Consent, questionnaire, instructions, the practice; card, trial and rating of each trial; thanks.

    What the design leaves out is not there. No content tells who controls the robot.
    """
    return tuple(_pages(design, texts, participant))


def _pages(design: Design, texts: Texts, participant: Participant) -> Iterator[PageSpec]:
    counted = sum(not trial.practice for trial in participant.trials)
    places = _places(design, counted)
    problems = texts.problems
    if design.consent.ask:
        words = texts.consent
        content = _text(words, places) | {"button": words.button, "decline": words.decline}
        yield PageSpec("consent", "consent", content | {"version": design.consent.version}, problems)
    if design.questionnaire:
        form = _form(texts.questionnaire, texts, design.questionnaire, "")
        yield PageSpec("form", "questionnaire", form, problems)
    if design.instructions:
        content = _text(texts.instructions, places) | {"button": texts.instructions.button}
        yield PageSpec("text", "instructions", content, problems)
    for trial in participant.trials:
        card = _card(design, texts, trial, counted)
        begin = {"button": texts.card.button}
        yield PageSpec("card", f"card-{trial.trial_id}", card | begin, problems, trial)
        yield PageSpec("trial", trial.trial_id, card, problems, trial)
        if trial.practice:
            content = _text(texts.after_practice, places) | {"button": texts.after_practice.button}
            yield PageSpec("text", "after-practice", content, problems)
        elif design.ratings:
            form = _form(texts.rating, texts, design.ratings, card["sentence"])
            yield PageSpec("form", f"rating-{trial.trial_id}", form, problems, trial)
    yield PageSpec("thanks", "thanks", _text(texts.thanks, places), problems)


def declined(texts: Texts) -> PageSpec:
    """The last page of who does not consent, shown in place of all that would follow."""
    return PageSpec("thanks", "declined", _text(texts.declined, {}), texts.problems)


def _places(design: Design, trials: int) -> dict[str, object]:
    """What may be filled in on every page."""
    minutes = design.timing.limit / 60
    return {
        "title": design.title,
        "balls": design.world.balls,
        "distances": design.world.distances,
        "trials": trials,
        "minutes": f"{minutes:.2g}" if minutes < 10 else f"{minutes:.0f}",
    }


def _text(words: ConsentText | PageText | LastText, places: Mapping[str, object]) -> dict[str, Any]:
    return {
        "title": filled(words.title, **places),
        "body": [filled(paragraph, **places) for paragraph in words.body],
    }


def _card(design: Design, texts: Texts, trial: TrialPlan, trials: int) -> dict[str, Any]:
    title = texts.card.practice if trial.practice else texts.card.title
    task = {"mov": trial.task.mov, "wrt": trial.task.wrt, "dist": trial.task.dist}
    return {
        "title": filled(title, trial=trial.index + 1, trials=trials),
        "sentence": filled(texts.card.sentence, **task),
        **task,
        "distances": design.world.distances,
    }


def _form(frame: FormText, texts: Texts, items: tuple[Item, ...], card: str) -> dict[str, Any]:
    return {
        "title": frame.title,
        "items": [_item(item, texts, card) for item in items],
        "button": frame.button,
    }


def _item(item: Item, texts: Texts, card: str) -> dict[str, Any]:
    words = texts.items[item.item]
    content: dict[str, Any] = {"item": item.item, "text": filled(words.text, card=card), "kind": item.kind}
    if item.kind in ("integer", "scale"):
        content |= {"low": item.low, "high": item.high}
    if item.kind == "scale":
        content |= {"low_label": words.low_label, "high_label": words.high_label}
    if item.kind == "choice":
        content["choices"] = [{"value": value, "text": words.choices[value]} for value in item.choices]
    return content | {"optional": item.optional}
