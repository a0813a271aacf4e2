"""A page, and the answers to it: taken as they should be, or refused in words for the participant."""

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

from taskcomm.web.study.assignment import TrialPlan
from taskcomm.web.study.texts import ProblemTexts, filled

Kind = Literal["text", "consent", "form", "card", "trial", "thanks"]
Value = str | int | float | bool | None
LONGEST = 2000  # characters of a free answer


class AnswerError(ValueError):
    """An answer that cannot be taken, in words for the participant."""


class PageSpec(NamedTuple):
    """A page: its kind and content, as `protocol.Page` has them; its name in the records; its trial.

    `problems` are the words for answers that cannot be taken.
    """

    kind: Kind
    name: str
    content: dict[str, Any]
    problems: ProblemTexts
    trial: TrialPlan | None = None


def checked(page: PageSpec, values: Mapping[str, Value]) -> dict[str, Value]:
    """The answers to be recorded: by item of a form, None where one was left out that may be; {agreed,
    version} of consent; {} of a page without questions.

    Raises AnswerError for the first item that lacks an answer or has one that it cannot have.
    """
    if page.kind == "consent":
        if set(values) != {"agreed"} or not isinstance(values["agreed"], bool):
            raise AnswerError(page.problems.other)
        return {"agreed": values["agreed"], "version": page.content["version"]}
    items = page.content["items"] if page.kind == "form" else []
    if not set(values) <= {item["item"] for item in items}:
        raise AnswerError(page.problems.other)
    return {item["item"]: _answer(page, item, values.get(item["item"])) for item in items}


def rating_lines(page: PageSpec, clean: Mapping[str, Value]) -> list[dict[str, Any]]:
    """What the log of the page's trial is told of its checked answers: {item, value, scale} each.

    `scale` is {low, high} or {choices}, None for free text.
    """
    return [
        {"item": item["item"], "value": clean[item["item"]], "scale": _scale(item)}
        for item in page.content["items"]
    ]


def _scale(item: Mapping[str, Any]) -> dict[str, Any] | None:
    if "low" in item:
        return {"low": item["low"], "high": item["high"]}
    if "choices" in item:
        return {"choices": [choice["value"] for choice in item["choices"]]}
    return None


def _answer(page: PageSpec, item: Mapping[str, Any], value: Value) -> Value:
    if isinstance(value, str) and item["kind"] == "text":
        value = value.strip()
    if value is None or value == "":
        if item["optional"]:
            return None
        raise AnswerError(filled(page.problems.missing, text=item["text"]))
    if item["kind"] in ("integer", "scale"):
        if type(value) is not int or not item["low"] <= value <= item["high"]:
            words = filled(page.problems.whole, text=item["text"], low=item["low"], high=item["high"])
            raise AnswerError(words)
    elif item["kind"] == "choice":
        if not isinstance(value, str) or value not in [choice["value"] for choice in item["choices"]]:
            raise AnswerError(filled(page.problems.choice, text=item["text"]))
    elif not isinstance(value, str) or len(value) > LONGEST:
        raise AnswerError(filled(page.problems.text, text=item["text"], high=LONGEST))
    return value
