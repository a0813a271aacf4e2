"""The kept study of structures: how rows are read, what is counted, and what its claims came to."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest
from cuestudy import WORLD as CUES
from cuestudy import cue_trials

from learn.candidates import Structure
from learn.kept_rows import KeptRows
from learn.structure import search_structure
from learn.structure_figure import confusion_figure, told_figure
from learn.structure_study import HARDEST, REPEATS, Study, study_row, truths, wanted
from learn.structure_summary import (
    KINDS,
    OTHER,
    claim_rows,
    claims,
    confusion,
    difference_rows,
    label_of,
    read_rows,
)
from taskcomm.cueworld import intuitive_for

KEPT = Path(__file__).parents[2] / "notebooks" / "results" / "structure-study.csv"
INTUITIVE = "mov_lit, wrt_lit_while_mov_held, mov_at_dist"
NAMED = {
    "cue of that_mov": "mov_lit",
    "cue of that_wrt": "wrt_lit_while_mov_held",
    "cue of that_dist": "mov_at_dist",
    "rest": "0",
    "delay": "none",
    "decay": "none|shared",
}


def row(truth: str, chosen: str = INTUITIVE, trials: int = 22, **named: str) -> dict[str, str]:
    return {"truth": truth, "trials": str(trials), "chosen": chosen, **NAMED, **named}


def test_every_truth_is_wanted_as_often_as_asked_and_named_by_its_own_structure() -> None:
    assert set(HARDEST) == set(truths())
    studies = wanted({22: 3, 500: 1})
    assert len(studies) == len(set(studies)) == 4 * len(truths())
    assert studies[0] == ("delay + decay", 500, 0)
    for name, model in truths().items():
        if name != "teachers differ":
            assert label_of(str(Structure.of(model))) == name


@pytest.mark.parametrize(
    ("structure", "label"),
    [
        (f"{INTUITIVE}; delay per state", "delay"),
        (f"{INTUITIVE}; rest 0.5 s", "rest"),
        (f"{INTUITIVE}; delay shared; rest 0.5 s", OTHER),
        ("mov_lit, wrt_lit, mov_at_dist; decay shared", OTHER),
    ],
)
def test_a_structure_is_counted_with_the_truth_that_has_the_same_parts(structure: str, label: str) -> None:
    assert label_of(structure) == label


def test_claims_tell_open_right_and_wrong_apart() -> None:
    def claim(kind: str, row: Mapping[str, str]) -> tuple[bool, bool, bool]:
        (found,) = [c for c in claims([row]) if c.kind == kind]
        return found.holds, found.told, found.right

    assert claim("delay", row("delay")) == (False, True, False)
    assert claim("delay", row("delay", delay="shared|none")) == (True, False, False)
    assert claim("delay", row("delay", delay="shared|per state")) == (True, True, True)
    assert claim("delay", row("delay", delay="per state")) == (False, True, True)
    assert claim("delay", row("intuitive")) == (True, True, True)
    assert claim("rest", row("rest", rest="0.5|1")) == (True, True, True)
    assert claim("rest", row("rest", rest="0.5|0")) == (False, False, False)
    wrong = [c for c in claims([row("wrt_lit")]) if c.kind == "cue" and not c.holds]
    assert len(wrong) == 1


def test_counts_add_up_and_are_drawn() -> None:
    rows = [row("intuitive"), row("intuitive", f"{INTUITIVE}; delay shared"), row("delay", trials=44)]
    counted = confusion(rows, 22)
    assert counted["intuitive"] == {"intuitive": 1, "delay": 1}
    assert not counted["delay"]
    (told,) = [r for r in difference_rows(rows) if r["difference"] == "delay" and r["studies"]]
    assert (told["trials"], told["told"], told["cannot_tell"], told["denied"]) == (44, 0, 0, 1)
    figure = confusion_figure(rows)
    drawn = [text.get_text() for ax in figure.axes for text in ax.texts]
    assert sorted(drawn) == ["1", "1", "1"]
    heights = [[bar.get_height() for bar in ax.patches] for ax in told_figure(rows).axes]  # type: ignore[attr-defined]
    assert all(sum(each) == pytest.approx(2) for each in heights)  # two sizes


def test_a_study_goes_on_where_it_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("learn.structure_study.study_row", lambda *item: {"item": item})
    kept = KeptRows(tmp_path / "rows.jsonl")
    kept.begin({"seed": 1})
    Study(kept)(("intuitive", 22, 0))
    assert kept.rows() == [{"item": ["intuitive", 22, 0]}]


def test_another_world_is_searched_with_its_own_cues() -> None:
    start = intuitive_for(CUES, 0.5)
    trials = [replace(trial, world=CUES) for trial in cue_trials(8, 40, 4)]
    found = search_structure(trials, initial=start, rests=(0.0,), folds=2, thorough=0)
    assert {cue for _, cue in found.chosen.structure.cues} == set(CUES.cue_names)


@pytest.fixture(scope="module")
def kept() -> list[dict[str, str]]:
    return read_rows(KEPT)


def test_the_kept_study_has_every_truth_at_every_size(kept: list[dict[str, str]]) -> None:
    assert {(r["truth"], int(r["trials"])) for r in kept} == {(t, n) for t in truths() for n in REPEATS}


def test_what_the_kept_searches_name_holds_the_truth_as_often_as_claimed(kept: list[dict[str, str]]) -> None:
    for found in claim_rows(kept):
        assert found["holds_high"] >= 0.9, found
    every = [claim for claim in claims(kept) if claim.truth != "teachers differ"]
    for kind in KINDS:
        assert sum(c.holds for c in every if c.kind == kind) >= 0.87 * sum(c.kind == kind for c in every)


def test_a_delay_of_three_tenths_and_a_decay_are_told_in_every_kept_study_of_five_hundred_trials(
    kept: list[dict[str, str]],
) -> None:
    large = [r for r in kept if r["truth"] == "delay + decay" and r["trials"] == "500"]
    assert large
    for each in large:
        assert "none" not in (each["delay"] + each["decay"])
        assert label_of(each["chosen"]) == "delay + decay"


@pytest.mark.verify
def test_a_kept_row_comes_out_again(kept: list[dict[str, str]]) -> None:
    (old,) = [r for r in kept if (r["truth"], r["trials"], r["repeat"]) == ("delay + decay", "44", "0")]
    again = {name: str(value) for name, value in study_row("delay + decay", 44, 0).items()}
    for name in ("seed", "steps", "presses", "chosen", "least_bic", *NAMED):
        assert again[name] == old[name], name
