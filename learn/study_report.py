"""All figures and statistics of a study as files, and a line for every one that could not be made."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from learn.plots import csv_text
from learn.study_background import agreement_rows, answer_rows
from learn.study_belief_figures import accuracy_figure, entropy_figure
from learn.study_beliefs import Believed, ModelOf, believed, typical_recovery, typical_trial
from learn.study_condition_figures import rating_figures, time_figure
from learn.study_statistics import operator_rows, paired_rows, statistics_text, summary_rows
from learn.study_style import StudyFigure, write_captions
from learn.study_trial_figures import marginals_figure, recovery_figure
from learn.study_trials import Missing, by_planner, source_note
from taskcomm.trials import Trial

TYPICAL = (
    "Chosen by rule: of the trials with the planner that ended rightly, the one of median length (of two,"
    " the shorter)."
)
NAMED = "The trial was named by hand."


@dataclass(frozen=True)
class StudyReport:
    """The figures made, `not_made` with a line for each that was not, and what went into none."""

    figures: tuple[StudyFigure, ...]
    not_made: dict[str, str]
    left_out: tuple[str, ...]


def study_report(
    trials: Sequence[Trial], model_of: ModelOf, trial_id: str | None = None, seed: int = 0
) -> StudyReport:
    """Every figure of the paper that these trials allow.

    `model_of` gives the model of a trial's robot, or raises Missing. `trial_id` names the trial of mistake
    recovery and task marginals, in place of the rules.
    """
    figures: list[StudyFigure] = []
    not_made: dict[str, str] = {}
    planned = [trial for trial in trials if by_planner(trial)]
    beliefs: list[Believed] = []
    left_out: list[str] = []
    no_beliefs = "" if planned else "no trial was with the planner"
    if planned:
        try:
            beliefs, left_out = believed(planned, model_of)
            no_beliefs = "" if beliefs else left_out[0]
        except Missing as missing:
            no_beliefs = str(missing)
    shown = [one for one in beliefs if trial_id in (None, one.trial.trial_id)]

    def marginals() -> StudyFigure:
        return (
            marginals_figure(typical_trial(shown), TYPICAL)
            if trial_id is None
            else marginals_figure(shown[0], NAMED)
        )

    drawings: dict[str, Callable[[], StudyFigure | list[StudyFigure]]] = {
        "mistake-recovery": lambda: recovery_figure(typical_recovery(shown)),
        "task-marginals": marginals,
        "inference-of-mental-state": lambda: accuracy_figure(beliefs, seed),
        "ratings": lambda: rating_figures(trials),
        "time-to-final": lambda: time_figure(trials),
        "entropy": lambda: entropy_figure(beliefs),
    }
    for name, draw in drawings.items():
        try:
            if no_beliefs and name not in ("ratings", "time-to-final"):
                raise Missing(no_beliefs)
            made = draw()
        except Missing as missing:
            not_made[name] = str(missing)
        else:
            figures += made if isinstance(made, list) else [made]
    return StudyReport(tuple(figures), not_made, tuple(left_out))


def write_study_report(
    found: StudyReport,
    trials: Sequence[Trial],
    directory: Path,
    *,
    ending: str = "png",
    answers: Mapping[str, Sequence[float]] | None = None,
    seed: int = 0,
) -> list[Path]:
    """Write the figures with their numbers and captions, the statistics, and figures.md with all of it.

    `answers` are those of the participants in numbers, by item. Gives the paths. No empty table is written.
    """
    written = [path for figure in found.figures for path in figure.write(directory, ending)]
    written.append(write_captions(found.figures, directory))
    tables = {
        "statistics.csv": summary_rows(trials),
        "paired.csv": paired_rows(trials, seed),
        "operators.csv": operator_rows(trials),
        "participants.csv": answer_rows(answers or {}),
        "agreement.csv": agreement_rows(trials),
    }
    statistics = statistics_text(trials, answers, seed)
    texts = {name: csv_text(rows) for name, rows in tables.items() if rows} | {
        "statistics.md": f"# Statistics of {source_note(trials)}\n\n{statistics}",
        "figures.md": "\n\n".join(_page(found, trials, ending, statistics)) + "\n",
    }
    for name, text in texts.items():
        (directory / name).write_text(text, encoding="utf-8")
        written.append(directory / name)
    return written


def _page(found: StudyReport, trials: Sequence[Trial], ending: str, statistics: str) -> Iterator[str]:
    yield f"# Figures of {source_note(trials)}"
    if any(trial.source == "simulated" for trial in trials):
        every = all(trial.source == "simulated" for trial in trials)
        which = "These" if every else "Some of these"
        yield f"**{which} trials are simulated**: no person took part in them."
    for figure in found.figures:
        yield f"## {figure.name}"
        yield f"![{figure.name}]({figure.name}.{ending})"
        yield f"{figure.caption} Numbers: `{figure.name}.csv`."
    yield "## Statistics"
    yield statistics.strip()
    if found.not_made or found.left_out:
        yield "## Not made"
        lines = [f"{name}: {why}." for name, why in found.not_made.items()] + [
            f"{why}." for why in found.left_out
        ]
        yield "\n".join(f"- {line}" for line in lines)
