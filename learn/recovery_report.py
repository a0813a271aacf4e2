"""A recovery in Markdown, with its figures and tables as files."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from learn.plots import csv_text, save
from learn.recovery import LOOP, Plan
from learn.recovery_figure import error_figure, learning_curve, robot_figure
from learn.recovery_robots import INTUITIVE, RobotPlan, Row, robot_rows
from learn.recovery_summary import crossing, curve_rows, parameter_rows
from learn.report import markdown_table
from taskcomm.teacher import TeacherModel

MEANING = """\
Errors are learned minus true, on the logarithm of odds (mistake, peaks) and of seconds (rises, falls); 0.1
is about a tenth of the value. RMSE is the root of their mean square over the studies. The gain of a learned
model is its log-likelihood on fresh trials of the same teachers minus that of the intuitive model, in nats
per trial;
{fresh}.
Intervals are 95% bootstrap intervals: they resample the studies and the fresh trials. For robots, they
resample the studies that were learned from with their trials, or the trials alone, whichever is wider: few
studies say little of how studies differ."""
FRESH = {
    "both": "half of the fresh trials were moved by the scripted operator, half by the planner with"
    " the intuitive model",
    "planner": "the fresh trials were moved by the planner with the intuitive model",
}


@dataclass(frozen=True)
class Recovery:
    """All that a recovery came to, as flat rows for tables; see `recovery_summary` and `recovery_robots`."""

    plan: Plan
    truths: Mapping[str, TeacherModel]
    parameters: list[dict[str, Any]]
    curve: list[dict[str, Any]]
    crossings: list[dict[str, Any]]
    robots: list[dict[str, Any]]

    def to_json(self) -> dict[str, Any]:
        """Plain values; None for what is no number."""
        tables = {name: getattr(self, name) for name in ("parameters", "curve", "crossings", "robots")}
        return {name: [_finite(row) for row in rows] for name, rows in tables.items()}


def _finite(row: Row) -> dict[str, Any]:
    return {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in row.items()}


def recovery_of(
    fits: Sequence[Row],
    robots: Sequence[Row],
    truths: Mapping[str, TeacherModel],
    plan: Plan,
) -> Recovery:
    """Sum up the rows of `recover` and of `run_robots`."""
    curve = curve_rows(fits)
    crossings = [
        {"truth": truth, "source": source, "from_trials": str(crossing(fits, truth, source))}
        for truth, source in dict.fromkeys((row["truth"], row["source"]) for row in curve)
        if source != LOOP  # which begins with a whole batch
    ]
    dt = next(iter(truths.values())).dt
    robot = robot_rows(robots, dt, plan.threshold)
    return Recovery(plan, dict(truths), parameter_rows(fits), curve, crossings, robot)


def write_recovery(found: Recovery, directory: Path) -> list[Path]:
    """Write report.md, the figures (.png) and their numbers (.csv); gives the paths."""
    written = save(learning_curve(found.curve), directory / "learning-curve.png", found.curve)
    for truth in found.truths:
        rows = [row for row in found.parameters if row["truth"] == truth]
        written += save(error_figure(found.parameters, truth), directory / f"errors-{truth}.png", rows)
    if found.robots:
        written += save(robot_figure(found.robots), directory / "robots.png", found.robots)
    (directory / "crossings.csv").write_text(csv_text(found.crossings), encoding="utf-8")
    (directory / "report.md").write_text(report(found), encoding="utf-8")
    return [*written, directory / "crossings.csv", directory / "report.md"]


def report(found: Recovery) -> str:
    """The report; figures and tables are named as `write_recovery` writes them."""
    sections = ["# Recovery: does learning find the truth?", _about(found), _paying(found)]
    sections += [_errors(found, truth) for truth in found.truths]
    sections += [_covered(found), _looped(found), _robots(found)]
    return "\n\n".join(section for section in sections if section) + "\n"


def _about(found: Recovery) -> str:
    plan = found.plan
    failed = sum(round(row["not_converged"] * row["studies"]) for row in found.curve)
    fits = sum(row["studies"] for row in found.curve)
    said = "**All of this is simulated**: no person took part."
    said += f" Seed {plan.seed}, planner horizon {plan.horizon}."
    ended = f"{fits} fits; {failed} of them did not converge." if failed else f"{fits} fits; all converged."
    rows = [[name, *map(_numbers, _states(model))] for name, model in found.truths.items()]
    states = ["mistake", *next(iter(found.truths.values())).approvals]
    same = all(["mistake", *model.approvals] == states for model in found.truths.values())
    table = markdown_table(["teachers", *states], rows) if same else ""
    meaning = MEANING.format(fresh=FRESH[plan.fresh.source])
    caption = "True values: mistake; then peak, rise (s) and fall (s) of each approval." if same else ""
    return "\n\n".join(part for part in (f"{said} {ended}", table, caption, meaning) if part)


def _states(model: TeacherModel) -> list[list[float]]:
    return [[model.mistake], *([top.peak, top.rise, top.fall] for top in model.approvals.values())]


def _numbers(values: Sequence[float]) -> str:
    return ", ".join(f"{value:g}" for value in values)


def _paying(found: Recovery) -> str:
    sizes = sorted({row["size"] for row in found.curve if row["source"] != LOOP})
    at = {(row["truth"], row["source"], row["size"]): row for row in found.curve}
    rows = []
    for one in found.crossings:
        truth, source = one["truth"], one["source"]
        gains = [at.get((truth, source, size)) for size in sizes]
        rows.append([truth, source, one["from_trials"], *map(_gain, gains)])
    columns = ["teachers", "robot moved by", "pays from (trials)", *(f"gain, {size}" for size in sizes)]
    about = (
        "From how many trials on the learned model foresees presses better than the intuitive one, and by how"
        " many nats per trial after so many."
    )
    return "\n\n".join(
        [
            "## When learning pays",
            about,
            markdown_table(columns, rows),
            "![learning curve](learning-curve.png)",
            "Numbers: `learning-curve.csv`.",
        ]
    )


def _gain(row: Row | None) -> str:
    return "" if row is None else interval(row, "gain")


def _errors(found: Recovery, truth: str) -> str:
    source = "both" if "both" in found.plan.sources else found.plan.sources[0]
    rows = [row for row in found.parameters if (row["truth"], row["source"]) == (truth, source)]
    sizes = sorted({row["size"] for row in rows})
    at = {(row["parameter"], row["size"]): row for row in rows}
    lines = []
    for name in dict.fromkeys(row["parameter"] for row in rows):
        cells = [_error(at[name, size]) for size in sizes]
        lines.append([name, f"{at[name, sizes[0]]['true']:g}", *cells])
    studies = ", ".join(f"{at['mistake', size]['studies']} of {size}" for size in sizes)
    about = (
        f"Bias and RMSE over studies ({studies} trials); moved by: {source}. After the semicolon:"
        " share of studies with the parameter at its bound, where there are any. All others are in the figure"
        " and its table."
    )
    return "\n\n".join(
        [
            f"## Errors by parameter: teachers {truth}",
            about,
            markdown_table(["parameter", "true", *(f"{size} trials" for size in sizes)], lines),
            f"![errors](errors-{truth}.png)",
            f"Numbers: `errors-{truth}.csv`.",
        ]
    )


def _error(row: Row) -> str:
    if not math.isfinite(row["rmse"]):
        return "no data"
    bound = f"; {row['at_bound']:.0%}" if row["at_bound"] else ""
    return f"{row['bias']:+.2f}, {row['rmse']:.2f}{bound}"


def _covered(found: Recovery) -> str:
    rows = [row for row in found.parameters if row["intervals"]]
    if not rows:
        return ""
    names = list(dict.fromkeys(row["parameter"] for row in rows))
    at = {(row["truth"], row["source"], row["size"], row["parameter"]): row for row in rows}
    lines = []
    for truth, source, size in dict.fromkeys(key[:3] for key in at):
        of_names = [at.get((truth, source, size, name)) for name in names]
        shares = [f"{one['coverage']:.0%} of {one['intervals']}" if one else "" for one in of_names]
        lines.append([truth, source, size, *shares])
    about = "In how many of the studies the 95% likelihood interval of a parameter held its true value."
    columns = ["teachers", "robot moved by", "trials", *names]
    return "\n\n".join(["## Do intervals hold the truth?", about, markdown_table(columns, lines)])


def _looped(found: Recovery) -> str:
    last = found.plan.rounds[-1]
    rows = [row for row in found.parameters if row["source"] == LOOP and row["size"] == last]
    if not rows:
        return ""
    at = {(row["truth"], row["source"], row["size"], row["parameter"]): row for row in found.parameters}
    sources = [*(source for source in found.plan.sources if source != "both"), LOOP]
    sizes = {row["size"] for row in found.parameters if row["source"] in sources[:-1]}
    size = last if last in sizes else max(size for size in sizes if size <= max(last, min(sizes)))
    lines = []
    for row in rows:
        found_at = [
            at[row["truth"], source, last if source == LOOP else size, row["parameter"]] for source in sources
        ]
        cells = [f"{one['steps']:.2f}, {one['presses']:.3f}" for one in found_at]
        errors = [f"{one['rmse']:.2f}" for one in found_at]
        lines.append([row["truth"], row["parameter"], *cells, *errors])
    about = (
        "In the closed loop the planner acts with the model learned so far, which is fitted anew after about"
        f" every {found.plan.batch} trials. Given are the steps and presses per trial that bear on a"
        f" parameter at its true value, and the RMSE after {last} trials"
        + (f" ({size} without the loop)" if size != last else "")
        + f", over {rows[0]['studies']} loops: few, so that only large differences mean something."
    )
    columns = ["teachers", "parameter", *(f"steps, presses: {source}" for source in sources)]
    return "\n\n".join(
        [
            "## Does choosing actions by entropy starve a parameter?",
            about,
            markdown_table([*columns, *(f"RMSE: {source}" for source in sources)], lines),
        ]
    )


def _robots(found: Recovery) -> str:
    if not found.robots:
        return ""
    lines = []
    for row in found.robots:
        ratio = "" if row["arm"] == INTUITIVE else interval(row, "time_ratio")
        gain = "" if row["arm"] == INTUITIVE else interval(row, "correct_gain", ".3f")
        times = [interval(row, "time", ".1f"), ratio, interval(row, "time_to_true")]
        right = [interval(row, "correct", ".3f"), gain, round(row["timeout"] * row["trials"])]
        counted = [row[name] for name in ("truth", "arm", "models", "trials")]
        lines.append([*counted, *times, *right, interval(row, "right", ".3f")])
    columns = ["teachers", "robot", "models", "trials", "time (s)", "time / intuitive", "time / true"]
    columns += [
        "share right",
        "right, minus intuitive",
        "timeouts",
        f"right when {found.plan.threshold:.0%} sure",
    ]
    about = (
        "Every robot meets the same tasks and the same luck. A robot that learned is another one from trial"
        " to trial, each with the model of another simulated study, so that its intervals hold the luck of"
        " the study too. A timeout counts at its length, as not right."
    )
    return "\n\n".join(
        [
            "## Learned models as robots",
            about,
            markdown_table(columns, lines),
            "![robots](robots.png)",
            "Numbers: `robots.csv`.",
        ]
    )


def interval(row: Row, name: str, form: str = ".2f") -> str:
    """A value of a row with its interval."""
    return f"{row[name]:{form}} ({row[name + '_low']:{form}} to {row[name + '_high']:{form}})"


def robot_plan(plan: Plan, trials: int, sizes: Sequence[int] | None = None) -> RobotPlan:
    """The closed loop that goes with a plan: models of its mixed studies, or else of its first source."""
    source = "both" if "both" in plan.sources else plan.sources[0]
    return RobotPlan(
        source=source,
        sizes=tuple(sorted(plan.sizes if sizes is None else sizes)),
        trials=trials,
        models=plan.repeats,
        horizon=plan.horizon,
        threshold=plan.threshold,
        max_steps=plan.max_steps,
        seed=plan.seed,
    )
