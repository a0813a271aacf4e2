"""Trial logs: what is written is read again, and what could not be is not written."""

import gzip
import re
import stat
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from logsamples import dump, lines_of, played, trials
from tinyworld import Menu

from taskcomm.logs import (
    LogError,
    read_trials,
    trial_bytes,
    validate,
    write_trials,
)
from taskcomm.observation import Signals
from taskcomm.trials import Step, Trial
from taskcomm.wholefile import OutputError
from taskcomm.world import NOA, BallWorld

# What is written is read again


@settings(max_examples=40)
@given(st.lists(trials(), min_size=1, max_size=2, unique_by=lambda trial: trial.trial_id), st.booleans())
def test_reading_gives_the_trials_that_were_written(
    tmp_path_factory: pytest.TempPathFactory, written: list[Trial], packed: bool
) -> None:
    path = tmp_path_factory.mktemp("logs") / ("é ü.jsonl.gz" if packed else "é ü.jsonl")
    write_trials(written, path)
    again = read_trials(path)
    assert again == written
    assert [trial.states for trial in again] == [trial.states for trial in written]
    assert [trial.reasons for trial in again] == [trial.reasons for trial in written]
    assert b"".join(map(trial_bytes, again)) == b"".join(map(trial_bytes, written))
    report = validate(path)
    assert report.ok
    assert (report.trials, report.steps) == (len(written), sum(trial.num_steps for trial in written))


def test_keys_that_were_not_recorded_and_signals_are_kept_apart_from_no_press_and_no_signal(
    tmp_path: Path,
) -> None:
    kinds: list[tuple[bool | None, Signals | None]] = [
        (True, {"gaze": "2", "angle": -0.25}),
        (False, None),
        (None, {"gaze": "none"}),
        (None, {}),
    ]
    steps = tuple(Step(NOA, pressed, signals=signals) for pressed, signals in kinds)
    trial = Trial("a", BallWorld(), None, steps)
    write_trials([trial], tmp_path / "log.jsonl")
    (again,) = read_trials(tmp_path / "log.jsonl")
    assert [(step.pressed, step.signals) for step in again.steps] == kinds
    assert again.presses.tolist() == [True, False, False, False]
    assert again.recorded.tolist() == [True, True, False, False]
    assert again.signals("gaze") == ("2", None, "none", None)
    assert again.signals("angle") == (-0.25, None, None, None)
    assert again.channels == ("gaze", "angle")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"press": "no"}, r"press: expected `bool \| null`, got `str`"),
        ({"signals": {"gaze": True}}, r"signals.*: expected `float \| str`, got `bool`"),
        ({"signals": ["2"]}, r"signals: expected `object \| null`, got `array`"),
    ],
)
def test_a_key_or_a_signal_that_cannot_be_is_named_with_its_line(
    tmp_path: Path, change: dict[str, Any], reason: str
) -> None:
    lines = lines_of(played())
    lines[2] |= change
    with pytest.raises(LogError, match=rf"log.jsonl:3: step line: {reason}"):
        read_trials(dump(tmp_path / "log.jsonl", lines))


def test_no_label_can_be_put_on_a_step_whose_key_was_not_recorded(tmp_path: Path) -> None:
    lines = lines_of(Trial("a", BallWorld(), None, (Step(NOA, None),)))
    lines.append({"type": "label", "trial_id": "a", "seq": 2, "press_seq": 1, "mental_state": "mistake"})
    with pytest.raises(
        LogError, match=r"log.jsonl:3: press_seq: line 1 of this trial is no step with a press"
    ):
        read_trials(dump(tmp_path / "log.jsonl", lines))


@settings(max_examples=40)
@given(trials(world=Menu()))
def test_other_worlds_are_written_by_name_and_found_in_the_world_given(
    tmp_path_factory: pytest.TempPathFactory, trial: Trial
) -> None:
    path = tmp_path_factory.mktemp("logs") / "menu.jsonl"
    write_trials([trial], path)
    assert read_trials(path, world=Menu()) == [trial]
    with pytest.raises(LogError, match=r"menu.jsonl:1: world: the log is of a World named 'Menu', which"):
        read_trials(path)
    with pytest.raises(LogError, match=r"world: the log is of \{'name': 'Menu'\}, not of \{'name': 'Ball"):
        read_trials(path, world=BallWorld())


def test_a_step_line_reads_as_it_is_documented() -> None:
    lines = lines_of(played())
    assert lines[4] == {
        "type": "step",
        "trial_id": "a",
        "seq": 4,
        "t": 3,
        "action": {"name": "slide", "ball": 1, "distance": 4, "reference": 2},
        "action_source": "operator",
        "press": False,
        "mental_state": "waiting",
    }
    assert lines[0]["world"] == {"name": "BallWorld", "num_balls": 3, "num_distances": 4}
    assert lines[-1]["correct"] is True


def test_gzipped_bytes_hold_no_time_and_no_name(tmp_path: Path) -> None:
    write_trials([played()], tmp_path / "a.jsonl.gz")
    write_trials([played()], tmp_path / "b.jsonl.gz")
    packed = (tmp_path / "a.jsonl.gz").read_bytes()
    assert packed == (tmp_path / "b.jsonl.gz").read_bytes()
    assert packed[3:8] == bytes(5)  # no flags, no time
    assert gzip.decompress(packed) == trial_bytes(played())


def test_folders_files_and_several_of_them(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    write_trials([played("b")], tmp_path / "in" / "b.jsonl.gz")
    write_trials([played("a"), played("c")], tmp_path / "a.jsonl")
    (tmp_path / "notes.txt").write_text("nothing")
    assert [trial.trial_id for trial in read_trials(tmp_path)] == ["a", "c", "b"]
    both: list[str | Path] = [str(tmp_path / "in"), tmp_path / "a.jsonl"]
    assert [trial.trial_id for trial in read_trials(both)] == ["b", "a", "c"]


def test_lines_of_several_trials_may_take_turns(tmp_path: Path) -> None:
    pairs = zip(lines_of(played("a")), lines_of(played("b")), strict=True)
    path = dump(tmp_path / "two.jsonl", [line for pair in pairs for line in pair])
    assert read_trials(path) == [played("a"), played("b")]


def test_of_each_annotator_the_last_label_of_a_press_counts_and_then_what_most_say(tmp_path: Path) -> None:
    def read(*said: tuple[str | None, str]) -> Trial:
        lines = lines_of(played())
        for annotator, state in said:
            label = {"press_seq": 2, "mental_state": state, "annotator": annotator, "utc": "2026-11-22"}
            lines.append({"type": "label", "trial_id": "a", "seq": len(lines), **label})
        path = dump(tmp_path / "labelled.jsonl", lines)
        assert not validate(path).notices
        return read_trials(path)[0]

    again = read(("ann", "mistake"), ("bob", "that_wrt"), ("ann", "that_wrt"))
    assert again.labelled == {1: {"ann": "that_wrt", "bob": "that_wrt"}}
    assert again.reasons == {1: "that_wrt", 4: "that_mov"}
    most = read(("ann", "mistake"), ("bob", "that_wrt"), ("cleo", "mistake"), (None, "that_mov"))
    assert most.reasons[1] == "mistake"
    split = read(("ann", "mistake"), ("bob", "that_wrt"))
    assert split.reasons == {4: "that_mov"}


def test_unknown_keys_and_types_of_line_are_ignored_but_mentioned(tmp_path: Path) -> None:
    lines = lines_of(played())
    lines[2]["mood"] = "fine"
    lines.insert(3, {"type": "weather", "trial_id": "a", "sky": "blue"})
    lines.append({"type": "label", "trial_id": "a", "press_seq": 6, "mental_state": "that_dist"})
    for seq, line in enumerate(lines):
        line["seq"] = seq
    path = dump(tmp_path / "new.jsonl", lines)
    (trial,) = read_trials(path)
    assert replace(trial, labels=()) == played()
    assert trial.reasons == {1: "that_mov", 4: "that_dist"}
    assert read_rewritten(trial, tmp_path) == trial
    report = validate(path)
    assert report.ok
    assert [str(notice).removeprefix(str(path)) for notice in report.notices] == [
        ":3: key 'mood' of step lines is unknown and ignored",
        ":4: lines of type 'weather' are unknown and ignored",
    ]


def read_rewritten(trial: Trial, folder: Path) -> Trial:
    write_trials([trial], folder / "again.jsonl")
    return read_trials(folder / "again.jsonl")[0]


def test_a_byte_order_mark_windows_lines_and_a_missing_last_newline_do_no_harm(tmp_path: Path) -> None:
    path = tmp_path / "windows.jsonl"
    path.write_bytes(b"\xef\xbb\xbf" + trial_bytes(played()).replace(b"\n", b"\r\n").rstrip())
    assert read_trials(path) == [played()]


# Writing


def test_a_file_is_replaced_whole_or_left_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "a.jsonl"
    write_trials([played()], path)
    before = path.read_bytes()
    bad = replace(played("b"), steps=played().steps[::-1])
    with pytest.raises(
        LogError, match=r"trial 'b' cannot be written: line 3: action: slide\(1, 4, 2\) is not valid"
    ):
        write_trials([played("c"), bad], path)
    with pytest.raises(LogError, match="trial 'c' is there twice"):
        write_trials([played("c"), played("c")], path)
    with pytest.raises(LogError, match="no trials to write"):
        write_trials([], path)
    assert path.read_bytes() == before
    write_trials([played("d")], path)
    assert [trial.trial_id for trial in read_trials(path)] == ["d"]
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.jsonl"]


UNFIT: dict[str, tuple[Callable[[Trial], Trial], str]] = {
    "a source of no kind": (lambda t: replace(t, source="dream"), r"line 1: trial_start line: source: "),
    "a card of no kind": (lambda t: replace(t, task="soup"), r"line 1: task card: \{'name': 'soup'\}"),
    "a label of no press": (
        lambda t: replace(t, labels=({"press_seq": 1, "mental_state": "mistake"},)),
        r"line 8: press_seq: line 1 of this trial is no step with a press",
    ),
    "a rating of nothing": (lambda t: replace(t, ratings=({"value": 3},)), r"line 8: rating line: `item` is"),
    "a value that is no JSON": (
        lambda t: replace(t, events=({"x": object()},)),
        r"encoding objects of type object",
    ),
    "no time": (lambda t: replace(t, dt=float("inf")), r"line 1: trial_start line: dt: "),
    "a final that shows nothing": (lambda t: replace(t, displayed=None), r"line 7: displayed: "),
}


@pytest.mark.parametrize("name", UNFIT)
def test_what_could_not_be_read_again_is_not_written(tmp_path: Path, name: str) -> None:
    change, message = UNFIT[name]
    with pytest.raises(LogError, match=f"a.jsonl: trial 'a' cannot be written: (?i:{message})"):
        write_trials([change(played())], tmp_path / "a.jsonl")
    assert [*tmp_path.iterdir()] == []


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    (tmp_path / "folder").mkdir()
    for place in (tmp_path / "none" / "a.jsonl", tmp_path / "file" / "a.jsonl", tmp_path / "folder"):
        with pytest.raises(OutputError, match=rf"^{re.escape(str(place))}: cannot be written: "):
            write_trials([played()], place)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["file", "folder"]
    assert stat.S_ISDIR((tmp_path / "folder").stat().st_mode)


def test_a_disk_that_is_full_is_no_fault_of_the_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.jsonl"
    write_trials([played()], path)

    def full(self: Path, content: bytes) -> int:
        with self.open("wb") as file:
            file.write(content[: len(content) // 2])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OutputError, match=r"a\.jsonl: cannot be written: No space left on device$"):
        write_trials([played("b")], path)
    assert path.read_bytes() == trial_bytes(played())
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.jsonl"]


def test_places_that_clash_are_refused(tmp_path: Path) -> None:
    for seqs in ((2, 2), (0, 1), (1, 99)):
        events = tuple({"seq": seq} for seq in seqs)
        with pytest.raises(LogError, match="must have places of their own within the trial"):
            write_trials([replace(played(), events=events)], tmp_path / "a.jsonl")
