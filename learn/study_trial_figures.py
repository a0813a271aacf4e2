"""The paper's figures of one trial: recovery from a mistaken press, and the marginals of the true task."""

from typing import Any

from matplotlib.axes import Axes

from learn.plots import COLOURS, LINES
from learn.replay_figure import NAMES, mark_presses
from learn.study_beliefs import Believed, Recovery, models_note
from learn.study_style import StudyFigure, figure_of, for_print
from learn.study_trials import Missing, counted, teacher_of


@for_print
def recovery_figure(found: Recovery) -> StudyFigure:
    """P(each value of the field) over time round a mistaken press, and P(that press was a mistake)."""
    one, path = found.of, found.of.path
    trial, at = one.trial, path.time[found.step + 1]
    right = getattr(trial.task, found.field)
    balls = getattr(trial.world, "num_balls", 0)
    figure, (ax, strip) = figure_of(
        2.55 + 0.13 * balls,
        2,
        f"trial {trial.trial_id} ({trial.source})",
        sharex=True,
        height_ratios=[4.5, 0.1 + 0.36 * balls],
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
    ax.set_yticks([0, 0.25, 0.5, 0.75, 1])
    ax.set_ylabel("probability")
    figure.legend(loc="outside lower center", ncols=2, columnspacing=1.2)
    _held(strip, one, balls)
    strip.set_xlabel("seconds (grey lines: presses)")
    rows = _recovery_rows(found)
    return StudyFigure("mistake-recovery", figure, rows, _recovery_caption(found, float(at), right))


def _held(ax: Axes, one: Believed, balls: int) -> None:
    """A bar for each ball, where the robot holds it."""
    states, time = one.trial.states, one.path.time
    for ball in range(1, balls + 1):
        spans = [
            (time[t], time[t + 1] - time[t])
            for t, state in enumerate(states)
            if getattr(state, "held", 0) == ball
        ]
        ax.broken_barh(spans, (ball - 0.4, 0.8), color=COLOURS[(ball - 1) % 7], linewidth=0)
    ax.set_ylim(balls + 0.6, 0.4)
    ax.set_yticks(range(1, balls + 1))
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
        f" {teacher_of(found.of.trial)}). The press at {at:g} s was a mistake; it raised the probability"
        f" that {found.field} is {found.wrong} from {column[found.step]:.2f} to"
        f" {column[found.step + 1]:.2f}, where it is {right} in truth. At the end it stood at"
        f" {column[-1]:.2f}. Dotted: the probability that this press was a mistake, given the trial so far;"
        f" it went from {found.mistake[0]:.2f} to {found.mistake[-1]:.2f}. Below, which ball the robot held."
        " Chosen by rule: of all presses known to be mistakes in trials with the planner, the one with the"
        " greatest rise of a wrong value that was undone by the end. Beliefs are those of"
        f" {models_note([found.of])}."
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
        f" {teacher_of(trial)}), which {'shows' if trial.reason == 'final' else 'never showed'} Final at"
        f" {trial.duration:g} s. Solid and black: the true value; vertical lines: presses of the spacebar"
        f" ({counted(int(path.pressed.sum()), 'press')}). The true values end at: {ends}. {rule} Beliefs are"
        f" those of {models_note([one])}."
    )
    return StudyFigure("task-marginals", figure, rows, caption)
