"""A study.toml: what is in it is what is meant, and anything else is one error with file, key and reason."""

from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskcomm.web.study.design import (
    Condition,
    Consent,
    Design,
    DesignError,
    Item,
    Operators,
    Timing,
    WorldDesign,
    load,
    parsed,
)
from taskcomm.web.study.folder import template
from taskcomm.web.study.structure import HUMAN, ROBOT
from taskcomm.web.study.tomlwriting import amended, toml_of
from taskcomm.world import BallWorld

WORDS = st.from_regex(r"[a-z][a-z0-9_-]{0,12}", fullmatch=True)
TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=40)


@st.composite
def designs(draw: st.DrawFn) -> Design:
    """Any design that can be."""
    teachers = draw(st.integers(1, 40))
    operated = draw(st.booleans())
    draws = draw(st.integers(1, min(teachers, 5)))
    pool = draw(st.sampled_from([None, teachers + draws, tuple(f"h{n}" for n in range(draws + 2))]))
    names = draw(st.lists(WORDS, min_size=1, max_size=3, unique=True))
    conditions = [
        Condition(name=name, controller="planner", horizon=draw(st.integers(1, 8)), threshold=0.9)
        for name in names
    ]
    conditions += [Condition(name="by-hand", controller="operator")] if operated else []
    items = draw(st.lists(WORDS, max_size=3, unique=True))
    return Design(
        name=draw(st.from_regex(r"[a-z0-9]{1,9}(-[a-z0-9]{1,9})?", fullmatch=True)),
        title=draw(TEXT.filter(bool)),
        description=draw(TEXT),
        seed=draw(st.integers(0, 2**53)),
        teachers=teachers,
        operators=Operators(draw=draws, pool=pool) if operated else None,
        world=WorldDesign(balls=draw(st.integers(2, 6)), distances=draw(st.integers(1, 6))),
        conditions=tuple(conditions),
        practice=draw(st.sampled_from([None, names[0]])),
        cards=draw(st.sampled_from(["balanced random", "random", ((1, 2, 1), (2, 1, 1))])),
        questionnaire=tuple(Item(item=item, kind="text", optional=True) for item in items),
        ratings=(Item(item="right-", kind="choice", choices=("yes", "no")),),
        timing=Timing(limit=draw(st.integers(1, 600)) * 0.5 + 1),
        simulated=draw(st.booleans()),
    )


@given(designs())
def test_a_design_written_as_toml_reads_back_the_same(design: Design) -> None:
    assert parsed(toml_of(design)) == design


def test_the_shipped_design_is_the_papers_study() -> None:
    design = parsed(template())
    assert design == Design(
        name="robot-teaching",
        title="Teaching a robot",
        seed=2012,
        teachers=22,
        operators=Operators(pool=26, draw=4),
        conditions=(ROBOT, HUMAN),
        practice="pomdp",
    )
    assert design.ball_world == BallWorld(3, 4)
    assert (design.timing.step, design.max_steps, design.source) == (0.5, 600, "human")


def test_all_but_the_name_may_be_left_out() -> None:
    design = parsed('name = "pilot"')
    assert design == Design(name="pilot")
    assert [condition.name for condition in design.conditions] == ["pomdp"]
    assert [item.item for item in (*design.questionnaire, *design.ratings)] == [
        "age",
        "familiarity",
        "intelligence",
        "right",
    ]


OPERATED = '[[conditions]]\nname="o"\ncontroller="operator"\n'
BAD = {
    'title = "x"': "name is missing",
    'name = "a"\nteacher = 3': "teacher: is unknown; did you mean teachers?",
    'name = "a"\nxyzzy = 3': "xyzzy: is unknown; known are annotators, cards, ",
    'name = "a"\n[world]\nbals = 3': "world.bals: is unknown; did you mean balls?",
    'name = "a"\n[[conditions]]\nname = "p"\ncontroler = "planner"': "conditions[0].controler: is unknown;",
    'name = "A b"': "name: expected small letters and digits",
    'name = "a"\nteachers = 1001': "teachers: expected `int` <= 1000",
    'name = "a"\nteachers = 2.0': "teachers: expected `int`, got `float`",
    'name = "a"\nseed = true': "seed: expected `int`, got `bool`",
    'name = "a"\nlanguage = "../en"': "language: expected a language as in en",
    'name = "a"\norder = "fxed"': "order: 'fxed' is unknown; did you mean fixed?",
    'name = "a"\nconditions = []': "conditions: expected `array` of length >= 1",
    'name = "a"\npractice = "pompd"': "practice: 'pompd' is no condition; did you mean pomdp?",
    'name = "a"\ncards = [[1, 1, 2]]': "cards[0]: [mov, wrt, dist] are two balls of 1 to 3",
    'name = "a"\ncards = [[1, 2, 2], [1, 2, 2]]': "cards: [1, 2, 2] is there twice",
    'name = "a"\ncards = []': "cards: the list holds no card",
    'name = "a"\n[timing]\nstep = nan': "timing.step: expected `float` >= 0.05",
    'name = "a"\n[timing]\nlimit = 1e9': "timing.limit: expected `float` <= 3600.0",
    'name = "a"\n[timing]\nlimit = 1.2': "timing.limit: 1.2 s is no whole number of steps of 0.5 s",
    'name = "a"\n[timing]\ncountdown = 1.5': "timing.countdown: 1.5 s is no whole number of seconds",
    'name = "a"\n[timing]\ncountdown = 0\n[operators]\n[[conditions]]\nname = "p"\ncontroller = "planner"\n'
    + OPERATED: "timing.countdown: must be 1 s at least",
    'name = "a"\n' + OPERATED: "operators: is missing",
    'name = "a"\n[operators]\ndraw = 2': "operators: no condition is controlled by an operator",
    'name = "a"\n[operators]\ndraw = 4\npool = 22\n' + OPERATED: "operators.pool: 22 people of whom 4",
    'name = "a"\n[operators]\ndraw = 3\npool = ["x", "y"]\n' + OPERATED: "operators.draw: 3 from a pool of 2",
    'name = "a"\n[operators]\npool = ["x", "x"]\n' + OPERATED: "operators.pool: x is there twice",
    'name = "a"\nteachers = 2\n[operators]\ndraw = 3\n' + OPERATED: "operators.draw: 3 for 2 teachers",
    'name = "a"\n[operators]\n' + OPERATED + "horizon = 3": "conditions[0]: model, horizon and",
    'name = "a"\nquestionnaire = [{item="q", kind="scale", low=1}]': "questionnaire[0]: 'q' needs whole",
    'name = "a"\nquestionnaire = [{item="q", kind="scale", low=1, high=20}]': "questionnaire[0]: a scale",
    'name = "a"\nratings = [{item="q", kind="choice", choices=["y"]}]': "ratings[0]: 'q' needs two choices",
    'name = "a"\nratings = [{item="q", kind="text", low=1}]': "ratings[0]: 'q' is a text, which has no low",
    'name = "a"\nratings = [{item="age", kind="text"}]': "questionnaire and ratings: age is there twice",
    "name = ": "not TOML: ",
}  # fmt: skip


@pytest.mark.parametrize("text", BAD)
def test_a_design_that_cannot_be_is_one_error_with_file_key_and_reason(text: str, tmp_path: Path) -> None:
    path = tmp_path / "study.toml"
    path.write_text(text)
    with pytest.raises(DesignError) as error:
        load(path)
    assert str(error.value).startswith(f"{path}: {BAD[text]}")
    assert str(error.value).count(str(path)) == 1
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "model",
    ["../teacher.json", "/etc/passwd", "a/b.json", "..json/../x.json", ".hidden.json", "x.pkl", "x\n.json"],
)
def test_a_model_is_a_plain_file_name(model: str) -> None:
    with pytest.raises(
        DesignError, match=r"conditions\[0\]\.model: expected intuitive, or a file NAME\.json"
    ):
        parsed(
            toml_of(Design(name="a", conditions=(Condition(name="p", controller="planner", model=model),)))
        )


@given(st.text(max_size=80) | st.binary(max_size=80).map(lambda raw: raw.decode("latin-1")))
def test_any_text_is_a_design_or_a_design_error(text: str) -> None:
    try:
        design = parsed(text)
    except DesignError as error:
        said = str(error)
    else:
        said = f"study.toml: {design.name}"
    assert said.startswith("study.toml: ")


def test_a_file_that_is_not_text_or_not_there_is_said(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_bytes(b'name = "\xff"')
    with pytest.raises(DesignError, match=r"a\.toml: not UTF-8 text, from byte 8"):
        load(tmp_path / "a.toml")
    with pytest.raises(DesignError, match=r"b\.toml: cannot be read: No such file"):
        load(tmp_path / "b.toml")


def test_the_hash_is_of_what_the_design_says_not_of_its_file() -> None:
    design = parsed('name = "a"\nseed = 1')
    assert parsed('# other words\nseed = 1\nname = "a"\n').sha256 == design.sha256
    assert parsed('name = "a"\nseed = 2').sha256 != design.sha256


@pytest.mark.parametrize(
    ("changes", "operators"),
    [
        ({"teachers": 3}, Operators(draw=3)),
        ({"title": 'A \\1 "b" #'}, Operators(pool=26, draw=4)),
        ({"seed": 5, "language": "de"}, Operators(pool=26, draw=4)),
    ],
)
def test_keys_changed_keep_the_rest_and_the_comments(changes: dict[str, Any], operators: Operators) -> None:
    text = amended(template(), "study.toml", **changes)
    assert parsed(text) == msgspec.structs.replace(parsed(template()), operators=operators, **changes)
    assert "# The paper's study had 26 people" in text


def test_keys_that_are_not_on_a_line_of_their_own_are_changed_too() -> None:
    text = 'name = "a"\nteachers = 0x10\nconsent = { version = "2" }\n'
    changed = parsed(amended(text, "study.toml", teachers=3, seed=9))
    assert changed == Design(name="a", teachers=3, seed=9, consent=Consent(version="2"))
