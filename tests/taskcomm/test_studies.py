"""The data sets are what their cards say, and are made again to the byte."""

import json
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from taskcomm.logs import read_trials, trial_bytes, validate
from taskcomm.studies import (
    Session,
    drawn_teacher,
    large_sessions,
    main,
    population_teacher,
    study_sessions,
)
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial

DATASETS = Path(__file__).parents[2] / "datasets"
SETS = {"simulated-study": study_sessions, "simulated-large": large_sessions}


@pytest.fixture(scope="module", params=SETS)
def data_set(request: pytest.FixtureRequest) -> tuple[str, Sequence[Session], list[Trial]]:
    return request.param, SETS[request.param](), read_trials(DATASETS / request.param)


def test_trials_are_those_of_the_sessions(data_set: tuple[str, Sequence[Session], list[Trial]]) -> None:
    name, sessions, trials = data_set
    assert validate(DATASETS / name).problems == validate(DATASETS / name).notices == ()
    assert len(trials) == {"simulated-study": 44, "simulated-large": 200}[name]
    for session, trial in zip(sessions, trials, strict=True):
        assert (trial.trial_id, trial.participant_id) == (session.trial_id, session.participant_id)
        assert (trial.task, trial.condition) == (session.task, session.condition)
        assert (trial.source, trial.started_utc) == ("simulated", None)
        assert all(step.mental_state in session.teacher.mental_states for step in trial.steps)
    people = {session.participant_id for session in sessions}
    for person in people:
        pair = [trial for trial in trials if trial.participant_id == person]
        assert sorted(trial.condition for trial in pair) == ["operator", "pomdp"]
        assert [trial.trial_index for trial in pair] == [0, 1]


def test_trials_are_made_again_to_the_byte(data_set: tuple[str, Sequence[Session], list[Trial]]) -> None:
    _, sessions, trials = data_set
    pairs = list(zip(sessions, trials, strict=True))
    for condition, count in (("pomdp", 2), ("operator", 8)):
        of_condition = [pair for pair in pairs if pair[0].condition == condition]
        for session, trial in sorted(of_condition, key=lambda pair: pair[1].num_steps)[:count]:
            again = replace(session.run(), taskcomm_version=trial.taskcomm_version)
            assert trial_bytes(again) == trial_bytes(trial)


@pytest.mark.verify
@pytest.mark.parametrize("name", SETS)
def test_the_command_makes_the_whole_set_again(name: str, tmp_path: Path) -> None:
    assert main([name.removeprefix("simulated-"), str(tmp_path)]) == 0
    made = {path.name for path in tmp_path.iterdir()}
    assert made | {"README.md"} == {path.name for path in (DATASETS / name).iterdir()}
    for file in made:
        if file.startswith("teacher"):
            assert (tmp_path / file).read_bytes() == (DATASETS / name / file).read_bytes()
    trials = {trial.trial_id: trial for trial in read_trials(DATASETS / name)}
    for again in read_trials(tmp_path):
        trial = trials.pop(again.trial_id)
        assert trial_bytes(replace(again, taskcomm_version=trial.taskcomm_version)) == trial_bytes(trial)
    assert not trials


def test_the_card_counts_what_is_in_the_set(data_set: tuple[str, Sequence[Session], list[Trial]]) -> None:
    name, _, trials = data_set
    card = (DATASETS / name / "README.md").read_text(encoding="utf-8")
    assert "**Simulated. Nobody took part.**" in card
    for condition in ("pomdp", "operator"):
        chosen = [trial for trial in trials if trial.condition == condition]
        reasons = [reason for trial in chosen for reason in trial.reasons.values()]
        row = re.search(rf"^\| `{condition}` \|(.*)\|$", card, re.MULTILINE)
        assert row is not None
        assert row[1].replace(" ", "").split("|") == [
            str(len(chosen)),
            str(sum(trial.correct is True for trial in chosen)),
            str(sum(trial.reason == "timeout" for trial in chosen)),
            f"{np.ceil(10 * np.median([trial.duration for trial in chosen])) / 10:.1f}s",
            str(sum(trial.num_steps for trial in chosen)),
            str(len(reasons)),
            str(reasons.count("mistake")),
        ]


def test_the_true_teachers_stand_beside_the_trials() -> None:
    teachers = json.loads((DATASETS / "simulated-study" / "teachers.json").read_text(encoding="utf-8"))
    true = {name: TeacherModel.from_dict(document) for name, document in teachers.items()}
    assert true == {session.participant_id: session.teacher for session in study_sessions()}
    assert len({model.sha256 for model in true.values()}) == 22
    large = TeacherModel.load(DATASETS / "simulated-large" / "teacher.json")
    assert large == population_teacher()
    assert [top.peak for top in large.approvals.values()] == [0.25, 0.20, 0.15]
    assert (DATASETS / "simulated-large" / "trials.jsonl.gz").stat().st_size < 2_000_000


def test_teachers_are_drawn_about_the_medians_that_the_card_states() -> None:
    rng = np.random.default_rng(0)
    logs = np.log(
        [[m.mistake, m.approvals["that_wrt"].peak] for m in (drawn_teacher(rng) for _ in range(400))]
    )
    assert np.exp(logs.mean(axis=0)) == pytest.approx([0.008, 0.18], rel=0.06)
    assert logs.std(axis=0) == pytest.approx([0.4, 0.25], rel=0.1)


def test_the_command_says_what_it_cannot_do(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_bytes(b"")
    assert main(["large", str(tmp_path / "file")]) == 1
    assert str(tmp_path / "file") in capsys.readouterr().err
    with pytest.raises(SystemExit) as stopped:
        main(["small", str(tmp_path)])
    assert stopped.value.code == 2
