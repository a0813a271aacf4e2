"""What is shown of a logged trial, to whom, and how labels get into its log."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from taskcomm.logs import read_trials, validate, write_trials
from taskcomm.replay import belief_path, press_reasons
from taskcomm.teacher import TableTop, TeacherModel
from taskcomm.trials import Trial
from taskcomm.web.protocol import Frame, Label, Replay, encode
from taskcomm.web.replaying import ReplayError, label_line, opened, trials

STUDY = Path(__file__).parents[2] / "datasets" / "simulated-study" / "trials.jsonl"
SHORT = "study-002-2"
BY_OPERATOR = "study-004-1"
LEARNED = replace(TeacherModel.intuitive(), mistake=0.02)


@dataclass(frozen=True)
class Folder:
    trials_dir: Path
    models_dir: Path


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    """Three trials of the kept study, a log each, and a learned model."""
    made = Folder(tmp_path / "trials", tmp_path / "models")
    made.trials_dir.mkdir()
    made.models_dir.mkdir()
    LEARNED.save(made.models_dir / "learned.json")
    for trial in read_trials(STUDY):
        if trial.trial_id in (SHORT, BY_OPERATOR, "study-014-2"):
            write_trials([trial], made.trials_dir / f"{trial.trial_id}.jsonl")
    return made


def trial_of(folder: Folder, name: str) -> Trial:
    (trial,) = read_trials(folder.trials_dir / f"{name}.jsonl")
    return trial


def labelled(folder: Folder, trial: str, press: int, state: str, annotator: str) -> None:
    shown = opened(folder, trial, annotator=annotator)
    label = Label(trial=trial, press_seq=shown.presses[press]["seq"], mental_state=state)
    path, line = label_line(folder, label, annotator)
    with path.open("ab") as file:
        file.write(line)


def mentioned(value: Any) -> str:
    """Everything that is sent, as text."""
    return encode(value).decode()


def test_frames_are_the_world_before_during_and_at_the_end_of_the_trial(folder: Folder) -> None:
    trial = trial_of(folder, SHORT)
    frames = [
        Frame(**{k: v for k, v in each.items() if k != "type"}) for each in opened(folder, SHORT).frames
    ]
    assert [each.t for each in frames] == list(range(-1, trial.num_steps + 1))
    assert [each.action for each in frames] == ["", *map(str, trial.actions), "final"]
    for each, state in zip(frames[1:], trial.states, strict=False):
        placed = {ball: tuple(at) for ball, *at in each.placements}
        assert (set(each.lit), each.held or None) == (state.lit, state.held)  # type: ignore[attr-defined]
        assert placed == {b: at for b, at in enumerate(state.placements, 1) if at}  # type: ignore[attr-defined]
    assert frames[-1].final == list(trial.displayed or ())
    assert [each.state for each in frames[-2:]] == ["run", "over"]


@pytest.mark.parametrize(("name", "model"), [("intuitive", TeacherModel.intuitive()), ("learned", LEARNED)])
def test_an_admin_sees_belief_and_reasons_under_the_model_named(
    folder: Folder, name: str, model: TeacherModel
) -> None:
    trial, shown = trial_of(folder, SHORT), opened(folder, SHORT, name)
    assert shown.belief is not None
    assert shown.reasons is not None
    path = belief_path(trial, model)
    assert shown.belief["model"] == name
    np.testing.assert_allclose(shown.belief["entropy"], path.entropy, atol=1e-6)
    for field in path.fields:
        for value, column in path.marginal_of(field).items():
            np.testing.assert_allclose(shown.belief["marginals"][field][str(value)], column, atol=1e-6)
    for sent, reason in zip(shown.reasons, press_reasons(trial, model), strict=True):
        assert sent["at_end"] == pytest.approx(dict(reason.at_end), abs=1e-6)
    assert [press["t"] for press in shown.presses] == np.flatnonzero(trial.presses).tolist()
    assert [press["seq"] for press in shown.presses] == [
        trial.step_seqs[press["t"]] for press in shown.presses
    ]


def test_the_belief_as_it_ran_is_that_under_the_robots_own_model(folder: Folder) -> None:
    path = folder.trials_dir / f"{SHORT}.jsonl"
    own = replace(trial_of(folder, SHORT), robot_model={"name": "x", "sha256": LEARNED.sha256})
    write_trials([own], path)
    belief = opened(folder, SHORT).belief
    assert belief is not None
    assert belief["model"] == "learned"
    by_operator = opened(folder, BY_OPERATOR).belief
    assert by_operator is not None
    assert by_operator["model"] == "intuitive"


def test_a_model_of_another_step_is_converted_and_that_is_said(folder: Folder) -> None:
    own = TeacherModel.intuitive().with_dt(0.25)
    robot = {"name": "intuitive", "sha256": own.sha256}
    quick = replace(trial_of(folder, SHORT), dt=0.25, robot_model=robot)
    write_trials([quick], folder.trials_dir / f"{SHORT}.jsonl")
    shown = opened(folder, SHORT)
    assert shown.belief is not None
    assert shown.belief["model"] == "intuitive"
    np.testing.assert_allclose(shown.belief["entropy"], belief_path(quick, own).entropy, atol=1e-6)
    assert shown.about["notes"] == [
        "The model intuitive was converted from dt = 0.5 s to 0.25 s, approximate."
    ]  # fmt: skip


def test_an_annotator_sees_no_belief_condition_controller_or_label_of_another(folder: Folder) -> None:
    labelled(folder, SHORT, 0, "mistake", "bob")
    for trial in (SHORT, BY_OPERATOR):
        shown = opened(folder, trial, "learned", annotator="ann")
        assert (shown.belief, shown.reasons, shown.about) == (None, None, {})
        assert [press["label"] for press in shown.presses] == [None] * len(shown.presses)
        assert shown.card == list(trial_of(folder, trial).task or ())
        said = mentioned(shown) + mentioned(trials(folder, "ann"))
        for word in ("pomdp", "operator", "planner", "intuitive", "learned", "noted", "bob", "entropy"):
            assert word not in said
    rows = trials(folder, "ann").trials
    assert {key for row in rows for key in row} == {
        "trial", "participant", "index", "steps", "presses", "source", "labelled",
    }  # fmt: skip
    assert {row["labelled"] for row in rows} == {0}


def test_of_labels_the_last_of_the_annotator_is_shown_and_all_are_in_the_log(folder: Folder) -> None:
    labelled(folder, SHORT, 0, "mistake", "ann")
    labelled(folder, SHORT, 1, "that_wrt", "ann")
    labelled(folder, SHORT, 0, "that_mov", "ann")
    labelled(folder, SHORT, 0, "mistake", "bob")
    labelled(folder, SHORT, 0, "that_mov", "cleo")
    assert [press["label"] for press in opened(folder, SHORT, annotator="ann").presses][:3] == [
        "that_mov", "that_wrt", None,
    ]  # fmt: skip
    assert [row["labelled"] for row in trials(folder, "ann").trials if row["trial"] == SHORT] == [2]
    seen = opened(folder, SHORT).presses[0]
    assert (seen["label"], seen["labels"]) == (
        "that_mov", {"ann": "that_mov", "bob": "mistake", "cleo": "that_mov"},
    )  # fmt: skip
    report = validate(folder.trials_dir)
    assert report.ok
    assert not report.notices
    trial = trial_of(folder, SHORT)
    assert len(trial.labels) == 5
    assert all(label["utc"].endswith("Z") for label in trial.labels)
    assert trial.reasons[opened(folder, SHORT).presses[0]["t"]] == "that_mov"


def test_lines_of_unknown_type_do_not_move_the_press_that_a_label_is_for(folder: Folder) -> None:
    path = folder.trials_dir / f"{SHORT}.jsonl"
    first, *rest = path.read_text().splitlines()
    shifted = [line.replace(f'"seq":{seq},', f'"seq":{seq + 1},') for seq, line in enumerate(rest, 1)]
    weather = f'{{"type":"weather","trial_id":"{SHORT}","seq":1}}'
    path.write_text("\n".join((first, weather, *shifted)) + "\n")
    labelled(folder, SHORT, 2, "that_dist", "ann")
    trial = trial_of(folder, SHORT)
    assert trial.labelled == {opened(folder, SHORT).presses[2]["t"]: {"ann": "that_dist"}}


@pytest.mark.parametrize(
    ("press_seq", "state", "reason"),
    [
        (0, "mistake", "line 0 of trial study-002-2 is no step with a press"),
        (1, "mistake", "line 1 of trial study-002-2 is no step with a press"),
        (10**9, "mistake", "line 1000000000 of trial study-002-2 is no step"),
        (None, "waiting", "'waiting' is no reason of a press: mistake, that_mov, that_wrt, that_dist$"),
        (None, "bored", "'bored' is no reason"),
    ],
)
def test_a_label_of_what_is_not_there_is_refused(
    folder: Folder, press_seq: int | None, state: str, reason: str
) -> None:
    seq = opened(folder, SHORT).presses[0]["seq"] if press_seq is None else press_seq
    with pytest.raises(ReplayError, match=reason):
        label_line(folder, Label(trial=SHORT, press_seq=seq, mental_state=state), "ann")


def test_a_reason_that_only_a_model_of_the_folder_has_may_be_given(folder: Folder) -> None:
    tops = {**LEARNED.approvals, "that_near": TableTop("mov_near_wrt", 0.05, 2.0, 2.0)}
    replace(LEARNED, approvals=tops).save(folder.models_dir / "wider.json")
    assert opened(folder, SHORT, annotator="ann").states[-1] == "that_near"
    labelled(folder, SHORT, 0, "that_near", "ann")
    assert "that_near" in trial_of(folder, SHORT).reasons.values()


@pytest.mark.parametrize("name", ["nobody", "../trials/study-002-2", "study-002-2.jsonl", "/etc/passwd", "*"])
def test_a_name_from_outside_is_looked_up_and_never_a_path(folder: Folder, name: str) -> None:
    with pytest.raises(ReplayError, match="there is no trial"):
        opened(folder, name)
    with pytest.raises(ReplayError, match=r"there is no model .*; there are intuitive, learned$"):
        opened(folder, SHORT, name)


def test_what_cannot_be_read_is_said_without_a_path_and_hides_nothing_else(folder: Folder) -> None:
    (folder.trials_dir / "P09-1.jsonl").write_text('{"type": "step"}\n')
    (folder.models_dir / "bad.json").write_text("{}")
    rows = trials(folder).trials
    assert len(rows) == 4
    assert rows[0] == {"trial": "P09-1", "problem": "line 1: step line: `trial_id` is missing"}
    assert len(trials(folder, "ann").trials) == 3
    for name, model in (("P09-1", None), (SHORT, "bad")):
        with pytest.raises(ReplayError, match="cannot be read") as caught:
            opened(folder, name, model)
        assert str(folder.trials_dir.parent) not in str(caught.value)
    assert opened(folder, SHORT).belief is not None


def test_a_trial_that_is_not_over_is_for_the_admin_alone_and_takes_no_label(folder: Folder) -> None:
    path = folder.trials_dir / f"{SHORT}.jsonl"
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join(lines[:-1]))
    assert SHORT not in [row["trial"] for row in trials(folder, "ann").trials]
    with pytest.raises(ReplayError, match=f"trial {SHORT} is not over"):
        label_line(folder, Label(trial=SHORT, press_seq=5, mental_state="mistake"), "ann")
    shown: Replay = opened(folder, SHORT)
    assert shown.frames[-1]["final"] == []


def test_nothing_is_appended_behind_a_torn_line(folder: Folder) -> None:
    shown = opened(folder, SHORT)
    seq = shown.presses[0]["seq"]
    with (folder.trials_dir / f"{SHORT}.jsonl").open("ab") as file:
        file.write(b'{"type": "lab')
    with pytest.raises(ReplayError, match="the last line of this log is torn"):
        label_line(folder, Label(trial=SHORT, press_seq=seq, mental_state="mistake"), "ann")
    assert opened(folder, SHORT) == shown


def test_a_folder_without_trials_or_models_is_an_empty_list(tmp_path: Path) -> None:
    listed = trials(Folder(tmp_path / "none", tmp_path / "neither"))
    assert (listed.trials, listed.models) == ([], ["intuitive"])


def test_reasons_that_cannot_be_computed_leave_the_belief_and_are_said(
    folder: Folder, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("taskcomm.smoother.MAX_MEMORIES", 2)
    shown = opened(folder, SHORT)
    assert shown.belief is not None
    assert shown.reasons == []
    assert "reasons of presses cannot be computed" in shown.about["notes"][0]
