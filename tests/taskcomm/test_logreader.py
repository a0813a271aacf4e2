"""What a crash leaves is read; what is wrong is named with file, line and reason."""

import gzip
import re
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from logsamples import Lines, dump, lines_of, played

from taskcomm.logs import (
    LogError,
    TornLogWarning,
    log_files,
    read_trials,
    trial_bytes,
    validate,
    write_trials,
)
from taskcomm.world import BallWorld

# What a crash leaves


@settings(max_examples=30)
@given(cut=st.integers(0, 10**6))
@example(cut=0)
@example(cut=len(trial_bytes(replace(played("schön"), participant_id="ü")).splitlines()[1]))
@example(cut=len(trial_bytes(replace(played("schön"), participant_id="ü")).splitlines()[1]) + 1)
def test_a_torn_last_line_is_dropped_with_a_warning(
    tmp_path_factory: pytest.TempPathFactory, cut: int
) -> None:
    trial = replace(played("schön"), participant_id="ü")
    full = trial_bytes(trial)
    first = full.index(b"\n") + 1
    content = full[: first + cut % (len(full) - first - 1)]
    number = content.count(b"\n") + 1
    torn = not content.endswith(b"\n") and full[len(content)] != ord("\n")
    whole = full[: len(content) + 1].count(b"\n")
    path = tmp_path_factory.mktemp("logs") / "torn.jsonl"
    path.write_bytes(content)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        (read,) = read_trials(path)
    assert [(w.category, str(w.message)) for w in caught] == (
        [(TornLogWarning, f"{path}:{number}: torn last line, dropped")] * torn
    )
    assert read.steps == trial.steps[: whole - 1]
    assert read.reason is None
    assert read.correct is None
    notices = [notice.reason for notice in validate(path).notices]
    assert notices[-1] == f"trial 'schön' broke off after {read.num_steps} steps"


def test_a_last_line_that_is_whole_but_wrong_is_not_taken_for_torn(tmp_path: Path) -> None:
    path = tmp_path / "wrong.jsonl"
    path.write_bytes(trial_bytes(played()) + b'{"type": "step"}')
    with pytest.raises(LogError, match=r"wrong.jsonl:8: step line: `trial_id` is missing"):
        read_trials(path)


def test_a_file_with_a_torn_line_only_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "torn.jsonl"
    path.write_bytes(trial_bytes(played())[:40])
    with pytest.raises(LogError, match=r"torn.jsonl: no trial in it"):
        read_trials(path)


# What is wrong is named

Change = Callable[[Lines], Any]


def _swap(lines: Lines) -> None:
    lines[2], lines[3] = lines[3], lines[2]


def _set(number: int, **fields: Any) -> Change:
    return lambda lines: lines[number].update(fields)


def _drop(number: int, key: str) -> Change:
    return lambda lines: lines[number].pop(key)


WRONG: dict[str, tuple[Change, str]] = {
    "another major version": (
        _set(0, schema="taskcomm.trial/2"),
        r":1: schema: this version of taskcomm reads 'taskcomm.trial/1', not 'taskcomm.trial/2'",
    ),
    "no version": (_drop(0, "schema"), r":1: schema: expected 'taskcomm.trial/1', got None"),
    "another schema": (_set(0, schema="nwb/2"), r":1: schema: expected 'taskcomm.trial/1', got 'nwb/2'"),
    "no trial_start": (lambda lines: lines.pop(0), r":1: trial 'a' has no trial_start line before this step"),
    "a line is missing": (lambda lines: lines.pop(2), r":3: seq: 3 where 2 was due; lines are missing"),
    "lines out of order": (_swap, r":3: seq: 3 where 2 was due"),
    "steps out of order": (_set(3, t=4), r":4: t: 4 where 2 was due; steps are missing or out of order"),
    "a step too many": (_set(6, type="step"), r":7: step line: `t` is missing"),
    "an action that is not valid": (
        _set(4, action={"name": "slide", "ball": 1, "distance": 2, "reference": 2}),
        r":5: action: slide\(1, 2, 2\) is not valid in BallState",
    ),
    "an unknown action": (_set(1, action={"name": "sing"}), r":2: action: sing is not valid in"),
    "an action without arguments": (_set(1, action={"name": "light_on"}), r":2: action: light_on is not"),
    "an action with text for a number": (
        _set(1, action={"name": "light_on", "ball": "1"}),
        r":2: step line: action.ball: expected `int \| null`, got `str`",
    ),
    "press as a number": (_set(1, press=1), r":2: step line: press: expected `bool \| null`, got `int`"),
    "an unknown source of action": (_set(1, action_source="cat"), r":2: step line: action_source: invalid"),
    "a card that does not fit": (
        _set(0, task={"mov": 1, "wrt": 1, "dist": 2}),
        r":1: task card: \{'mov': 1, 'wrt': 1, 'dist': 2\} is none of the 24 tasks",
    ),
    "a card of another world": (_set(0, task={"name": "soup"}), r":1: task card: \{'name': 'soup'\} is none"),
    "a world that cannot be": (
        _set(0, world={"num_balls": 1, "num_distances": 4}),
        r":1: world: num_balls must be a whole number of at least 2, not 1",
    ),
    "a world without sizes": (_set(0, world={"num_balls": 3}), r":1: world: num_distances is missing"),
    "a world too large": (
        _set(0, world={"num_balls": 10**9, "num_distances": 4}),
        r":1: world: .* has more than 100000 tasks",
    ),
    "slides of no kind": (
        _set(0, world={"num_balls": 3, "num_distances": 4, "slide_unheld": 1}),
        r":1: world: slide_unheld must be true or false, not 1",
    ),
    "dt of 0": (_set(0, dt=0), r":1: trial_start line: dt: expected `float` > 0"),
    "no dt": (_drop(0, "dt"), r":1: trial_start line: `dt` is missing"),
    "an unknown origin": (_set(0, source="dream"), r":1: trial_start line: source: invalid enum value"),
    "no id": (_drop(3, "trial_id"), r":4: step line: `trial_id` is missing"),
    "no type": (_drop(3, "type"), r":4: not a line of a trial log: `type` is missing"),
    "a negative seq": (_set(3, seq=-1), r":4: step line: seq: expected `int` >= 0"),
    "an unknown line out of order": (_set(3, type="new", seq=9), r":4: seq: 9 where 3 was due"),
    "an unknown line without seq": (
        lambda lines: (lines[3].update(type="new"), lines[3].pop("seq")),
        r":4: new line: `seq` is missing",
    ),
    "a wrong count": (_set(6, num_steps=4), r":7: num_steps: 4, but the trial has 5 steps"),
    "a wrong verdict": (_set(6, correct=False), r":7: correct: False, but card and displayed task say True"),
    "an end that shows nothing": (_set(6, displayed=None), r":7: displayed: a trial that ends as 'final'"),
    "a timeout that shows a task": (_set(6, reason="timeout"), r":7: displayed: .*'timeout' shows no task"),
    "a display that is no task": (
        _set(6, displayed={"mov": 9, "wrt": 1, "dist": 1}),
        r":7: displayed: \{'mov': 9, 'wrt': 1, 'dist': 1\} is none of the 24 tasks",
    ),
    "an unknown reason": (_set(6, reason="tired"), r":7: trial_end line: reason: invalid enum value 'tired'"),
    "two ends": (
        lambda lines: lines.append(lines[6] | {"seq": 7}),
        r":8: trial_end: the trial has ended before",
    ),
    "a step after the end": (
        lambda lines: lines.append(lines[5] | {"seq": 7, "t": 5}),
        r":8: step: it comes after the end",
    ),
    "a label of no press": (
        lambda lines: lines.append(
            {"type": "label", "trial_id": "a", "seq": 7, "press_seq": 1, "mental_state": "mistake"}
        ),
        r":8: press_seq: line 1 of this trial is no step with a press",
    ),
    "the same trial twice": (
        lambda lines: lines.extend([dict(line) for line in lines]),
        r":8: trial 'a' is there twice, first in .*bad.jsonl:1",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_named_with_file_line_and_reason(tmp_path: Path, name: str) -> None:
    change, message = WRONG[name]
    lines = lines_of(played())
    change(lines)
    path = dump(tmp_path / "bad.jsonl", lines)
    with pytest.raises(LogError) as raised:
        read_trials(path)
    assert re.match(re.escape(str(path)) + f"(?:{message})", str(raised.value)), str(raised.value)
    assert "\n" not in str(raised.value)
    report = validate(path)
    assert not report.ok
    assert str(report.problems[0]) == str(raised.value)


BYTES: dict[str, tuple[bytes, str]] = {
    "empty": (b"", r"empty: a log holds at least one line"),
    "blank": (b"\n \n", r"empty: a log holds at least one line"),
    "prose": (b"Dear diary,\n", r":1: not JSON: "),
    "a table": (b"trial_id,t,press\na,0,1\n", r":1: not JSON: "),
    "numbers": (b"1\n2\n", r":1: not a line of a trial log: it must be a JSON object"),
    "another log": (b'{"event": "start"}\n', r":1: not a line of a trial log: `type` is missing"),
    "UTF-16": ("{}\n".encode("utf-16"), r":1: not UTF-8 text"),
    "Latin-1": (b'{"type": "step", "trial_id": "\xe9"}\n', r":1: not UTF-8 text"),
    "NaN": (b'{"type": "step", "trial_id": "a", "seq": NaN}\n', r":1: not JSON: "),
    "deep nesting": (b"[" * 10**5 + b"\n", r":1: not JSON"),
    "torn gzip": (gzip.compress(b"{}\n" * 99)[:-12], r"its gzip data cannot be unpacked: "),
    "broken gzip": (gzip.compress(b"{}\n" * 99)[:12] + b"\0\1\2" * 9, r"its gzip data cannot be unpacked: "),
}


@pytest.mark.parametrize("name", BYTES)
def test_what_is_no_log_is_refused(tmp_path: Path, name: str) -> None:
    content, message = BYTES[name]
    path = tmp_path / "größe.jsonl"
    path.write_bytes(content)
    with pytest.raises(LogError, match=rf"größe.jsonl:? ?{message}"):
        read_trials(path)
    assert not validate(path).ok


def test_what_is_not_there_or_no_gzip_is_refused(tmp_path: Path) -> None:
    (tmp_path / "plain.jsonl.gz").write_bytes(trial_bytes(played()))
    with pytest.raises(LogError, match=r"plain.jsonl.gz: not a gzip file"):
        read_trials(tmp_path / "plain.jsonl.gz")
    with pytest.raises(LogError, match=r"none.jsonl: no such file"):
        read_trials(tmp_path / "none.jsonl")
    (tmp_path / "nothing").mkdir()
    with pytest.raises(LogError, match=r"nothing: no \*.jsonl or \*.jsonl.gz file in this folder"):
        log_files(tmp_path / "nothing")
    with pytest.raises(LogError, match="no log was given"):
        read_trials([])


def test_the_same_trial_in_two_files_is_refused(tmp_path: Path) -> None:
    for name in ("one", "two"):
        write_trials([played()], tmp_path / f"{name}.jsonl")
    with pytest.raises(LogError, match=r"two.jsonl:1: trial 'a' is there twice, first in .*one.jsonl:1"):
        read_trials(tmp_path)


def test_a_log_of_another_ball_world_than_the_one_given_is_refused(tmp_path: Path) -> None:
    write_trials([played()], tmp_path / "a.jsonl")
    with pytest.raises(LogError, match=r"a.jsonl:1: world: the log is of BallWorld\(num_balls=3"):
        read_trials(tmp_path / "a.jsonl", world=BallWorld(num_balls=4))


def test_validate_lists_one_problem_for_every_trial_that_is_spoilt(tmp_path: Path) -> None:
    logs = [lines_of(played(name)) for name in "abcd"]
    logs[0][3]["t"] = 7
    logs[1].pop(0)
    logs[3][0]["task"] = {"mov": 1, "wrt": 2, "dist": 9}
    path = dump(tmp_path / "many.jsonl", [line for lines in logs for line in lines])
    (tmp_path / "empty.jsonl").write_bytes(b"")
    report = validate(tmp_path)
    assert [re.sub(r"^.*/", "", str(problem)) for problem in report.problems] == [
        "empty.jsonl: empty: a log holds at least one line",
        "many.jsonl:4: t: 7 where 2 was due; steps are missing or out of order",
        "many.jsonl:8: trial 'b' has no trial_start line before this step line",
        "many.jsonl:21: task card: {'mov': 1, 'wrt': 2, 'dist': 9} is none of the 24 tasks of this world",
    ]
    assert (report.trials, report.steps) == (1, 5)
    assert report.files == (str(tmp_path / "empty.jsonl"), str(path))


def test_a_trial_that_is_there_twice_is_one_problem_and_did_not_break_off(tmp_path: Path) -> None:
    lines = lines_of(played())
    report = validate(dump(tmp_path / "twice.jsonl", [*lines[:-1], *lines]))
    assert [problem.line for problem in report.problems] == [len(lines)]
    assert report.notices == ()


@settings(max_examples=150)
@given(st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 255)), min_size=1, max_size=4))
def test_no_damage_gives_anything_but_trials_or_a_log_error(
    tmp_path_factory: pytest.TempPathFactory, damage: list[tuple[int, int]]
) -> None:
    content = bytearray(trial_bytes(played()))
    for place, byte in damage:
        content[place % len(content)] = byte
    path = tmp_path_factory.mktemp("logs") / "damaged.jsonl"
    path.write_bytes(bytes(content))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", TornLogWarning)
        try:
            read_trials(path)
            fit = True
        except LogError:
            fit = False
        report = validate(path)
    assert report.ok is fit
    assert all(problem.path == str(path) for problem in report.problems)
