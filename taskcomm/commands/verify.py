"""`taskcomm replay --verify`: logs against the robots that they name."""

from pathlib import Path

import typer

from taskcomm.commands.models import load_model
from taskcomm.commands.terminal import Terminal
from taskcomm.commands.validate import counted
from taskcomm.logreader import LogReader
from taskcomm.logs import log_files
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial
from taskcomm.verification import UnverifiableTrial, Verification, verify

SAME, DIFFERS, BAD_DATA = 0, 1, 3


def run(log: Path, model: str, trial: str | None, json: bool) -> int:
    """Run every trial, or the one named, again; say of each whether it is the same, or where it differs.

    Of a study's folder these are its trials, and the models are its own too.
    """
    terminal = Terminal(json)
    models = [load_model(model, "--model")]
    if (log / "trials").is_dir():
        models += [TeacherModel.load(path) for path in sorted((log / "models").glob("*.json"))]
        log = log / "trials"
    reader = LogReader(strict=False)
    for path in log_files(log):
        reader.read(path)
    for finding in reader.problems:
        terminal.message(f"problem: {finding}")
    for finding in reader.torn:
        terminal.message(f"notice: {finding}")
    done: list[Verification] = []
    left = len(reader.problems)
    trials = _wanted(reader.trials(), log, trial)
    with terminal.progress("verifying", len(trials)) as progress:
        for number, one in enumerate(trials, 1):
            try:
                done.append(verify(one, models))
                _say(done[-1], terminal)
            except UnverifiableTrial as error:
                left += 1
                terminal.message(f"not verified: {error}")
            progress(number)
    differ = sum(not each.same for each in done)
    terminal.document({"trials": [each.to_json() for each in done], "differ": differ, "not_verified": left})
    counts = {"trials": len(done)}
    terminal.line(f"{counted(counts)} verified: {len(done) - differ} as logged, {differ} different")
    return DIFFERS if differ else BAD_DATA if left or not done else SAME


def _wanted(trials: list[Trial], log: Path, name: str | None) -> list[Trial]:
    found = [trial for trial in trials if name in (None, trial.trial_id)]
    if name is not None and not found:
        raise typer.BadParameter(f"no trial {name!r} in {log} that can be read", param_hint="--trial")
    return found


def _say(found: Verification, terminal: Terminal) -> None:
    late = f", {found.defaults} by default" if found.defaults else ""
    what = f"{found.steps} steps, {found.decisions} choices of the {found.controller} compared{late}"
    said = f"as logged ({what})" if found.same else f"differs at {found.difference}"
    terminal.line(f"{found.trial_id}: {said}")
    for missing in found.unverified:
        terminal.line(f"  not compared: {missing}")
