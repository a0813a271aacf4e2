"""The shipped JSON Schema and the reader say the same of every line."""

import copy
import json
from importlib.resources import files
from typing import Any

import jsonschema  # type: ignore[import-untyped]
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from taskcomm.loglines import TYPES, LineError, decode, json_schema, structure

SHIPPED = json.loads(files("taskcomm").joinpath("schemas/trial.schema.json").read_text(encoding="utf-8"))
VALIDATOR = jsonschema.Draft202012Validator(SHIPPED)

HEAD = {"trial_id": "a", "seq": 3}
TASK = {"mov": 1, "wrt": 2, "dist": 4}
LINES: list[dict[str, Any]] = [
    {
        "type": "trial_start",
        "schema": "taskcomm.trial/1",
        "taskcomm_version": "0.1.0",
        "participant_id": None,
        "operator_id": "x",
        "session": None,
        "trial_index": 0,
        "condition": "pomdp",
        "world": {"num_balls": 3, "num_distances": 4},
        "dt": 0.5,
        "task": TASK,
        "robot_model": {"name": "intuitive", "sha256": "0"},
        "planner": {"horizon": 5, "threshold": 0.98, "seed": None},
        "started_utc": None,
        "source": "simulated",
    },
    {
        "type": "step",
        "t": 0,
        "action": {"name": "slide", "ball": 1, "distance": 4, "reference": 2},
        "action_source": "planner",
        "press": True,
        "timing": {"onset": 1.5, "late_ms": 2},
        "mental_state": "that_mov",
    },
    {
        "type": "step",
        "t": 1,
        "action": {"name": "noa"},
        "action_source": "default",
        "press": None,
        "signals": {"gaze": "2", "angle": -0.5},
    },
    {"type": "event", "name": "keydown", "time": 3.25},
    {"type": "rating", "item": "intelligence", "value": 9, "scale": [1, 10]},
    {"type": "resume"},
    {"type": "trial_end", "reason": "final", "displayed": TASK, "correct": True, "num_steps": 3},
    {"type": "label", "press_seq": 2, "mental_state": "mistake", "annotator": None},
    {"type": "weather", "sky": "blue"},
]
# No float that is a whole number: JSON Schema takes 1.0 for an integer, the reader does not.
values = st.recursive(
    st.sampled_from(
        [None, True, False, -1, 0, 1, 7, 0.5, -0.5, "", "a", "final", "step", "taskcomm.trial/1.2"]
    ),
    lambda inner: (
        st.lists(inner, max_size=2) | st.dictionaries(st.sampled_from(["name", "ball", "x"]), inner)
    ),
    max_leaves=3,
)


def reader_takes(document: Any) -> bool:
    try:
        structure(decode(json.dumps(document).encode()))
    except LineError:
        return False
    return True


def places(document: Any, at: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    inner = document.items() if isinstance(document, dict) else ()
    return [at, *(place for key, value in inner for place in places(value, (*at, key)))]


def mutated(document: Any, place: tuple[Any, ...], value: Any, drop: bool) -> Any:
    if not place:
        return value
    document = copy.deepcopy(document)
    inner = document
    for key in place[:-1]:
        inner = inner[key]
    if drop:
        del inner[place[-1]]
    else:
        inner[place[-1]] = value
    return document


def test_the_shipped_schema_is_the_one_of_the_lines() -> None:
    jsonschema.Draft202012Validator.check_schema(SHIPPED)
    assert json_schema() == SHIPPED


@pytest.mark.parametrize("line", LINES, ids=lambda line: line["type"])
def test_schema_and_reader_take_every_kind_of_line(line: dict[str, Any]) -> None:
    assert VALIDATOR.is_valid(HEAD | line)
    assert reader_takes(HEAD | line)


def test_every_type_of_line_is_among_them() -> None:
    assert {line["type"] for line in LINES} == {*TYPES, "weather"}


@settings(max_examples=400)
@given(st.sampled_from(LINES), st.data(), values, st.booleans())
def test_schema_and_reader_agree_on_changed_lines(
    line: dict[str, Any], data: st.DataObject, value: Any, drop: bool
) -> None:
    place = data.draw(st.sampled_from(places(HEAD | line)))
    changed = mutated(HEAD | line, place, value, drop)
    assert VALIDATOR.is_valid(changed) is reader_takes(changed)


@settings(max_examples=200)
@given(st.dictionaries(st.sampled_from(["type", "trial_id", "seq", "schema", "t", "press", "x"]), values))
def test_schema_and_reader_agree_on_other_objects(document: dict[str, Any]) -> None:
    assert VALIDATOR.is_valid(document) is reader_takes(document)
