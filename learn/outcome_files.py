"""A comparison as files: the report, the figures, and the numbers behind each."""

from collections.abc import Sequence
from pathlib import Path

from learn.calibration_figure import calibration_figure, calibration_rows, threshold_rows
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
    logs = "simulated logs" if found.sources == ("simulated",) else "logs"
    places = {logs: found.calibration, "simulated closed loop": found.loop_calibration}
    judged = {place: models for place, models in places.items() if models}
    if judged:
        figure = calibration_figure(judged)
        written += save(figure, directory / "calibration.png", calibration_rows(judged))
    texts = {
        "thresholds.csv": csv_text(threshold_rows(judged)),
        "held-out.csv": csv_text(found.held_out.rows(trials)),
        "report.md": report(found, title=title, intro=intro, outro=outro),
    }
    for name, text in texts.items():
        (directory / name).write_text(text, encoding="utf-8")
        written.append(directory / name)
    found.fitted.model.save(directory / "learned.json")
    return [*written, directory / "learned.json"]
