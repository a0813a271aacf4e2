"""A comparison in Markdown, section by section."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from learn.audit import RULE
from learn.bootstrap import Interval
from learn.calibration import Calibration
from learn.compare import Comparison
from learn.held_out import BLIND, LEARNED
from learn.intervals import interval_text

if TYPE_CHECKING:
    from learn.result import FitResult


def report(found: Comparison, *, title: str, intro: str = "", outro: str = "") -> str:
    """The report of a comparison; figures and tables are named as `learn.outcome_files` writes them."""
    sections = (
        f"# {title}",
        intro,
        _data(found),
        _fit(found),
        _held_out(found),
        _decisions(found),
        _closed_loop(found),
        _calibration(found),
        outro,
    )
    return "\n\n".join(section for section in sections if section) + "\n"


def markdown_table(columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """Rows as a Markdown table, all columns but the first to the right.

    >>> print(markdown_table(["model", "nats"], [["a", 1.5]]))
    | model | nats |
    | --- | ---: |
    | a | 1.5 |
    """
    lines = [columns, ["---", *["---:"] * (len(columns) - 1)], *rows]
    return "\n".join("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines)


def span(value: Interval, form: str = ".2f") -> str:
    """An estimate with its interval, or `none`.

    >>> span(Interval(0.5, 0.25, 1.0, groups=9))
    '0.50 (0.25 to 1.00)'
    """
    if value.estimate != value.estimate:
        return "none"
    return f"{value.estimate:{form}} ({value.low:{form}} to {value.high:{form}})"


def source_sentence(sources: Sequence[str]) -> str:
    """What a reader must know of where the trials come from."""
    if tuple(sources) == ("simulated",):
        return "**These trials are simulated**: no person took part in any of them."
    if "simulated" in sources:
        return f"**Some of these trials are simulated** (sources: {', '.join(sources)})."
    return f"Source of the trials: {', '.join(sources)}."


def parameter_table(fitted: "FitResult") -> tuple[list[str], list[list[str]]]:
    """Columns and rows of a fit: each parameter before and after, its interval where there is one, what
    informed it and the verdict of the audit on that."""
    start = "intuitive" if fitted.initial.provenance.get("made_by") == "TeacherModel.intuitive" else "initial"
    found, columns = fitted.uncertainty, ["parameter", start, "learned"]
    if found is not None:
        columns.append(f"{found.level:.0%} interval")
    rows = []
    for row in fitted.table():
        cells = [row.parameter, _number(row.initial), _number(row.learned)]
        if found is not None:
            cells.append("" if row.interval is None else interval_text(row.interval))
        rows.append([*cells, f"{row.presses:.1f}", f"{row.steps:.0f}", row.verdict, row.mark])
    return [*columns, "presses", "steps", "data", "mark"], rows


def _number(value: float) -> str:
    return "none" if value == float("inf") else f"{value:.4g}"


def _text(*sentences: str) -> str:
    return " ".join(sentence for sentence in sentences if sentence)


def _named(found: Comparison, arm: str) -> str:
    """The arm, marked where it was fitted to some of the logs themselves."""
    inside = int(found.held_out.in_sample[arm].sum())
    return f"{arm} (in-sample: {inside} of {found.trials} trials)" if inside else arm


def _data(found: Comparison) -> str:
    return _text(
        source_sentence(found.sources),
        f"{found.trials} trials, {found.people} people, {found.presses} presses.",
        "Intervals are 95% bootstrap intervals that resample people whole (simulated teachers, in the",
        "closed loop). Where all or none of the trials were right they have no width: no exception was",
        "seen, which does not say that there is none.",
    )


def _fit(found: Comparison) -> str:
    fitted = found.fitted
    state = "converged" if fitted.converged else f"**is not to be trusted** ({fitted.status})"
    about = _text(
        f"Fitted to all trials; the fit {state}, at a log-likelihood of {fitted.log_likelihood:.2f} nats.",
        "Probabilities are per step, times in seconds; presses and steps are the expected numbers of",
        f"those that informed a parameter, data the verdict on that ({RULE}).",
    )
    certificate = "\n".join(f"- {line}" for line in fitted.certificate.lines())
    caption = _text(
        "The probability of each mental state per step, since its cue went on (left, from level 0) and",
        "off (right, from level 1). Numbers: `table-tops.csv`.",
    )
    remarks = "\n".join(f"- {remark}" for remark in fitted.wider_remarks)
    parts = [
        "## The learned teacher",
        about,
        markdown_table(*parameter_table(fitted)),
        f"The certificate of the fit:\n\n{certificate}",
        remarks,
        "![table-tops](table-tops.png)",
        caption,
    ]
    return "\n\n".join(part for part in parts if part)


def _held_out(found: Comparison) -> str:
    scored, base = found.held_out, found.baseline
    rows = []
    for arm in scored.arms:
        gains = ["", ""]
        if arm != base:
            gains = [span(scored.per_trial(arm, base)), span(scored.per_press(arm, base), ".3f")]
        total = f"{scored.log_likelihood[arm].sum():.1f}"
        rows.append([_named(found, arm), total, span(scored.per_trial(arm)), *gains])
    columns = ["model", "log-likelihood", "per trial", f"per trial, minus {base}", f"per press, minus {base}"]
    failed = scored.converged.count(False)
    about = _text(
        "Log-likelihood in nats of the presses, given the task cards.",
        f"`{LEARNED}` is refitted {len(scored.learned)} times, each time without the people it is scored on.",
        f"**{failed} of these fits did not converge.**" if failed else "",
        f"`{BLIND}` is an HMM of the presses alone, refitted likewise." if BLIND in scored.arms else "",
        "Figures marked in-sample are of a model that was fitted to some of these very trials: too good."
        if any(marks.any() for marks in scored.in_sample.values())
        else "",
    )
    return "\n\n".join(
        ["## Foreseeing the presses", about, markdown_table(columns, rows), "Trial by trial: `held-out.csv`."]
    )


def _decisions(found: Comparison) -> str:
    if not found.disagreement:
        return ""
    rows = [
        [_named(found, arm), len(d.differs), d.walking, span(d.share), span(d.mean_loss, ".4f")]
        for arm, d in found.disagreement.items()
    ]
    horizon = next(iter(found.disagreement.values())).horizon
    about = _text(
        f"At moments drawn from the logs: the planner (horizon {horizon}) with each model, held against the",
        f"planner with `{LEARNED}`. A decision differs if its action is none of those that are best, or",
        f"tied, under `{LEARNED}`; lost is the expected total entropy over the horizon that its action",
        "costs more than the best, averaged over all decisions. Moments at which either robot would be sure",
        "already, and walk to the goal, are left out.",
    )
    columns = ["planner with", "decisions", "left out", "share that differ", "entropy lost (nats)"]
    return "\n\n".join(["## What the planner would do", about, markdown_table(columns, rows)])


def _closed_loop(found: Comparison) -> str:
    loop, base = found.loop, found.baseline
    if loop is None:
        return ""
    rows = []
    for arm in loop.arms:
        ratio = "" if arm == base else span(loop.time_ratio(arm, base))
        gain = "" if arm == base else span(loop.difference(arm, base, "correct"), ".3f")
        time, presses = (span(loop.mean(arm, what), ".1f") for what in ("time", "presses"))
        right, late = span(loop.mean(arm, "correct"), ".3f"), int(loop.timeout(arm).sum())
        rows.append([arm, time, ratio, right, gain, late, presses])
    columns = ["robot", "mean time (s)", f"time / {base}", "share right", f"right, minus {base}"]
    columns += ["timeouts", "presses"]
    about = _text(
        f"{loop.trials} simulated trials of every robot. The simulated teachers: {found.truth}.",
        f"So the robot `{LEARNED}` knows its teachers exactly, as no robot knows people: too good."
        if found.truths == (found.fitted.model,)
        else "",
        "Each trial has the same task and the same draws for every robot.",
        f"Planner horizon {loop.settings['horizon']}, Final above {loop.settings['threshold']:g}, timeout",
        f"after {loop.settings['max_steps']} steps, counted at its length and as not right.",
    )
    return "\n\n".join(
        [
            "## Robots in a closed loop",
            about,
            markdown_table(columns, rows),
            "![time to Final](time-to-final.png)",
            "Numbers: `time-to-final.csv`.",
            "![entropy over time](entropy.png)",
            "Numbers: `entropy.csv`.",
        ]
    )


def _calibration(found: Comparison) -> str:
    parts: tuple[tuple[str, Mapping[str, Calibration]], ...] = (
        ("logs", found.calibration),
        ("closed loop", found.loop_calibration),
    )
    judged = [(where, arm, one) for where, models in parts for arm, one in models.items()]
    if not judged:
        return ""
    rows = []
    for where, arm, one in judged:
        name = _named(found, arm) if where == "logs" else arm
        said = f"{one.said:.3f}" if one.sure else "none"
        brier = "none" if one.scores is None else span(one.scores.brier, ".3f")
        passed = f"{one.sure} of {one.trials}"
        rows.append([f"{name}, {where}", passed, said, span(one.right, ".3f"), str(one.needed), brier])
    threshold = judged[0][2].threshold
    about = _text(
        f"At the first moment of a trial at which the likeliest task passed {threshold:g}: the mean",
        "probability it then had, and the share of trials in which it was the teacher's. On the logs, the",
        "belief follows what was done there, whoever moved the robot. Then the least threshold from which",
        f"on that share is at least {threshold:g}; in the closed loop nothing is known of thresholds above",
        "the robots' own. The Brier score is of every moment; 0 is the best.",
    )
    caption = _text(
        "Left: the share of moments in which the likeliest task was the teacher's, by the probability said",
        "of it; on the grey line a model is right as often as it says. Middle: the share right when a trial",
        "first passed a threshold, against that threshold (grey); a mark where the share sought begins.",
        "Right: the mean time until then, a trial that does not get there counted at its length. Thresholds",
        "that less than half of the trials passed are not drawn. Numbers: `calibration.csv` and",
        "`thresholds.csv`.",
    )
    columns = ["model", f"passed {threshold:g}", "said", "was right", f"threshold for {threshold:g}", "Brier"]
    return "\n\n".join(
        [
            "## Is it right when it says so",
            about,
            markdown_table(columns, rows),
            "![calibration](calibration.png)",
            caption,
        ]
    )
