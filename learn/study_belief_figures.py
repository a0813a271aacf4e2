"""The paper's figures of what the robot believed in all trials: the reasons of presses, and entropy."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from learn.plots import COLOURS
from learn.study_beliefs import Believed, accuracy, accuracy_rows, models_note, planned_note
from learn.study_style import DARK, LIGHT, StudyFigure, figure_of, for_print
from learn.study_trials import Missing, counted, teacher_of


@for_print
def accuracy_figure(of: Sequence[Believed], seed: int = 0) -> StudyFigure:
    """P(the true mental state) when it was pressed (dark) and at the end of the trial (light), by state."""
    rows = accuracy_rows(of)
    if not rows:
        raise Missing("no reason of a press is known, from a simulation or a label")
    found = accuracy(rows, seed)
    figure, (ax,) = figure_of(2.3, 1, f"{planned_note(of)}, {counted(len(rows), 'press')}")
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
            if mean.groups > 1:
                bars = [[mean.estimate - mean.low], [mean.high - mean.estimate]]
                ax.errorbar(place + shift, mean.estimate, bars, color=COLOURS[1], capsize=2.5, linewidth=1.3)
    ax.set_xticks(range(len(found)), [_state_label(state, rows) for state in found])
    ax.set_ylim(0, 1.03)
    ax.set_yticks([0, 0.25, 0.5, 0.75, 1])
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
    who = sorted({str(label.get("annotator")) for one in of for label in one.trial.labels})
    origin = f"as labelled by {', '.join(who)}" if who else "as the simulation notes them"
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
    data = f"{counted(len(rows), 'press')} in {planned_note(of)}"
    return (
        "The probability of the true reason of a press, when it was pressed (dark) and at the end of the"
        " trial (light): means, with 95% intervals that resample teachers, and every press as a dot."
        f" {data}; true reasons {origin}. Means: {means}.{left} At the end means with the whole trial known,"
        f" but not its task. Beliefs are those of {models_note(of)}."
    )


@for_print
def entropy_figure(of: Sequence[Believed]) -> StudyFigure:
    """The entropy of the task over time in every trial with the planner; those with a mistake in colour."""
    if not of:
        raise Missing("no trial was with the planner")
    figure, (ax,) = figure_of(2.5, 1, planned_note(of))
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
        figure.legend(loc="outside lower center", ncols=2)
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
        f"Entropy of the belief over tasks, the robot's cost, over time in {planned_note(of)}; dots are the"
        f" ends. It starts at {of[0].path.entropy[0]:.2f} nats, that of a uniform belief, and ends between"
        f" {min(last):.3f} and {max(last):.3f} nats."
        + (f" Dashed: {counted(mistaken, 'trial')} with a press known to be a mistake." if told else "")
        + f" Beliefs are those of {models_note(of)}."
    )
    return StudyFigure("entropy", figure, rows, caption)
