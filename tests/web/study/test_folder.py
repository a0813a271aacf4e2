"""The folder of a study: made whole or not at all, and read back as it was meant."""

import json
import os
import shutil
import stat
from pathlib import Path

import msgspec
import pytest

from taskcomm.teacher import TableTop, TeacherModel
from taskcomm.web.study.assignment import assign
from taskcomm.web.study.design import Condition, Design, DesignError, Operators, parsed
from taskcomm.web.study.folder import FolderError, StudyFolder, template
from taskcomm.web.study.links import Seat
from taskcomm.web.study.reading import StudyError
from taskcomm.web.study.structure import HUMAN, ROBOT

SMALL = Design(name="small", seed=3, teachers=2, operators=Operators(draw=1), conditions=(ROBOT, HUMAN))
PLANNED = Design(
    name="planned", teachers=1, conditions=(Condition(name="p", controller="planner", model="prompt.json"),)
)


@pytest.fixture
def study(tmp_path: Path) -> StudyFolder:
    return StudyFolder.new(tmp_path / "study", SMALL)


@pytest.fixture
def model(tmp_path: Path) -> Path:
    """A model file."""
    path = tmp_path / "prompt.json"
    tops = {"that_mov": TableTop("mov_lit", peak=0.2, rise=1.0, fall=1.0)}
    TeacherModel(mistake=0.01, approvals=tops).save(path)
    return path


def edit(path: Path, before: str, after: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert before in text
    path.write_text(text.replace(before, after, 1), encoding="utf-8")


def test_a_new_folder_holds_the_design_the_words_the_assignment_and_a_link_for_everyone(
    study: StudyFolder,
) -> None:
    names = {str(path.relative_to(study.path)) for path in study.path.rglob("*") if path.is_file()}
    assert names == {
        "study.toml",
        "texts/en.toml",
        "texts/de.toml",
        "participants.json",
        "private/links.json",
    }
    assert study.design == SMALL
    assert study.participants == assign(SMALL)
    assert study.operators == ("O1",)
    assert study.warnings == ()
    assert {role: sorted(some) for role, some in study.tokens.items()} == {
        "teacher": ["P01", "P02"],
        "operator": ["O1"],
        "admin": ["admin"],
        "annotator": ["annotator-1"],
    }
    assert study.seat(study.tokens["operator"]["O1"]) == Seat("operator", "O1")
    assert study.model("intuitive").sha256 == TeacherModel.intuitive().sha256


def test_a_folder_reads_back_the_same(study: StudyFolder) -> None:
    again = StudyFolder(study.path)
    assert (again.design, again.participants, again.texts) == (study.design, study.participants, study.texts)
    assert again.tokens == study.tokens


def test_two_folders_of_one_design_differ_in_the_tokens_alone(tmp_path: Path) -> None:
    one, two = (StudyFolder.new(tmp_path / name, SMALL) for name in ("one", "two"))
    for name in ("study.toml", "participants.json", "texts/en.toml", "texts/de.toml"):
        assert (one.path / name).read_bytes() == (two.path / name).read_bytes()
    tokens = [t for some in (*one.tokens.values(), *two.tokens.values()) for t in some.values()]
    assert len(set(tokens)) == 10


def test_no_file_but_that_of_the_links_holds_a_token(study: StudyFolder) -> None:
    tokens = [token.encode() for some in study.tokens.values() for token in some.values()]
    for path in study.path.rglob("*"):
        if path.is_file() and path != study.links:
            assert not any(token in path.read_bytes() for token in tokens), path


def test_the_text_of_a_design_is_kept_as_it_is_written(tmp_path: Path) -> None:
    folder = StudyFolder.new(tmp_path / "study", template())
    assert (folder.path / "study.toml").read_text(encoding="utf-8") == template()
    assert StudyFolder.new(tmp_path / "other").design == parsed(template())


def test_logs_and_sessions_have_their_places(study: StudyFolder) -> None:
    practised = msgspec.structs.replace(SMALL, practice="pomdp")
    first = assign(practised)[0]
    assert [study.log_of(trial) for trial in first.trials] == [
        study.path / "practice" / "P01-practice.jsonl",
        study.path / "trials" / "P01-1.jsonl",
        study.path / "trials" / "P01-2.jsonl",
    ]
    assert study.session_of("P02") == study.path / "sessions" / "P02.jsonl"
    with pytest.raises(KeyError):
        study.session_of("../P02")


def test_an_empty_folder_may_become_a_study_and_one_with_anything_in_it_may_not(tmp_path: Path) -> None:
    place = tmp_path / "there"
    place.mkdir()
    (place / "note.txt").write_text("mine")
    with pytest.raises(FolderError, match=r"there: is there and not empty"):
        StudyFolder.new(place, SMALL)
    assert [path.name for path in place.iterdir()] == ["note.txt"]
    (place / "note.txt").unlink()
    StudyFolder.new(place, SMALL)
    with pytest.raises(FolderError, match="is there and not empty"):
        StudyFolder.new(place, SMALL)


def test_a_file_in_the_way_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    for place in ("file", "file/inside"):
        with pytest.raises(FolderError, match="file"):
            StudyFolder.new(tmp_path / place, SMALL)
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.parametrize(
    ("design", "said"),
    [
        (
            'name = "a"\nlanguage = "fr"',
            "texts/fr.toml: there is no such file, and the language of the design",
        ),
        ('name = "a"\nteachers = 0', "study.toml: teachers: expected `int` >= 1"),
        (PLANNED, "models/prompt.json: there is no such file, and a condition of the design names it"),
        (msgspec.structs.replace(SMALL, teachers="two"), "study.toml: teachers: expected `int`, got `str`"),
    ],
)
def test_what_fails_leaves_nothing_and_names_no_folder_of_its_own(
    tmp_path: Path, design: Design | str, said: str
) -> None:
    with pytest.raises(StudyError) as error:
        StudyFolder.new(tmp_path / "study", design)
    assert str(error.value).startswith(said)
    assert list(tmp_path.iterdir()) == []


def test_models_are_copied_and_read_as_data(tmp_path: Path, model: Path) -> None:
    study = StudyFolder.new(tmp_path / "study", PLANNED, models=[model])
    assert study.model("prompt.json").sha256 == TeacherModel.load(model).sha256
    assert (study.models_dir / "prompt.json").read_bytes() == model.read_bytes()


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("{}", "prompt.json: "),
        ("\x80\x04", "prompt.json: not JSON"),
        (
            TeacherModel.intuitive().with_dt(0.25).to_json(),
            "dt: the model is for steps of 0.25 s, the study has",
        ),
        (TeacherModel.intuitive().to_json().replace("mov_lit", "mov_rung"), "mov_rung"),
    ],
)
def test_a_model_that_cannot_be_or_does_not_fit_is_said(
    tmp_path: Path, model: Path, content: str, said: str
) -> None:
    model.write_text(content, encoding="latin-1")
    with pytest.raises(DesignError) as error:
        StudyFolder.new(tmp_path / "study", PLANNED, models=[model])
    assert said in str(error.value)
    assert not (tmp_path / "study").exists()


def test_two_models_of_one_name_are_refused(tmp_path: Path, model: Path) -> None:
    (tmp_path / "more").mkdir()
    other = shutil.copy(model, tmp_path / "more")
    with pytest.raises(DesignError, match="another model has that name"):
        StudyFolder.new(tmp_path / "study", PLANNED, models=[model, Path(other)])


def test_words_of_ones_own_take_the_place_of_those_shipped(tmp_path: Path) -> None:
    given = tmp_path / "words"
    first = StudyFolder.new(tmp_path / "first", SMALL)
    shutil.copytree(first.texts_dir, given)
    edit(given / "en.toml", "What you will do", "How it goes")
    study = StudyFolder.new(tmp_path / "study", SMALL, texts=given)
    assert study.texts.instructions.title == "How it goes"
    assert study.warnings == ()


def test_what_changed_since_is_said_key_by_key(tmp_path: Path, model: Path) -> None:
    study = StudyFolder.new(tmp_path / "study", PLANNED, models=[model])
    edit(study.path / "study.toml", "limit = 300.0", "limit = 200.0")
    edit(study.path / "study.toml", 'name = "planned"', 'name = "planned" # as agreed')
    edit(study.texts_dir / "en.toml", "What you will do", "How it goes")
    edit(study.models_dir / "prompt.json", "0.01", "0.02")
    assert StudyFolder(study.path).warnings == (
        "study.toml: timing.limit was 300.0, is 200.0: changed since the study was made",
        "models/prompt.json is not what it was: changed since the study was made",
        "texts/en.toml is not what it was: changed since the study was made",
    )


def test_links_that_others_may_read_are_said(study: StudyFolder) -> None:
    study.links.chmod(0o644)
    (warning,) = StudyFolder(study.path).warnings
    assert warning.startswith(f"{study.links}: others than you have access (mode 644)")


def test_an_annotator_named_later_is_said_to_have_no_link(study: StudyFolder) -> None:
    edit(study.path / "study.toml", '["annotator-1"]', '["annotator-1", "ada"]')
    assert any("annotator ada has no link" in warning for warning in StudyFolder(study.path).warnings)


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        (
            'name = "operator"',
            'name = "by-hand"',
            "was drawn in condition 'operator' (operator), which the design",
        ),
        ("distances = 4", "distances = 1", "was drawn with Task("),
    ],
)
def test_a_design_that_the_assignment_cannot_follow_is_refused(
    study: StudyFolder, before: str, after: str, said: str
) -> None:
    edit(study.path / "study.toml", before, after)
    with pytest.raises(StudyError) as error:
        StudyFolder(study.path)
    assert str(error.value).startswith(f"{study.path / 'participants.json'}: trial P0")
    assert said in str(error.value)


def test_a_session_whose_pages_are_others_by_now_is_refused(study: StudyFolder) -> None:
    """Else a participant in mid-study would skip a page."""
    done = [{"page": 0, "name": "consent"}, {"page": 1, "name": "questionnaire"}]
    session = study.session_of("P02")
    session.write_text("".join(json.dumps({"type": "page", **line}) + "\n" for line in done) + '{"torn')
    StudyFolder(study.path)
    edit(study.path / "study.toml", "ask = true", "ask = false")
    with pytest.raises(StudyError) as error:
        StudyFolder(study.path)
    assert str(error.value).startswith(
        f"{session}: page 0 was consent when it was done, by the design it is now questionnaire"
    )


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ('"trial_id": "P01-1"', '"trial_id": "../P01-1"', "].trial_id: expected letters, digits, - and _"),
        ('{"id": "P01"', '{"id": "/tmp/P01"', "participants[0].id: expected letters, digits, - and _"),
        ('"trial_id": "P02-1"', '"trial_id": "P01-1"', "P01-1 is there twice"),
        ('"controller": "planner"', '"controller": "robot"', ".controller: 'robot' is unknown"),
    ],
)
def test_an_assignment_names_no_place_outside_its_folder_and_nothing_twice(
    study: StudyFolder, before: str, after: str, said: str
) -> None:
    path = study.path / "participants.json"
    head, participants = path.read_text(encoding="utf-8").split('"participants": [')
    assert before in participants
    path.write_text(head + '"participants": [' + participants.replace(before, after, 1), encoding="utf-8")
    with pytest.raises(StudyError) as error:
        StudyFolder(study.path)
    assert str(error.value).startswith(f"{path}: ")
    assert said in str(error.value)


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("participants.json", "{", "participants.json: not JSON: "),
        ("participants.json", '{"schema": "taskcomm.study/2"}', "participants.json: schema: this version of"),
        ("participants.json", "{}", "participants.json: design_sha256 is missing"),
        ("private/links.json", "{}", "private/links.json: teacher is missing"),
        ("texts/en.toml", "x = 1", "texts/en.toml: x: is unknown"),
        ("study.toml", "", "study.toml: name is missing"),
    ],
)
def test_any_file_that_is_spoilt_is_one_error(study: StudyFolder, name: str, content: str, said: str) -> None:
    (study.path / name).write_text(content)
    with pytest.raises(StudyError) as error:
        StudyFolder(study.path)
    assert str(error.value).startswith(f"{study.path}/{said}")


def test_a_participant_without_a_token_is_said(study: StudyFolder) -> None:
    tokens = json.loads(study.links.read_text())
    del tokens["teacher"]["P02"]
    study.links.write_text(json.dumps(tokens))
    with pytest.raises(FolderError, match=r"links\.json: teacher P02 has no token"):
        StudyFolder(study.path)


def test_another_folder_is_no_study(tmp_path: Path) -> None:
    with pytest.raises(FolderError, match=r"is no folder of a study \(it lacks study\.toml or participants"):
        StudyFolder(tmp_path)


def test_private_is_closed_whatever_the_umask(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        study = StudyFolder.new(tmp_path / "study", SMALL)
    finally:
        os.umask(before)
    assert stat.S_IMODE(study.links.stat().st_mode) == 0o600
    assert stat.S_IMODE(study.links.parent.stat().st_mode) == 0o700
    assert study.warnings == ()


def test_the_largest_study_can_be_made(tmp_path: Path) -> None:
    study = StudyFolder.new(
        tmp_path / "study", msgspec.structs.replace(SMALL, teachers=1000, operators=Operators(draw=10))
    )
    assert len(study.participants) == 1000
    assert study.seat(study.tokens["teacher"]["P0999"]) == Seat("teacher", "P0999")
