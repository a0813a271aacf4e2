"""`taskcomm study export`: a study as a Psych-DS data set with Frictionless metadata."""

import warnings
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from taskcomm.commands.dataset_folder import put_dataset
from taskcomm.commands.output import run_record, sha256_of
from taskcomm.commands.terminal import Terminal
from taskcomm.datapackage import datapackage
from taskcomm.logs import TornLogWarning, read_trials
from taskcomm.peopletables import Person, people_tables
from taskcomm.psychds import PRIMARY, as_json, description, file_of, ignored, readme
from taskcomm.tables import Credit, Table
from taskcomm.trials import Trial
from taskcomm.trialtables import trial_tables
from taskcomm.web.study.design import Design, load
from taskcomm.web.study.folder import DESIGN, RECORD, FolderError
from taskcomm.web.study.record import Record, read_record
from taskcomm.web.study.sessions import lines_of
from taskcomm.web.study.texts import Texts, load_texts

RAW = ("trials", "practice", "sessions")
KEYWORDS = ("human-robot interaction", "task communication", "teaching", "POMDP", "spacebar presses")


def run(
    folder: Path,
    out: Path,
    json: bool,
    authors: Sequence[str] | None = None,
    license: str | None = None,
    citation: str | None = None,
) -> int:
    """Write the data set and say what is in it. What is in `private` is not so much as opened."""
    terminal = Terminal(json)
    study = _Study(folder, Credit(tuple(authors or ()), license, citation))
    for problem in study.problems:
        terminal.message(f"warning: {problem}")
    tables = study.tables()
    content = study.files(tables)
    put_dataset(
        out,
        content,
        run_record("study export", {"study": study.design.name}, []) | {"inputs": study.inputs()},
    )
    counts = {table.name: len(table.rows) for table in tables}
    terminal.document(
        {"command": "study export", "out": str(out), "rows": counts, "problems": study.problems}
    )
    terminal.table(
        f"{study.title}: {out}", ["table", "rows", "file"],
        [[table.name, len(table.rows), file_of(table, study.design.name)] for table in tables],
    )  # fmt: skip
    terminal.line(f"raw logs: {out / PRIMARY}; the design and its texts: {out / 'materials'}")
    return 0


class _Study:
    """What is exported of a study's folder: everything but its links and the server's own log.

    Of participants who declined, no log, no session and no answer is.
    """

    def __init__(self, folder: Path, credit: Credit) -> None:
        if not (folder / DESIGN).is_file() or not (folder / RECORD).is_file():
            raise FolderError(f"{folder}: is no folder of a study (it lacks {DESIGN} or {RECORD})")
        self.folder, self.credit = folder, credit
        self.design: Design = load(folder / DESIGN)
        self.record: Record = read_record(folder / RECORD, self.design)
        self.texts: Texts = load_texts(folder / "texts" / f"{self.design.language}.toml", self.design)
        self.problems: list[str] = []
        self.people = [self._person(participant) for participant in self.record.participants]
        declined = {person.participant_id for person in self.people if person.consent is False}
        refused = {f"{one}.jsonl" for one in declined} | {
            f"{plan.trial_id}.jsonl"
            for one in self.record.participants
            if one.id in declined
            for plan in one.trials
        }
        self.raw = [file for name in RAW for file in self._logs(name) if file.name not in refused]
        self.trials, self.practice = self._read("trials"), self._read("practice")

    @property
    def title(self) -> str:
        return f"{self.design.title} ({self.design.name}{', simulated' if self.design.simulated else ''})"

    def _person(self, participant: Any) -> Person:
        path = self.folder / "sessions" / f"{participant.id}.jsonl"
        lines, torn, problem = lines_of(path)
        self.problems += [problem] if problem else []
        self.problems += [f"{path}: torn last line, dropped"] if torn else []
        done = tuple(
            line
            for line in lines
            if line.get("type") == "page"
            and isinstance(line.get("values"), dict)
            and "kind" in line
            and "name" in line
        )
        planned = sum(not trial.practice for trial in participant.trials)
        return Person(participant.id, participant.operator, planned, self.design.source, done)

    def _logs(self, name: str) -> list[Path]:
        """The logs in one folder of the study, without those that a crash left empty."""
        files = sorted((self.folder / name).glob("*.jsonl"))
        empty = [file for file in files if not file.stat().st_size]
        self.problems += [f"{file}: empty, left out" for file in empty]
        return [file for file in files if file not in empty]

    def _read(self, name: str) -> list[Trial]:
        files = [file for file in self.raw if file.parent.name == name]
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", TornLogWarning)
            trials = read_trials(files) if files else []
        self.problems += [str(one.message) for one in caught]
        return trials

    def tables(self) -> list[Table]:
        """Every table of the study."""
        done = Counter(trial.participant_id for trial in self.trials if trial.reason in ("final", "timeout"))
        questions = {item.item: self.texts.items[item.item].text for item in self.design.questionnaire}
        people = people_tables(self.people, {str(name): number for name, number in done.items()}, questions)
        practice = [trial.trial_id for trial in self.practice]
        return [*people, *trial_tables([*self.trials, *self.practice], practice)]

    def files(self, tables: Sequence[Table]) -> dict[str, bytes]:
        """The content of the data set by path from its root."""
        name, about = self.design.name, self._about()
        paths = {table.name: file_of(table, name) for table in tables}
        found = {paths[table.name]: table.csv() for table in tables}
        keywords = [*KEYWORDS, *(["simulated data"] if self.design.simulated else [])]
        found["dataset_description.json"] = as_json(
            description(self.title, " ".join(about), tables, keywords, self.design.language, self.credit)
        )
        found["datapackage.json"] = as_json(
            datapackage(name, self.title, " ".join(about), tables, paths, self.credit)
        )
        found["README.md"] = readme(
            self.title, [*about, *self._advice()], tables, name, self._raw_text()
        ).encode()
        found[".psychdsignore"] = ignored(
            [".psychdsignore", "datapackage.json", "run.json", f"{PRIMARY}/"]
        ).encode()
        for file in self.raw:
            found[f"{PRIMARY}/{file.parent.name}/{file.name}"] = file.read_bytes()
        for file in self._materials():
            found[f"materials/{file.relative_to(self.folder).as_posix()}"] = file.read_bytes()
        return found

    def _materials(self) -> list[Path]:
        words, models = self.folder / "texts", self.folder / "models"
        return [
            self.folder / DESIGN,
            self.folder / RECORD,
            *sorted(words.glob("*.toml")),
            *sorted(models.glob("*.json")),
        ]

    def inputs(self) -> dict[str, str]:
        """Hashes of what was read, by path in the study's folder."""
        return {
            file.relative_to(self.folder).as_posix(): sha256_of(file)
            for file in [*self._materials(), *self.raw]
        }

    def _about(self) -> list[str]:
        """What the data set is, in sentences."""
        by_condition = Counter(trial.condition for trial in self.trials)
        conditions = ", ".join(
            f"{by_condition[one.name]} in condition {one.name} (robot controlled by the {one.controller})"
            for one in self.design.conditions
        )
        people = {trial.participant_id for trial in self.trials}
        teachers = "simulated teachers" if self.design.simulated else "participants"
        return [
            *(
                ["SIMULATED: the teachers are programs, no person took part."]
                if self.design.simulated
                else []
            ),
            *([self.design.description] if self.design.description else []),
            "Trials in which a teacher tells a robot by presses of the spacebar alone which of"
            f" {self.design.world.balls} balls belongs at which of {self.design.world.distances} distances"
            f" from which other. {len(self.trials)} trials of {len(people)} {teachers} so far: {conditions};"
            f" steps of {self.design.timing.step:g} s. {len(self.practice)} trials of practice are marked as"
            " such.",
        ]

    def _advice(self) -> list[str]:
        if self.design.simulated:
            return []
        return [
            "Before this is given to others: look through the answers for what could identify somebody. Free"
            " answers are as they were typed: have spreadsheets read them as text. Who made the set, its"
            " licence and how to cite it are said when it is exported (`--author`, `--license`,"
            " `--citation`).",
        ]

    def _raw_text(self) -> str:
        return (
            f"`{PRIMARY}/` holds the logs as they were written: `trials` and `practice` (JSON Lines, schema"
            " taskcomm.trial/1), `sessions` (pages done, with the answers). `materials/` holds the design of"
            " the study, the words that participants read, the assignment as drawn, and models. Links and"
            " tokens are not part of the data set; neither are logs or answers of participants who declined."
        )
