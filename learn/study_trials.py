"""The trials of a study as its figures see them: by condition and teacher, with their ratings."""

from collections.abc import Iterable, Sequence
from typing import Any

from taskcomm.trials import Trial

PLANNED = "pomdp"
YES, NO = ("yes", "true"), ("no", "false")


class Missing(ValueError):
    """What a figure or table needs and the trials lack, in one line."""


def by_planner(trial: Trial) -> bool:
    """Whether the planning robot acted in this trial."""
    return trial.planner is not None or trial.robot_model is not None or trial.condition == PLANNED


def by_condition(trials: Iterable[Trial]) -> dict[str, list[Trial]]:
    """The trials by the name of their condition, those of the planner last, else in order of name."""
    grouped: dict[str, list[Trial]] = {}
    for trial in trials:
        grouped.setdefault(trial.condition, []).append(trial)
    return dict(sorted(grouped.items(), key=lambda item: (any(map(by_planner, item[1])), item[0])))


def teacher_of(trial: Trial) -> str:
    """Whose trial it is: the participant, or where none is named the trial itself."""
    return trial.participant_id or f"trial {trial.trial_id}"


def time_to_final(trial: Trial) -> float | None:
    """Seconds until Final was shown, None where it was not."""
    return trial.duration if trial.reason == "final" else None


def ratings(trial: Trial) -> dict[str, float | str]:
    """The answers after a trial by item, the last one given to each; unanswered items are left out."""
    return {line["item"]: line["value"] for line in trial.ratings if line["value"] is not None}


def as_number(value: float | str) -> float | None:
    """An answer as a number, yes and no as 1 and 0; None for other words.

    >>> [as_number(value) for value in (7, "yes", "No", "perhaps")]
    [7.0, 1.0, 0.0, None]
    """
    if isinstance(value, str):
        word = value.strip().lower()
        return 1.0 if word in YES else 0.0 if word in NO else None
    return float(value)


def rated_items(trials: Sequence[Trial]) -> dict[str, bool]:
    """The items that trials are rated on in numbers, in the order met; True for those of yes and no alone.

    An item is one of yes and no if its answers are these words, or its scale is from 0 to 1.
    """
    items: dict[str, bool] = {}
    for trial in trials:
        for line in trial.ratings:
            if line["value"] is None or as_number(line["value"]) is None:
                continue
            plain = isinstance(line["value"], str) or _ends(line.get("scale")) == (0.0, 1.0)
            items[line["item"]] = items.get(line["item"], True) and plain
    return items


def scale_of(trials: Sequence[Trial], item: str) -> tuple[float, float]:
    """The ends of the scale of an item: as the logs say, or else the least and greatest answer."""
    lines = [line for trial in trials for line in trial.ratings if line["item"] == item]
    for line in lines:
        ends = _ends(line.get("scale"))
        if ends is not None:
            return ends
    values = [value for line in lines if (value := as_number(line["value"])) is not None]
    return min(values), max(values)


def _ends(scale: Any) -> tuple[float, float] | None:
    if isinstance(scale, dict):
        scale = [scale.get("low"), scale.get("high")]
    if isinstance(scale, list | tuple) and len(scale) >= 2:
        low, high = scale[0], scale[-1]
        if isinstance(low, int | float) and isinstance(high, int | float) and low < high:
            return float(low), float(high)
    return None


def source_note(trials: Sequence[Trial]) -> str:
    """Where trials come from and how many they are, as every figure says.

    >>> source_note([])
    'no trials'
    """
    sources = sorted({trial.source for trial in trials})
    kind = f"{sources[0]} " if len(sources) == 1 else ""
    mixed = " (some of them SIMULATED)" if len(sources) > 1 else ""
    return f"{counted(len(trials), f'{kind}trial')}{mixed}" if trials else "no trials"


def counted(number: int, what: str) -> str:
    """A number with its noun.

    >>> counted(1, "teacher"), counted(22, "teacher"), counted(2, "press")
    ('1 teacher', '22 teachers', '2 presses')
    """
    plural = f"{what}es" if what.endswith("s") else f"{what}s"
    return f"{number} {what if number == 1 else plural}"
