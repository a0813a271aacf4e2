"""The folder of a study: made whole or not at all, read as data, and where everything in it is."""

import os
import shutil
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Self

from taskcomm.teacher import TeacherModel
from taskcomm.web.study.assignment import Participant, TrialPlan
from taskcomm.web.study.design import Design, load, parsed
from taskcomm.web.study.links import Role, Seats, Tokens, exposed, fresh, read_tokens, write_tokens
from taskcomm.web.study.links import Seat as Seat
from taskcomm.web.study.models import copy_models, load_models
from taskcomm.web.study.pages import pages
from taskcomm.web.study.reading import StudyError, text_of
from taskcomm.web.study.record import changes, read_record, record_of, sha256_of_text, write_record
from taskcomm.web.study.sessions import check_session
from taskcomm.web.study.texts import SHIPPED, Texts, load_texts, shipped
from taskcomm.web.study.tomlwriting import toml_of

DESIGN, RECORD, LINKS = "study.toml", "participants.json", "links.json"


class FolderError(StudyError):
    """A folder that is no study's, or cannot become one."""


def template() -> str:
    """The shipped `study.toml`: the paper's study."""
    return (resources.files("taskcomm.web.study") / "template" / DESIGN).read_text(encoding="utf-8")


class StudyFolder:
    """A study on disk: `design`, `participants`, `texts`, `tokens` (by role and name).

    `warnings` say what has changed since the study was made, and what others may read. Raises a StudyError
    that names file, key and reason for anything in it that cannot be.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        if not (self.path / DESIGN).is_file() or not (self.path / RECORD).is_file():
            raise FolderError(
                f"{self.path}: is no folder of a study (it lacks {DESIGN} or {RECORD}); `taskcomm study new`"
                " makes one"
            )
        self.design: Design = load(self.path / DESIGN)
        self.texts: Texts = load_texts(self.texts_dir / f"{self.design.language}.toml", self.design)
        self._models = load_models(self.models_dir, self.design)
        self._record = read_record(self.path / RECORD, self.design)
        self.participants: tuple[Participant, ...] = self._record.participants
        self.tokens: Tokens = read_tokens(self.links)
        self._seats = Seats(self.tokens)
        self._check_links()
        for participant in self.participants:
            check_session(self.session_of(participant.id), pages(self.design, self.texts, participant))

    @classmethod
    def new(
        cls,
        path: str | os.PathLike[str],
        design: Design | str | None = None,
        models: Iterable[Path] = (),
        texts: Path | None = None,
    ) -> Self:
        """Make the folder of a study and draw its assignment.

        `design` is a Design, the text of a `study.toml`, or None for the shipped one; `models` are the model
        files that it names, and more for replays; `texts` a folder of words beside those shipped, or instead.
        Raises a StudyError, and leaves nothing, where the folder is there and not empty.
        """
        whole = Path(path).resolve()
        if whole.exists() and not (whole.is_dir() and not any(whole.iterdir())):
            raise FolderError(f"{path}: is there and not empty; a study is made in a new folder")
        part = whole.with_name(f".part.{os.getpid()}.{whole.name}")
        try:
            part.mkdir(parents=True)
            _fill(part, template() if design is None else design, models, texts)
            part.replace(whole)
        except StudyError as error:
            raise type(error)(str(error).replace(f"{part}/", "")) from None
        except OSError as error:
            raise FolderError(f"{path}: cannot be made: {error.strerror or error}") from None
        finally:
            shutil.rmtree(part, ignore_errors=True)
        return cls(path)

    @property
    def texts_dir(self) -> Path:
        return self.path / "texts"

    @property
    def models_dir(self) -> Path:
        return self.path / "models"

    @property
    def trials_dir(self) -> Path:
        return self.path / "trials"

    @property
    def practice_dir(self) -> Path:
        return self.path / "practice"

    @property
    def sessions_dir(self) -> Path:
        return self.path / "sessions"

    @property
    def server_log(self) -> Path:
        return self.path / "server.jsonl"

    @property
    def links(self) -> Path:
        """The file with the tokens."""
        return self.path / "private" / LINKS

    @property
    def operators(self) -> tuple[str, ...]:
        """Ids of the operators."""
        return tuple(operator.id for operator in self._record.operators)

    @property
    def drawn(self) -> tuple[int | None, ...]:
        """Their numbers in a pool of everybody, from 1."""
        return tuple(operator.person for operator in self._record.operators)

    def log_of(self, trial: TrialPlan) -> Path:
        """Where the log of a trial is, or will be."""
        return (self.practice_dir if trial.practice else self.trials_dir) / f"{trial.trial_id}.jsonl"

    def session_of(self, participant_id: str) -> Path:
        """Where the pages done by a participant are, or will be."""
        return self.sessions_dir / f"{self.participant(participant_id).id}.jsonl"

    def participant(self, name: str) -> Participant:
        """The participant of that id; KeyError where there is none."""
        return self._by_id[name]

    @cached_property
    def _by_id(self) -> Mapping[str, Participant]:
        return {participant.id: participant for participant in self.participants}

    def model(self, name: str) -> TeacherModel:
        """A planner's model, by the name that its condition gives it."""
        return self._models[name]

    def seat(self, token: str) -> Seat | None:
        """The role and name that a token is for, or None."""
        return self._seats.seat(token)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the researcher should know, a sentence each."""
        models = {name: model.sha256 for name, model in self._models.items()}
        language = f"{self.design.language}.toml"
        texts = {language: sha256_of_text(text_of(self.texts_dir / language))}
        others = exposed(self.links)
        unlinked = [
            f"{self.links}: annotator {name} has no link"
            for name in self.design.annotators
            if name not in self.tokens["annotator"]
        ]
        return (*changes(self._record, self.design, models, texts), *unlinked, *([others] if others else []))

    def _check_links(self) -> None:
        teachers = [participant.id for participant in self.participants]
        wanted: tuple[tuple[Role, Sequence[str]], ...] = ("teacher", teachers), ("operator", self.operators)
        for role, names in wanted:
            for name in names:
                if name not in self.tokens[role]:
                    raise FolderError(f"{self.links}: {role} {name} has no token")


def _fill(part: Path, design: Design | str, models: Iterable[Path], texts: Path | None) -> None:
    """Write a study into the empty folder `part`."""
    text = toml_of(design) if isinstance(design, Design) else design
    design = parsed(text, DESIGN)
    (part / DESIGN).write_text(text, encoding="utf-8")
    words = _write_texts(part / "texts", texts, design)
    copy_models(models, part / "models")
    hashes = {name: model.sha256 for name, model in load_models(part / "models", design).items()}
    record = record_of(design, hashes, words)
    write_record(record, part / RECORD)
    teachers, operators = ([each.id for each in some] for some in (record.participants, record.operators))
    write_tokens(fresh(teachers, operators, design.annotators), part / "private" / LINKS)
    for name in ("sessions", "practice", "trials"):
        (part / name).mkdir()


def _write_texts(folder: Path, given: Path | None, design: Design) -> dict[str, str]:
    """Write the words, those given over those shipped; the hash of those that the design uses, by file."""
    folder.mkdir()
    for language in SHIPPED:
        (folder / f"{language}.toml").write_text(shipped(language), encoding="utf-8")
    for file in sorted(given.glob("*.toml")) if given else ():
        (folder / file.name).write_text(text_of(file), encoding="utf-8")
    used = folder / f"{design.language}.toml"
    load_texts(used, design)
    return {used.name: sha256_of_text(text_of(used))}
