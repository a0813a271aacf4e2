"""The paper's figures of what the robot believed: mistake recovery, task marginals, reasons, entropy."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from learn.plots import COLOURS, LINES
from learn.replay_figure import NAMES, mark_presses
from learn.study_beliefs import Believed, Recovery, accuracy, accuracy_rows
from learn.study_style import DARK, LIGHT, StudyFigure, figure_of, for_print
from learn.study_trials import Missing, counted, source_note, teacher_of


def models_note(of: Sequence[Believed]) -> str:
    """Which models the beliefs are of, by name or hash."""
    named = {one.model.sha256: (one.trial.robot_model or {}) for one in of}
    names = sorted(
        {
            f"{model.get('name')!r}" if model.get("sha256") == sha else f"sha256 {sha[:12]}"
            for sha, model in named.items()
        }
    )
    return f"the robot's teacher model{'s' if len(names) > 1 else ''} {', '.join(names)}"


@for_print
def recovery_figure(found: Recovery) -> StudyFigure:
    """P(each value of the field) over time round a mistaken press, and P(that press was a mistake)."""
    one, path = found.of, found.of.path
    trial, at = one.trial, path.time[found.step + 1]
    right = getattr(trial.task, found.field)
    figure, (ax, strip) = figure_of(
        2.9, 2, f"trial {trial.trial_id} ({trial.source})", sharex=True, height_ratios=[4.5, 1]
    )
    for place, (value, column) in enumerate(path.marginal_of(found.field).items()):
        name = f"{found.field} = {value}" + (" (true)" if value == right else "")
        wide = 2.0 if value == found.wrong else 1.1
        ax.plot(
            path.time,
            column,
            color=COLOURS[place % 7],
            linestyle=LINES[place % 7],
            linewidth=wide,
            label=name,
        )
    since = path.time[found.step + 1 :]
    ax.plot(since, found.mistake, color="black", linestyle=(0, (1, 1)), label=f"press at {at:g} s a mistake")
    mark_presses(path, ax)
    ax.annotate("mistaken", (at, 1.0), (2, 2), textcoords="offset points", fontsize=7, annotation_clip=False)
    ax.set_ylim(-0.02, 1.02)
    ax.set_ylabel("probability")
    figure.legend(loc="outside lower center", ncols=2, columnspacing=1.2)
    _held(strip, one)
    strip.set_xlabel("seconds (grey lines: presses)")
    rows = _recovery_rows(found)
    return StudyFigure("mistake-recovery", figure, rows, _recovery_caption(found, float(at), right))


def _held(ax: Axes, one: Believed) -> None:
    """A bar for each ball, where the robot holds it."""
    states, time = one.trial.states, one.path.time
    balls = range(1, one.trial.world.num_balls + 1) if hasattr(one.trial.world, "num_balls") else ()
    for ball in balls:
        spans = [
            (time[t], time[t + 1] - time[t])
            for t, state in enumerate(states)
            if getattr(state, "held", 0) == ball
        ]
        ax.broken_barh(spans, (ball - 0.4, 0.8), color=COLOURS[(ball - 1) % 7], linewidth=0)
    ax.set_ylim(len(balls) + 0.6, 0.4)
    ax.set_yticks(list(balls))
    ax.tick_params(axis="y", labelsize=6.5)
    ax.set_ylabel("held")


def _recovery_rows(found: Recovery) -> list[dict[str, Any]]:
    path, columns = found.of.path, found.of.path.marginal_of(found.field)
    actions = ["", *map(str, found.of.trial.actions)]
    pressed = [False, *path.pressed.tolist()]
    return [
        {
            "trial_id": found.of.trial.trial_id,
            "time": float(time),
            "action": actions[row],
            "press": int(pressed[row]),
            **{f"{found.field}={value}": float(column[row]) for value, column in columns.items()},
            "press_was_mistake": float(found.mistake[row - found.step - 1]) if row > found.step else "",
        }
        for row, time in enumerate(path.time)
    ]


def _recovery_caption(found: Recovery, at: float, right: Any) -> str:
    column = found.of.path.marginal_of(found.field)[found.wrong]
    return (
        f"Recovery from a mistaken press, in one {found.of.trial.source} trial ({found.of.trial.trial_id};"
        f" {teacher_of(found.of.trial)}). The press at {at:g} s was a mistake; it raised the probability that"
        f" {found.field} is {found.wrong} from {column[found.step]:.2f} to {column[found.step + 1]:.2f},"
        " where it"
        f" is {right} in truth. At the end it stood at {column[-1]:.2f}. Dotted: the probability that this"
        " press"
        f" was a mistake, given the trial so far; it went from {found.mistake[0]:.2f} to"
        f" {found.mistake[-1]:.2f}."
        " Below, which ball the robot held. Chosen by rule: of all presses known to be mistakes in trials"
        " with the"
        " planner, the one with the greatest rise of a wrong value that was undone by the end. Beliefs are"
        " those"
        f" of {models_note([found.of])}."
    )


@for_print
def marginals_figure(one: Believed, rule: str) -> StudyFigure:
    """P(every value) of each part of the task over time, the true one solid, presses as lines."""
    trial, path = one.trial, one.path
    fields = path.fields
    if not fields or trial.task is None:
        raise Missing(f"trial {trial.trial_id} has no known task with named parts")
    figure, axes = figure_of(
        1.2 * len(fields) + 0.3, len(fields), f"trial {trial.trial_id} ({trial.source})", sharex=True
    )
    for letter, field, ax in zip("abcdef", fields, axes, strict=False):
        right = getattr(trial.task, field)
        for place, (value, column) in enumerate(path.marginal_of(field).items()):
            true = value == right
            style = {"linestyle": "-", "linewidth": 2.0, "color": "black"} if true else {"linewidth": 1.0}
            style = (
                style if true else style | {"linestyle": LINES[1 + place % 4], "color": COLOURS[place % 6]}
            )
            ax.plot(path.time, column, label=f"{value} (true)" if true else str(value), **style)
        mark_presses(path, ax)
        ax.set_ylim(-0.03, 1.05)
        ax.set_yticks([0, 0.5, 1])
        ax.set_title(f"({letter}) {NAMES.get(field, field)}")
        ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), borderaxespad=0.2)
    axes[len(axes) // 2].set_ylabel("probability")
    axes[-1].set_xlabel("seconds (grey lines: presses)")
    rows = [
        {"trial_id": trial.trial_id, "time": float(time), "press": int(row > 0 and path.pressed[row - 1])}
        | {
            f"{field}={value}": float(column[row])
            for field in fields
            for value, column in path.marginal_of(field).items()
        }
        for row, time in enumerate(path.time)
    ]
    ends = ", ".join(
        f"{field} {path.marginal_of(field)[getattr(trial.task, field)][-1]:.3f}" for field in fields
    )
    caption = (
        f"The robot's marginal probabilities in one {trial.source} trial ({trial.trial_id};"
        f" {teacher_of(trial)}),"
        f" which {'shows' if trial.reason == 'final' else 'never showed'} Final at {trial.duration:g} s."
        " Solid and black: the true value; vertical lines: presses of the spacebar"
        f" ({counted(int(path.pressed.sum()), 'press')}). The true values end at: {ends}."
        f" {rule} Beliefs are those of {models_note([one])}."
    )
    return StudyFigure("task-marginals", figure, rows, caption)


@for_print
def accuracy_figure(of: Sequence[Believed], seed: int = 0) -> StudyFigure:
    """P(the true mental state) when it was pressed (dark) and at the end of the trial (light), by state."""
    rows = accuracy_rows(of)
    if not rows:
        raise Missing("no reason of a press is known, from a simulation or a label")
    found = accuracy(rows, seed)
    trials = [one.trial for one in of]
    figure, (ax,) = figure_of(
        2.3, 1, f"{source_note(trials)} with the planner, {counted(len(rows), 'press')}"
    )
    offsets = np.random.default_rng(seed).uniform(-0.1, 0.1, len(rows))
    for place, (state, means) in enumerate(found.items()):
        these = [
            (row, offset) for row, offset in zip(rows, offsets, strict=True) if row["mental_state"] == state
        ]
        for shift, when, grey in ((-0.2, "at_press", DARK), (0.2, "at_end", LIGHT)):
            mean = means[when]
            ax.bar(place + shift, mean.estimate, 0.36, color=grey, edgecolor="0.2", linewidth=0.5)
            x = [place + shift + offset for _, offset in these]
            ax.plot(x, [row[when] for row, _ in these], "o", color="white", markeredgecolor="0.1",
                    markersize=1.9, markeredgewidth=0.35, alpha=0.8)  # fmt: skip
            bars = [[mean.estimate - mean.low], [mean.high - mean.estimate]]
            ax.errorbar(place + shift, mean.estimate, bars, color=COLOURS[1], capsize=2.5, linewidth=1.3)
    ax.set_xticks(range(len(found)), [_state_label(state, rows) for state in found])
    ax.set_ylim(0, 1.03)
    ax.set_ylabel("P(true mental state)")
    for grey, label in ((DARK, "when pressed"), (LIGHT, "at the end of the trial")):
        ax.bar([0], [0], color=grey, edgecolor="0.2", linewidth=0.5, label=label)
    figure.legend(loc="outside lower center", ncols=2)
    return StudyFigure("inference-of-mental-state", figure, rows, _accuracy_caption(of, rows, found))


def _state_label(state: str, rows: Sequence[dict[str, Any]]) -> str:
    return f"{state}\nn = {sum(row['mental_state'] == state for row in rows)}"


def _accuracy_caption(of: Sequence[Believed], rows: Sequence[dict[str, Any]], found: Any) -> str:
    presses = sum(len(one.reasons) for one in of)
    disputed = sum(one.disputed for one in of)
    labelled = sum(bool(one.trial.labels) for one in of)
    origin = (
        "as the simulation notes them"
        if not labelled
        else f"labelled by hand in {counted(labelled, 'trial')}"
    )
    means = "; ".join(
        f"{state} {means['at_press'].estimate:.2f}, then {means['at_end'].estimate:.2f}"
        for state, means in found.items()
    )
    left = "".join(
        f" {counted(number, 'press')} {'is' if number == 1 else 'are'} left out: {why}."
        for number, why in (
            (presses - len(rows) - disputed, "their reason is not known"),
            (disputed, "annotators disagree"),
        )
        if number
    )
    return (
        "The probability of the true reason of a press, when it was pressed (dark) and at the end of the"
        " trial"
        " (light): means, with 95% intervals that resample teachers, and every press as a dot."
        f" {counted(len(rows), 'press')} in"
        f" {source_note([one.trial for one in of])} with the planner; true reasons {origin}. Means:"
        f" {means}.{left} At the end"
        f" means with the whole trial known, but not its task. Beliefs are those of {models_note(of)}."
    )


@for_print
def entropy_figure(of: Sequence[Believed]) -> StudyFigure:
    """The entropy of the task over time in every trial with the planner; those with a mistake in colour."""
    if not of:
        raise Missing("no trial was with the planner")
    trials = [one.trial for one in of]
    figure, (ax,) = figure_of(2.3, 1, f"{source_note(trials)} with the planner")
    told = any(one.truth for one in of)
    for one in of:
        wrong = "mistake" in one.truth.values()
        style = {"color": COLOURS[1], "linestyle": (0, (4, 1))} if wrong else {"color": COLOURS[0]}
        ax.plot(one.path.time, one.path.entropy, linewidth=0.8, alpha=0.8, **style)
        ax.plot(one.path.time[-1], one.path.entropy[-1], "o", markersize=2.2, color=style["color"])
    mistaken = sum("mistake" in one.truth.values() for one in of)
    if told:
        ax.plot([], [], color=COLOURS[0], label=f"no mistaken press ({len(of) - mistaken})")
        ax.plot([], [], color=COLOURS[1], linestyle=(0, (4, 1)), label=f"a mistaken press ({mistaken})")
        ax.legend(loc="upper right", borderaxespad=0.1)
    ax.set_xlim(left=0)
    ax.set_ylim(bottom=0)
    ax.set_xlabel("seconds")
    ax.set_ylabel("entropy of the task (nats)")
    rows = [
        {
            "trial_id": one.trial.trial_id,
            "teacher": teacher_of(one.trial),
            "time": float(time),
            "entropy": float(nats),
        }
        for one in of
        for time, nats in zip(one.path.time, one.path.entropy, strict=True)
    ]
    last = [float(one.path.entropy[-1]) for one in of]
    caption = (
        f"Entropy of the belief over tasks, the robot's cost, over time in {source_note(trials)} with the"
        " planner;"
        f" dots are the ends. It starts at {of[0].path.entropy[0]:.2f} nats, that of a uniform belief, and"
        " ends"
        f" between {min(last):.3f} and {max(last):.3f} nats."
        + (f" Dashed: {counted(mistaken, 'trial')} with a press known to be a mistake." if told else "")
        + f" Beliefs are those of {models_note(of)}."
    )
    return StudyFigure("entropy", figure, rows, caption)
