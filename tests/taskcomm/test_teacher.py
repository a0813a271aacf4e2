"""The teacher model: errors that name the field, the same model back from its file, other step lengths."""

import json
import math
import pickle
import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import CUES, models

from taskcomm.levels import advance
from taskcomm.teacher import SCHEMA, ModelError, TableTop, TeacherModel

INTUITIVE = TeacherModel.intuitive()
TOP = TableTop(cue="mov_lit", peak=0.1, rise=2.0, fall=2.0)
NO_NUMBERS = [True, "0.1", None, [0.1], 1j]
NOT_FINITE = [math.nan, math.inf, -math.inf, 10**400]


def refused(field: str, make: Callable[[], Any]) -> str:
    """The message of the one error that names `field` first."""
    with pytest.raises(ModelError, match=rf"^{re.escape(field)}: ") as error:
        make()
    return str(error.value)


@pytest.mark.parametrize(
    ("field", "values"),
    [
        ("peak", [-0.1, 1.0, 1.5]),
        ("rise", [-1.0, 0.0]),
        ("fall", [-1.0, 0.0]),
        ("delay", [-0.5]),
        ("decay", [-1.0, 0.0]),
        ("hold", [-0.5]),
    ],
)
def test_an_impossible_table_top_is_an_error_that_names_the_field(field: str, values: list[float]) -> None:
    for value in [*values, *NO_NUMBERS, *NOT_FINITE]:
        if field == "decay" and value is None:
            continue
        changed: dict[str, Any] = {field: value}
        message = refused(field, partial(replace, TOP, **changed))
        assert repr(value) in message or f"{value:g}" in message


@pytest.mark.parametrize("cue", ["", None, 1, ["mov_lit"]])
def test_a_cue_is_a_name(cue: Any) -> None:
    refused("cue", lambda: TableTop(cue, 0.1, 2.0, 2.0))


@pytest.mark.parametrize(
    ("field", "values"),
    [("mistake", [-0.1, 0.0]), ("dt", [-0.5, 0.0]), ("rest", [-0.5])],
)
def test_an_impossible_model_is_an_error_that_names_the_field(field: str, values: list[float]) -> None:
    for value in [*values, *NO_NUMBERS, *NOT_FINITE]:
        changed: dict[str, Any] = {field: value}
        assert repr(value) in refused(field, partial(replace, INTUITIVE, **changed))


@pytest.mark.parametrize(
    "approvals", [{}, None, [TOP], {"": TOP}, {"waiting": TOP}, {"mistake": TOP}, {1: TOP}]
)
def test_approvals_map_names_of_approval_states(approvals: Any) -> None:
    refused("approvals", lambda: TeacherModel(0.005, approvals))


def test_an_approval_is_a_table_top() -> None:
    approvals: Any = {"that_mov": {"cue": "mov_lit", "peak": 0.1, "rise": 2.0, "fall": 2.0}}
    refused("approvals.that_mov", lambda: TeacherModel(0.005, approvals))


@pytest.mark.parametrize("field", ["rise", "fall"])
def test_rise_and_fall_are_at_least_a_step(field: str) -> None:
    slow: dict[str, Any] = {field: 0.5}
    fast: dict[str, Any] = {field: 0.49}
    assert TeacherModel(0.005, {"yes": replace(TOP, **slow)})
    refused(f"approvals.yes.{field}", lambda: TeacherModel(0.005, {"yes": replace(TOP, **fast)}))


@given(st.lists(st.floats(0.0, 0.99), min_size=1, max_size=5), st.floats(0.001, 0.999))
def test_mistake_and_peaks_sum_to_less_than_1(peaks: list[float], mistake: float) -> None:
    approvals = {f"that_{n}": replace(TOP, peak=peak) for n, peak in enumerate(peaks)}
    if mistake + sum(peaks) < 1:
        assert TeacherModel(mistake, approvals).mistake == mistake
    else:
        refused("mistake and peaks", lambda: TeacherModel(mistake, approvals))


def test_provenance_is_a_mapping() -> None:
    anything: Any = "a paper"
    refused("provenance", lambda: replace(INTUITIVE, provenance=anything))


def test_a_cue_the_world_lacks_is_an_error_that_names_it_and_those_there_are() -> None:
    message = refused("approvals.that_wrt.cue", lambda: INTUITIVE.parameters(["mov_lit", "mov_at_dist"]))
    assert "'wrt_lit_while_mov_held'; this world has mov_lit, mov_at_dist" in message


def changed(path: str, value: Any) -> str:
    """The intuitive model's file with the value at `path` replaced, or left out."""
    document = json.loads(INTUITIVE.to_json())
    *parents, last = path.split("/")
    place = document
    for name in parents:
        place = place[name]
    if value is ...:
        del place[last]
    else:
        place[last] = value
    return json.dumps(document)


@pytest.mark.parametrize(
    ("path", "value", "field"),
    [
        ("schema", "taskcomm.teacher/2", "schema"),
        ("schema", ..., "schema"),
        ("units", {"time": "minute", "probability": "per time step"}, "units"),
        ("dt", ..., "dt"),
        ("mistake", ..., "mistake"),
        ("approvals", ..., "approvals"),
        ("approvals", [], "approvals"),
        ("approvals", {}, "approvals"),
        ("approvals/that_mov", 3, "approvals.that_mov"),
        ("approvals/that_mov/peak", ..., "approvals.that_mov.peak"),
        ("approvals/that_mov/peak", -0.1, "approvals.that_mov.peak"),
        ("approvals/that_mov/peak", math.nan, "approvals.that_mov.peak"),
        ("approvals/that_mov/peak", 0.9, "mistake and peaks"),
        ("approvals/that_wrt/rise", "2 s", "approvals.that_wrt.rise"),
        ("approvals/that_wrt/fall", 0.1, "approvals.that_wrt.fall"),
        ("approvals/that_wrt/fal", 2.0, "approvals.that_wrt.fal"),
        ("approvals/that_dist/delay", True, "approvals.that_dist.delay"),
        ("approvals/that_dist/cue", 7, "approvals.that_dist.cue"),
        ("approvals/waiting", {"cue": "mov_lit", "peak": 0.1, "rise": 2, "fall": 2}, "approvals"),
        ("mistake", 0, "mistake"),
        ("rest", math.inf, "rest"),
        ("dt", "0.5", "dt"),
        ("hazard", 0.1, "hazard"),
        ("provenance", "a paper", "provenance"),
        ("provenance", None, "provenance"),
    ],
)
def test_a_wrong_model_file_is_an_error_that_names_the_field(path: str, value: Any, field: str) -> None:
    text = changed(path, value)
    told = refused(field, lambda: TeacherModel.from_json(text))
    assert told == refused(field, lambda: TeacherModel.from_dict(json.loads(text)))


def test_a_field_given_twice_is_an_error_that_names_it() -> None:
    text = INTUITIVE.to_json().replace('"mistake"', '"mistake": 0.3, "mistake"', 1)
    refused("mistake", lambda: TeacherModel.from_json(text))


@pytest.mark.parametrize("text", ["", "not json", '{"schema": ', "[1, 2]", "3", b"\xff\xfe", "[" * 100_000])
def test_what_is_no_json_object_is_an_error_that_says_so(text: str | bytes) -> None:
    with pytest.raises(ModelError, match=r"not JSON|one JSON object"):
        TeacherModel.from_json(text)


def test_a_wrong_file_is_named(tmp_path: Path) -> None:
    path = tmp_path / "früh.json"
    path.write_text(changed("mistake", -1), encoding="utf-8")
    with pytest.raises(ModelError, match=r"früh\.json: mistake: must be finite and above 0, not -1"):
        TeacherModel.load(path)


@given(models())
def test_the_file_gives_the_same_model_back(model: TeacherModel) -> None:
    back = TeacherModel.from_json(model.to_json())
    assert back == model
    assert back.sha256 == model.sha256
    assert hash(back) == hash(model)
    assert back.mental_states == model.mental_states
    assert back.to_json() == model.to_json()
    document = {"of several": model.to_dict()}
    assert TeacherModel.from_dict(document["of several"]) == model
    assert document == {"of several": json.loads(model.to_json())}
    assert pickle.loads(pickle.dumps(model)) == model


def test_the_file_says_what_it_is_and_where_it_came_from(tmp_path: Path) -> None:
    note = {"made_by": "eine Prüfung", "training": ["a" * 64], "log_likelihood": -12.5}
    model = replace(INTUITIVE, provenance=note)
    model.save(tmp_path / "модель.json")
    document = json.loads((tmp_path / "модель.json").read_text(encoding="utf-8"))
    assert (document["schema"], document["dt"]) == (SCHEMA, 0.5)
    assert document["units"] == {"time": "second", "probability": "per time step"}
    assert TeacherModel.load(tmp_path / "модель.json").provenance == note


def test_whole_numbers_and_a_missing_rest_are_read() -> None:
    document = json.loads(changed("rest", ...))
    document["approvals"]["that_mov"] = {"cue": "mov_lit", "peak": 0.1, "rise": 2, "fall": 2}
    assert TeacherModel.from_json(json.dumps(document)) == INTUITIVE


def test_saving_replaces_a_file_whole_or_leaves_it_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "model.json"
    INTUITIVE.save(path)
    before = path.read_bytes()
    other = replace(INTUITIVE, mistake=0.02)

    def disk_full(*_: Any, **__: Any) -> int:
        raise OSError("no space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", disk_full)
        with pytest.raises(OSError, match="no space left"):
            other.save(path)
    unsaid = replace(other, provenance={"what": object()})
    with pytest.raises(TypeError):
        unsaid.save(path)
    assert path.read_bytes() == before
    assert [item.name for item in tmp_path.iterdir()] == ["model.json"]
    other.save(str(path))
    assert TeacherModel.load(path) == other
    assert [item.name for item in tmp_path.iterdir()] == ["model.json"]


def test_a_place_that_is_no_file_is_one_error_that_names_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    for place, why in (
        (".", "it is a directory, not a file"),
        ("folder", "it is a directory, not a file"),
        ("nowhere/model.json", "there is no folder nowhere; make it first"),
    ):
        with pytest.raises(OSError, match=rf"^{re.escape(place)}: cannot be written: {why}$"):
            INTUITIVE.save(place)
    assert [item.name for item in tmp_path.iterdir()] == ["folder"]


@given(models(), st.data())
def test_the_hash_is_that_of_the_parameters(model: TeacherModel, data: st.DataObject) -> None:
    assert replace(model, provenance={"made_by": "someone else"}).sha256 == model.sha256
    state = data.draw(st.sampled_from(sorted(model.approvals)))
    top = model.approvals[state]
    others = [
        replace(model, mistake=model.mistake / 2),
        replace(model, rest=model.rest + 0.5),
        replace(model, dt=model.dt / 2),
        *(
            replace(model, approvals=dict(model.approvals) | {state: changed})
            for changed in (
                replace(top, peak=top.peak / 2 + 1e-9),
                replace(top, rise=top.rise + 0.1),
                replace(top, fall=top.fall + 0.1),
                replace(top, delay=top.delay + 0.1),
                replace(top, hold=top.hold + 0.1),
                replace(top, decay=6.0),
                replace(top, cue="another"),
            )
        ),
    ]
    hashes = {model.sha256, *(other.sha256 for other in others)}
    assert len(hashes) == 1 + len(others)
    assert model not in others


def test_a_negative_zero_is_zero() -> None:
    zero, negative = (TeacherModel(0.005, {"yes": replace(TOP, delay=delay)}) for delay in (0.0, -0.0))
    assert zero.sha256 == negative.sha256


def test_a_model_cannot_be_changed() -> None:
    approvals = dict(INTUITIVE.approvals)
    model = TeacherModel(0.005, approvals)
    approvals.clear()
    assert len(model.approvals) == 3
    for change in (
        lambda: setattr(model, "mistake", 0.1),
        lambda: setattr(model.approvals["that_mov"], "peak", 0.3),
        lambda: model.approvals.__setitem__("that_mov", TOP),  # type: ignore[index]
        lambda: model.parameters(CUES).peak.__setitem__(0, 0.3),
    ):
        with pytest.raises((AttributeError, ValueError)):
            change()


def test_the_intuitive_model_is_the_papers() -> None:
    assert (INTUITIVE.mistake, INTUITIVE.dt, INTUITIVE.rest) == (0.005, 0.5, 0.0)
    assert INTUITIVE.mental_states == ("waiting", "mistake", "that_mov", "that_wrt", "that_dist")
    cues = [top.cue for top in INTUITIVE.approvals.values()]
    assert cues == ["mov_lit", "wrt_lit_while_mov_held", "mov_at_dist"]
    assert {replace(top, cue="any") for top in INTUITIVE.approvals.values()} == {
        TableTop("any", peak=0.1, rise=2.0, fall=2.0, delay=0.0)
    }


@pytest.mark.parametrize(
    ("delay", "late"), [(0.0, (0, 0.0)), (0.3, (0, 0.6)), (0.5, (1, 0.0)), (1.9, (3, 0.8))]
)
def test_a_delay_is_whole_steps_and_a_part_of_one(delay: float, late: tuple[int, float]) -> None:
    parameters = TeacherModel(0.005, {"yes": replace(TOP, delay=delay)}).parameters(CUES)
    assert parameters.steps_late[0] == late[0]
    assert parameters.part_late[0] == pytest.approx(late[1], abs=1e-12)


def test_rounding_makes_no_part_of_a_step() -> None:
    """0.3 / 0.1 is a little under 3."""
    parameters = TeacherModel(0.005, {"yes": replace(TOP, delay=0.3)}, dt=0.1, rest=0.3).parameters(CUES)
    assert (parameters.steps_late[0], parameters.part_late[0], parameters.rest_steps) == (3, 0.0, 3)


def total(model: TeacherModel) -> float:
    return model.mistake + sum(top.peak for top in model.approvals.values())


@given(models(), st.floats(0.02, 3.0))
def test_at_another_dt_a_wait_at_full_levels_is_as_likely(model: TeacherModel, dt: float) -> None:
    other = model.with_dt(dt)
    wait, same = math.log1p(-total(model)) / model.dt, math.log1p(-total(other)) / dt  # per second
    assert same == pytest.approx(wait, rel=1e-9)
    for state, top in model.approvals.items():
        changed = other.approvals[state]
        assert changed.peak * model.mistake == pytest.approx(top.peak * other.mistake, rel=1e-9)
        kept = replace(changed, peak=top.peak, rise=top.rise, fall=top.fall)
        assert kept == top
        assert (changed.rise, changed.fall) == (max(top.rise, dt), max(top.fall, dt))
    assert (other.dt, other.rest) == (dt, model.rest)
    assert other.provenance["converted_from_dt"] == model.dt


def wait_from_rest(model: TeacherModel, time: float) -> float:
    """P(no press in `time` seconds) of a one-cue model whose cue comes on at the start."""
    parameters = model.parameters(["mov_lit"])
    level, on_time, on = np.zeros(1), np.zeros(1), np.ones(1, dtype=np.bool_)
    waited = 1.0
    for _ in range(round(time / model.dt)):
        level, on_time = advance(level, on_time, on, on, parameters)
        waited *= 1 - parameters.mistake - float(parameters.peak @ level)
    return waited


def test_at_another_dt_a_rising_level_is_nearly_but_not_quite_as_likely_to_wait() -> None:
    """Levels are sampled at the ends of steps: a coarser step sees a rising level too high."""
    model = TeacherModel(0.005, {"yes": TOP})
    waits = [wait_from_rest(model.with_dt(dt), 3.0) for dt in (0.5, 0.25, 0.125, 0.0625)]
    assert waits == sorted(waits)
    steps = np.diff(waits)
    assert 0.01 < steps[0] < 0.03
    np.testing.assert_allclose(steps[1:] / steps[:-1], 0.5, atol=0.05)  # first order in dt


@pytest.mark.parametrize("dt", [0.0, -0.5, math.nan, True, "0.5"])
def test_an_impossible_dt_to_convert_to_is_an_error(dt: Any) -> None:
    refused("dt", lambda: INTUITIVE.with_dt(dt))
