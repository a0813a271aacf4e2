"""`taskcomm study rehearse`: a study with programs in all places, to its figures, fit and comparison."""

import asyncio
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from taskcomm.commands.models import check_model, load_model
from taskcomm.commands.output import write_json
from taskcomm.commands.terminal import Terminal
from taskcomm.logs import read_trials
from taskcomm.trials import Trial
from taskcomm.web.rehearsal import Rehearsal, rehearsed, spread_of_teachers
from taskcomm.web.serverprocess import ServerProcess
from taskcomm.web.study.design import load
from taskcomm.web.study.folder import DESIGN, FolderError, StudyFolder
from taskcomm.web.study.structure import Design

NOT_TRUSTED = 4


def run(
    folder: Path,
    out: Path | None,
    teachers: int | None,
    teacher: str,
    at_once: int,
    processes: int,
    real_time: bool,
    analysis: bool,
    seed: int,
    json: bool,
) -> int:
    """Rehearse a copy of the study; 4 where a fit is not to be trusted, 1 where a command failed."""
    terminal = Terminal(json)
    out = out or folder.with_name(f"{folder.resolve().name}-rehearsal")
    design = _design(folder, out, teachers)
    model = None if teacher == "spread" else load_model(teacher, "--teacher")
    if model is not None:
        check_model(model, teacher, design.ball_world, {design.timing.step})
    study = _copy(folder, out, design)
    models = spread_of_teachers(study, seed) if model is None else dict.fromkeys(_names(study), model)
    rehearsal = Rehearsal(study, "", models, seed, at_once)
    write_json({name: model.to_dict() for name, model in rehearsal.models.items()}, out / "teachers.json")
    count = len(study.participants)
    terminal.message(f"{study.path}: a copy of the study, for {count} simulated teachers")
    with terminal.progress("rehearsing", count) as progress:
        rehearsal.progress = progress
        labels = _serve(rehearsal, out / "server.txt", lockstep=not real_time, processes=processes)
    trials = read_trials([study.trials_dir])
    conditions = {name: _summary(trials, name) for name in dict.fromkeys(t.condition for t in trials)}
    done = [_command(words, terminal) for words in _analyses(out, seed, analysis)]
    document = {"command": "study rehearse", "out": str(out), "labels": labels, "conditions": conditions}
    document["commands"] = done
    (out / "report.md").write_text(_report(document, study, real_time, seed), encoding="utf-8")
    terminal.document(document)
    _say(document, out, terminal)
    return max((code if code in (0, NOT_TRUSTED) else 1 for code in (one["code"] for one in done)), default=0)


def _design(folder: Path, out: Path, teachers: int | None) -> Design:
    """Of a rehearsal, which is about to be written to `out`."""
    if not (folder / DESIGN).is_file():
        raise FolderError(f"{folder}: no {DESIGN} in this folder; `taskcomm study new` makes one")
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise FolderError(f"{out}: is there and not empty; name another folder with --out")
    return rehearsed(load(folder / DESIGN), teachers)


def _copy(folder: Path, out: Path, design: Design) -> StudyFolder:
    """A study of this design, with the words and models of `folder`, in which nobody has taken part."""
    models = sorted((folder / "models").glob("*.json"))
    texts = folder / "texts"
    return StudyFolder.new(out / "study", design, models, texts if texts.is_dir() else None)


def _names(study: StudyFolder) -> list[str]:
    return [person.id for person in study.participants]


def _serve(rehearsal: Rehearsal, log: Path, *, lockstep: bool, processes: int) -> int:
    """The whole study, then the true reason of every press as a label; how many there were."""
    server = ServerProcess(rehearsal.folder.path, log, lockstep=lockstep, processes=processes)
    server.start()
    try:
        rehearsal.address = server.address
        asyncio.run(rehearsal.run())
        labels = asyncio.run(rehearsal.label())
        server.stop()
    finally:
        server.kill()
    return labels


def _summary(trials: Sequence[Trial], condition: str) -> dict[str, Any]:
    chosen = [trial for trial in trials if trial.condition == condition]
    return {
        "trials": len(chosen),
        "right": sum(bool(trial.correct) for trial in chosen),
        "timeouts": sum(trial.reason == "timeout" for trial in chosen),
        "mean_time_s": float(np.mean([trial.duration for trial in chosen])),
        "presses": sum(int(trial.presses.sum()) for trial in chosen),
        "default_actions": sum(step.action_source == "default" for trial in chosen for step in trial.steps),
    }


def _analyses(out: Path, seed: int, analysis: bool) -> list[list[str]]:
    """The commands that a researcher would give next."""
    study, logs, learned = str(out / "study"), str(out / "study" / "trials"), str(out / "learned.json")
    drawn = ["--seed", str(seed)]
    commands = [
        ["study", "export", study, "--out", str(out / "export")],
        ["figures", study, "--out", str(out / "figures")],
    ]
    if analysis:
        less = ["--closed-loop", "40", "--decisions", "100", "--starts", "2"]
        commands += [
            ["replay", logs, "--verify"],
            ["fit", logs, "--out", learned, "--starts", "3", *drawn],
            ["compare", logs, "--out", str(out / "comparison"), *less, *drawn],
        ]
    return commands


def _command(words: list[str], terminal: Terminal) -> dict[str, Any]:
    """Give a command, as a person would; what it says goes to stderr."""
    terminal.message(f"taskcomm {' '.join(words)}")
    code = subprocess.run([sys.executable, "-m", "taskcomm.cli", *words], stdout=sys.stderr, check=False)
    return {"command": f"taskcomm {' '.join(words)}", "code": code.returncode}


def _report(document: dict[str, Any], study: StudyFolder, real_time: bool, seed: int) -> str:
    rows = [f"| {' | '.join(row)} |" for row in _rows(document)]
    pace = "in real time" if real_time else "at full speed, in lockstep"
    return "\n".join(
        [
            f"# Rehearsal of the study {study.design.title!r}",
            "",
            f"Simulated: nobody took part. Programs taught, operated and rated, {pace}, seed {seed}. Ratings"
            " and answers follow a rule and draws; they say nothing about people.",
            "",
            "| condition | trials | right | timeouts | mean time (s) | presses |",
            "|---|---|---|---|---|---|",
            *rows,
            "",
            f"The true reason of every press ({document['labels']}) stands in the logs as a label.",
            "",
            "- `study/`: the study's folder, logs in `study/trials/`",
            "- `teachers.json`: the true model of every teacher",
            *(f"- `{one['command']}`: exit code {one['code']}" for one in document["commands"]),
            "",
        ]
    )


def _rows(document: dict[str, Any]) -> list[list[str]]:
    shown = ("trials", "right", "timeouts", "mean_time_s", "presses")
    return [
        [name, *(f"{c[key]:.1f}" if key == "mean_time_s" else str(c[key]) for key in shown)]
        for name, c in document["conditions"].items()
    ]


def _say(document: dict[str, Any], out: Path, terminal: Terminal) -> None:
    terminal.table(
        "Rehearsed trials (simulated)",
        ["condition", "trials", "right", "timeouts", "mean time (s)", "presses"],
        _rows(document),
    )
    for one in document["commands"]:
        if one["code"] != 0:
            terminal.message(f"exit code {one['code']}: {one['command']}")
    terminal.line(f"{out / 'report.md'}: what was done, and where everything is")
