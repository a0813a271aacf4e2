"""A comparison as files: the report, the figures, and the numbers behind each."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from learn.compare import Comparison
from learn.plots import (
    csv_text,
    entropy_over_time,
    entropy_rows,
    save,
    table_top_rows,
    table_tops,
    time_to_final,
)
from learn.report import report
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial


def write_comparison(
    found: Comparison,
    trials: Sequence[Trial],
    directory: Path,
    *,
    title: str,
    intro: str = "",
    outro: str = "",
    known_truths: Sequence[TeacherModel] = (),
) -> list[Path]:
    """Write report.md, figures (.png), their numbers (.csv) and learned.json; gives the paths.

    `known_truths` are the teachers of the logs, where they are simulated, drawn behind the table-tops.
    """
    figure = table_tops(found.robots, known_truths)
    written = save(figure, directory / "table-tops.png", table_top_rows(found.robots))
    if found.loop is not None:
        written += save(time_to_final(found.loop), directory / "time-to-final.png", found.loop.rows())
        written += save(entropy_over_time(found.loop), directory / "entropy.png", entropy_rows(found.loop))
    texts = {
        "held-out.csv": csv_text(found.held_out.rows(trials)),
        "calibration.csv": csv_text(_calibration_rows(found)),
        "report.md": report(found, title=title, intro=intro, outro=outro),
    }
    for name, text in texts.items():
        (directory / name).write_text(text, encoding="utf-8")
        written.append(directory / name)
    found.fitted.model.save(directory / "learned.json")
    return [*written, directory / "learned.json"]


def _calibration_rows(found: Comparison) -> list[dict[str, Any]]:
    return [
        {"where": where, "model": arm, **row}
        for where, judged in (("logs", found.calibration), ("closed loop", found.loop_calibration))
        for arm, c in judged.items()
        for row in c.rows
    ]
