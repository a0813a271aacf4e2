"""`taskcomm demo`: the whole loop on the shipped, simulated study."""

import json as json_module
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from learn.compare import Comparison, compare_models
from learn.held_out import LEARNED
from learn.outcome_files import write_comparison
from learn.replay_figure import replay_figure
from taskcomm.commands.compare import summarise
from taskcomm.commands.models import load_trials, naming
from taskcomm.commands.output import result_directory, run_record, sha256_of, write_json
from taskcomm.commands.replay import replay_document
from taskcomm.commands.terminal import Terminal
from taskcomm.logs import LogError, log_files
from taskcomm.replay import belief_path, press_reasons
from taskcomm.studies import drawn_teacher, mistake_trial
from taskcomm.teacher import ModelError, TeacherModel

STUDY = Path("datasets") / "simulated-study"
INTRO = (
    "From logged teaching trials to a better robot: the teacher's mental-state model is learned from the logs"
    " by EM, and robots that plan with it are held against robots with the intuitive model of the paper."
)
MISTAKE = """## A mistake, and how the robot gets over it

![mistake](mistake.png)

A simulated trial of the robot with the intuitive model, as in the paper's figure: a press is forced at 3 s,
while ball 1 is lit, though the task has nothing to do with ball 1. Grey lines are presses. Below: why each
press was made, as the robot believed at once (pale) and with the whole trial known (full). The first press
ends as a mistake with probability {end:.2f}, from {once:.2f} at first; the robot shows {shown}, the task is
{task}. Numbers: `mistake.json`."""


def run(out: Path, data: Path | None, trials: int, seed: int, jobs: int, json: bool) -> int:
    """Fit, compare, replay, report; 4 if the fit did not converge."""
    settings = {"out": out, "data": data, "trials": trials, "horizon": 3, "seed": seed}
    terminal = Terminal(json)
    folder = data if data is not None else study_folder()
    with result_directory(out) as part:
        logged, places = load_trials([folder], terminal)
        logged_truths = known_teachers(folder)
        terminal.message(f"{folder}: {len(logged)} trials")
        record = run_record("demo", settings, log_files([folder]))
        fresh = [drawn_teacher(np.random.default_rng([seed, n, 3])) for n in range(trials)]
        note = (
            "one new person each, drawn from the same spread as those of the logs, and met by no model before"
        )
        with naming(places):
            found = compare_models(
                logged, {"intuitive": TeacherModel.intuitive()}, truth=fresh if data is None else (),
                truth_note=note if data is None else f"the model learned from all of these logs, `{LEARNED}`",
                loop_trials=trials, decisions=200, seed=seed, jobs=jobs, fit_options={"starts": 3},
                stage=terminal.progress,
            )  # fmt: skip
        outro = _mistake(part)
        intro = f"{INTRO} {gain_sentence(found)}"
        written = write_comparison(
            found, logged, part, title="taskcomm demo", intro=intro, outro=outro, known_truths=logged_truths
        )
        write_json(found.to_json(), part / "comparison.json")
        written += [part / name for name in ("comparison.json", "mistake.png", "mistake.json")]
        outputs = {path.name: sha256_of(path) for path in written}
        write_json({**record, "outputs": outputs}, part / "run.json")
    terminal.document({"command": "demo", "out": str(out), **found.to_json()})
    summarise(found, terminal)
    terminal.line(gain_sentence(found))
    terminal.line(f"{out / 'report.md'}: the report, with figures and tables beside it")
    return 0 if found.fitted.converged else 4


def study_folder() -> Path:
    """The shipped study, found from the current directory upwards, or from the checkout of this package."""
    here = Path.cwd()
    places = [place / STUDY for place in (here, *here.parents, Path(__file__).resolve().parents[2])]
    for place in places:
        if place.is_dir():
            return place
    raise LogError(
        f"{STUDY}: not found from {here} upwards; run the demo in a checkout, or name logs with --data"
    )


def known_teachers(folder: Path) -> list[TeacherModel]:
    """The true models of simulated teachers, where the data set has them."""
    file = folder / "teachers.json"
    if not file.is_file():
        return []
    try:
        teachers: Mapping[str, Any] = json_module.loads(file.read_text(encoding="utf-8"))
        return [TeacherModel.from_dict(model) for model in teachers.values()]
    except (AttributeError, ValueError) as error:
        raise ModelError(f"{file}: not the true models of simulated teachers: {error}") from None


def gain_sentence(found: Comparison) -> str:
    """How much sooner and how much more often right, in one sentence."""
    loop, base = found.loop, found.baseline
    if loop is None:
        return ""
    ratio, times = loop.time_ratio(LEARNED, base), [loop.mean(arm, "time") for arm in (LEARNED, base)]
    right = [loop.mean(arm, "correct").estimate for arm in (LEARNED, base)]
    return (
        f"With the learned model the robot takes {ratio.estimate:.0%} of the time ({ratio.low:.0%} to"
        f" {ratio.high:.0%}; {times[0].estimate:.0f} s for {times[1].estimate:.0f} s) and is right in"
        f" {right[0]:.0%} of {loop.trials} simulated trials, for {right[1]:.0%} with the {base} one."
    )


def _mistake(directory: Path) -> str:
    """The figure of the paper's mistake and its numbers; gives the section of the report."""
    trial, model = mistake_trial(), TeacherModel.intuitive()
    path, reasons = belief_path(trial, model), press_reasons(trial, model)
    title = "A press by mistake at 3 s (simulated trial, intuitive model)"
    replay_figure(path, reasons, trial.task, title=title).savefig(directory / "mistake.png", dpi=150)
    write_json(replay_document(trial, model, path, reasons), directory / "mistake.json")
    first = reasons[0]
    return MISTAKE.format(
        end=first.at_end["mistake"], once=first.at_once["mistake"], shown=trial.displayed, task=trial.task
    )
