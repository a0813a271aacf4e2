"""What a design holds: the keys of `study.toml`, each with its bounds."""

import hashlib
from typing import Annotated, Literal

import msgspec
from msgspec import Meta, Struct

from taskcomm.web.study.reading import StudyError, matching, nearest
from taskcomm.world import BallWorld

INTUITIVE = "intuitive"
CERTAIN = 0.999999

Slug = Annotated[
    str, matching(r"[a-z0-9]+(-[a-z0-9]+)*", "small letters and digits, with single hyphens between", 60)
]
Word = Annotated[str, matching(r"[a-z][a-z0-9_-]*", "small letters, digits, - and _, a letter first", 40)]
Id = Annotated[str, matching(r"[A-Za-z0-9][A-Za-z0-9_-]*", "letters, digits, - and _, no blanks", 40)]
Language = Annotated[str, matching(r"[a-z]{2,3}(-[A-Z]{2})?", "a language as in en, de or pt-BR", 6)]
ModelName = Annotated[
    str,
    matching(
        r"intuitive|[A-Za-z0-9_][A-Za-z0-9._-]*\.json", "intuitive, or a file NAME.json of models/", 100
    ),
]
Seconds = Annotated[float, Meta(ge=0, le=3600)]


class DesignError(StudyError):
    """A design that cannot be: file, key, why."""


class _Part(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A part of a design."""


class Operators(_Part, frozen=True, kw_only=True):
    """The hidden human operators: `draw` of them are drawn from the `pool` at random.

    A pool that is a number (or left out) is everybody who takes part: who is drawn operates, the others
    teach, so it is teachers + draw. A pool of ids is of people who only operate.
    """

    draw: Annotated[int, Meta(ge=1, le=200)] = 1
    pool: Annotated[int, Meta(ge=2, le=2000)] | tuple[Id, ...] | None = None


class WorldDesign(_Part, frozen=True, kw_only=True):
    """The virtual world."""

    balls: Annotated[int, Meta(ge=2, le=6)] = 3
    distances: Annotated[int, Meta(ge=1, le=6)] = 4


class Condition(_Part, frozen=True, kw_only=True):
    """Who controls the robot. Model, horizon (steps) and threshold are the planner's.

    `model` is "intuitive" or the name of a file in the folder's models/.
    """

    name: Word
    controller: Literal["planner", "operator"]
    model: ModelName = INTUITIVE
    horizon: Annotated[int, Meta(ge=1, le=8)] = 5
    threshold: Annotated[float, Meta(ge=0.5, le=CERTAIN)] = 0.98


class Item(_Part, frozen=True, kw_only=True):
    """A question: a whole number from low to high, typed or on a scale; one of `choices`; or free text."""

    item: Word
    kind: Literal["integer", "scale", "choice", "text"]
    low: int | None = None
    high: int | None = None
    choices: tuple[Word, ...] = ()
    optional: bool = False


class Consent(_Part, frozen=True, kw_only=True):
    """Whether consent is asked for, and the version of its text, which is recorded with the answer."""

    ask: bool = True
    version: Annotated[str, Meta(min_length=1, max_length=40)] = "1"


class Timing(_Part, frozen=True, kw_only=True):
    """Seconds: a step, the longest trial, the countdown before it; how long a trial goes on without the
    teacher's connection (`grace`), and how long it then waits before it is given up (`away`)."""

    step: Annotated[float, Meta(ge=0.05, le=5)] = 0.5
    limit: Annotated[float, Meta(ge=1, le=3600)] = 300.0
    countdown: Seconds = 3.0
    grace: Seconds = 2.0
    away: Seconds = 120.0


AGE = Item(item="age", kind="integer", low=18, high=120)
FAMILIARITY = Item(item="familiarity", kind="scale", low=1, high=7)
INTELLIGENCE = Item(item="intelligence", kind="scale", low=1, high=10)
RIGHT = Item(item="right", kind="choice", choices=("yes", "no"))
ROBOT = Condition(name="pomdp", controller="planner")
HUMAN = Condition(name="operator", controller="operator")


class Design(_Part, frozen=True, kw_only=True):
    """A study. Left out, every key is as in the paper's experiment, but for the operators.

    `practice` names the condition of a trial before those that count. `order` of the conditions is balanced
    over teachers, or as listed; `cards` are balanced over every task, or over those listed as [mov, wrt,
    dist], or drawn at random. `simulated`: the teachers are programs, and logs say so.
    """

    name: Slug
    title: Annotated[str, Meta(min_length=1, max_length=200)] = "Teaching a robot"
    description: Annotated[str, Meta(max_length=2000)] = ""
    language: Language = "en"
    seed: Annotated[int, Meta(ge=0, le=2**53)] = 0
    teachers: Annotated[int, Meta(ge=1, le=1000)] = 22
    simulated: bool = False
    operators: Operators | None = None
    world: WorldDesign = WorldDesign()
    conditions: Annotated[tuple[Condition, ...], Meta(min_length=1, max_length=6)] = (ROBOT,)
    practice: Word | None = None
    order: Literal["balanced random", "fixed"] = "balanced random"
    cards: Literal["balanced random", "random"] | tuple[tuple[int, int, int], ...] = "balanced random"
    consent: Consent = Consent()
    instructions: bool = True
    questionnaire: tuple[Item, ...] = (AGE, FAMILIARITY)
    ratings: tuple[Item, ...] = (INTELLIGENCE, RIGHT)
    timing: Timing = Timing()
    operator_sees_card: bool = False
    annotators: tuple[Id, ...] = ("annotator-1",)

    @property
    def ball_world(self) -> BallWorld:
        """The World of every trial."""
        return BallWorld(self.world.balls, self.world.distances)

    @property
    def max_steps(self) -> int:
        """Steps after which a trial is a timeout."""
        return max(1, round(self.timing.limit / self.timing.step))

    @property
    def has_operators(self) -> bool:
        """Whether somebody sits at the operator's page."""
        return self.operators is not None

    @property
    def source(self) -> Literal["simulated", "human"]:
        """What the logs say of the teachers."""
        return "simulated" if self.simulated else "human"

    @property
    def models(self) -> tuple[str, ...]:
        """The models of planners by name, each once."""
        planners = (condition for condition in self.conditions if condition.controller == "planner")
        return tuple(dict.fromkeys(condition.model for condition in planners))

    @property
    def sha256(self) -> str:
        """Hash of what the design says, whatever its file looks like."""
        return hashlib.sha256(msgspec.json.encode(self, order="deterministic")).hexdigest()

    def condition(self, name: str) -> Condition:
        """The condition of that name; DesignError where there is none."""
        for condition in self.conditions:
            if condition.name == name:
                return condition
        known = [condition.name for condition in self.conditions]
        raise DesignError(f"{name!r} is no condition of the design{nearest(name, known)}")
