"""Structures of a teacher: which cue drives which state, delay, decay, rest (MODEL.md, section 7)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from learn.coordinates import NAMES, vector_of
from learn.settings import Freedom, Settings
from taskcomm.lattice import Floats
from taskcomm.teacher import TeacherModel

NONE, SHARED, PER_STATE = "none", "shared", "per state"
SHARINGS = (NONE, SHARED, PER_STATE)
CUE_OF = "cue of "
Value = str | float


@dataclass(frozen=True)
class Structure:
    """What of a teacher model is no number to be fitted; the rest (s) is a number, but is tried, not fitted.

    `cues` are pairs of an approval state and the cue that drives it; `delay` and `decay` are one of
    SHARINGS: none, one shared by all approval states, or one for each. A *factor* is one of the cues, the
    delay, the decay or the rest.

    >>> structure = Structure.of(TeacherModel.intuitive())
    >>> structure.factors
    ('cue of that_mov', 'cue of that_wrt', 'cue of that_dist', 'rest', 'delay', 'decay')
    >>> print(structure.with_value("delay", "shared"))
    mov_lit, wrt_lit_while_mov_held, mov_at_dist; delay shared
    """

    cues: tuple[tuple[str, str], ...]
    delay: str = NONE
    decay: str = NONE
    rest: float = 0.0

    @classmethod
    def of(cls, model: TeacherModel) -> Self:
        """The structure that a model has."""
        tops = model.approvals.values()
        cues = tuple((state, top.cue) for state, top in model.approvals.items())
        delays, decays = {top.delay for top in tops}, {top.decay for top in tops}
        return cls(cues, _sharing(delays, 0.0), _sharing(decays, None), model.rest)

    @property
    def factors(self) -> tuple[str, ...]:
        """The names of all factors, in the order in which a search goes through them."""
        return (*(CUE_OF + state for state, _ in self.cues), "rest", "delay", "decay")

    def value(self, factor: str) -> Value:
        """What the structure has of a factor."""
        if factor.startswith(CUE_OF):
            return dict(self.cues)[factor.removeprefix(CUE_OF)]
        found: Value = getattr(self, factor)
        return found

    def with_value(self, factor: str, value: Value) -> Self:
        """The structure with another value of one factor."""
        if factor.startswith(CUE_OF):
            cues = dict(self.cues) | {factor.removeprefix(CUE_OF): str(value)}
            return replace(self, cues=tuple(cues.items()))
        changed: dict[str, Any] = {factor: value}
        return replace(self, **changed)

    def imposed_on(self, model: TeacherModel) -> TeacherModel:
        """`model` with these cues and this rest, and no delay or decay but what the structure frees."""
        tops = {
            state: replace(
                model.approvals[state],
                cue=cue,
                delay=0.0 if self.delay == NONE else model.approvals[state].delay,
                decay=None if self.decay == NONE else model.approvals[state].decay,
            )
            for state, cue in self.cues
        }
        return replace(model, approvals=tops, rest=self.rest)

    def settings(self, settings: Settings) -> Settings:
        """`settings` of a fit that learns what the structure frees."""
        freedom: dict[str, Freedom] = {NONE: False, SHARED: "shared", PER_STATE: True}
        return replace(settings, delays=freedom[self.delay], decays=freedom[self.decay])

    def beside(self, other: Self) -> str:
        """How it differs from another, in words.

        >>> intuitive = Structure.of(TeacherModel.intuitive())
        >>> intuitive.with_value("cue of that_wrt", "wrt_lit").with_value("rest", 0.5).beside(intuitive)
        'that_wrt by wrt_lit, rest 0.5 s'
        """
        changed = [factor for factor in self.factors if self.value(factor) != other.value(factor)]
        parts = [
            f"{factor.removeprefix(CUE_OF)} by {self.value(factor)}"
            if factor.startswith(CUE_OF)
            else f"{factor} {spoken(self.value(factor))}"
            for factor in changed
        ]
        return ", ".join(parts) or "the same"

    def __str__(self) -> str:
        parts = [", ".join(cue for _, cue in self.cues)]
        parts += [f"{name} {value}" for name in ("delay", "decay") if (value := getattr(self, name)) != NONE]
        return "; ".join(parts + ([f"rest {self.rest:g} s"] if self.rest else []))


def spoken(value: Value) -> str:
    """A value in words: seconds where it is a number."""
    return value if isinstance(value, str) else f"{value:g} s"


def _sharing(values: set[float] | set[float | None], absent: float | None) -> str:
    if values == {absent}:
        return NONE
    return SHARED if len(values) == 1 else PER_STATE


def alternatives(
    structure: Structure, factor: str, cue_names: Sequence[str], rests: Sequence[float]
) -> tuple[Structure, ...]:
    """The structures that differ in one factor at most, the structure itself among them.

    No cue drives two states: their table-tops could not be told apart.
    """
    if factor == "rest":
        values: list[Value] = sorted({structure.rest, *rests})
    elif factor in ("delay", "decay"):
        values = [*SHARINGS]
    else:
        taken = {cue for _, cue in structure.cues} - {structure.value(factor)}
        values = [cue for cue in cue_names if cue not in taken]
    return tuple(structure.with_value(factor, value) for value in values)


def beginnings(structure: Structure, base: TeacherModel, model: TeacherModel, step: float) -> list[Floats]:
    """Where to begin a fit of `structure`, given a `model` fitted to one that differs in a factor.

    Natural parameters, (1 + 6 M,) each: those of `model`, varied in what it does not share with the
    structure. `base` is the model that the fit takes its fixed parameters from, `step` a step in seconds.
    """
    before = Structure.of(model)
    states = len(structure.cues)
    vector = vector_of(model)
    rows = vector[1:].reshape(len(NAMES), states)
    if structure.decay == NONE:
        rows[4] = vector_of(base)[1:].reshape(len(NAMES), states)[4]
    varied = [rows]
    for m, (state, cue) in enumerate(structure.cues):
        if cue != dict(before.cues)[state]:
            pairs = [(rise, fall) for rise in (step, 3 * step, 8 * step) for fall in (2 * step, 6 * step)]
            varied += [_with(rows, {1: rise, 2: fall}, [m]) for rise, fall in pairs]
    everywhere = list(range(states))
    if structure.delay != before.delay and structure.delay != NONE:
        varied += [_with(rows, {3: late * step}, everywhere) for late in (0.3, 0.6, 1.2, 2.0)]
    if structure.decay != before.decay and structure.decay != NONE:
        varied += [_with(rows, {4: fade * step}, everywhere) for fade in (3.0, 6.0, 12.0, 40.0, 120.0)]
    return [np.concatenate([vector[:1], each.ravel()]) for each in varied]


def _with(rows: Floats, values: dict[int, float], states: Sequence[int]) -> Floats:
    other = rows.copy()
    for row, value in values.items():
        other[row, list(states)] = value
    return other
