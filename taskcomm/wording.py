"""A contingent plan in words, for people who build the robot."""

from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any

from taskcomm.contingency import ALIKE, Branch, Floats, Group, PlannedStep, Shift, part_of, parts_of, shifts

HARDLY = 0.01  # a marginal that moves less is not spoken of
NAMED = 3  # more tasks, groups or reasons than this are counted, not named


def duration(steps: int, dt: float) -> str:
    """
    >>> duration(5, 0.5)
    '5 steps (2.5 s)'
    """
    return f"{steps} step{'s' if steps > 1 else ''} ({steps * dt:g} s)"


def percent(probability: float) -> str:
    """
    >>> percent(0.0133), percent(0.32), percent(0.9987), percent(1e-6)
    ('1.3%', '32%', '99.9%', '<0.1%')
    """
    if probability < 0.0005:
        return "<0.1%"
    return f"{probability:.0%}" if 0.0995 <= probability < 0.995 else f"{probability:.1%}"


def tasks_in_words(some: Sequence[Any], tasks: Sequence[Any], named: Sequence[Any] = ()) -> str:
    """`some` of `tasks` by the parts that single them out, of all of them or of those not yet `named`.

    >>> from taskcomm.tasks import enumerate_tasks
    >>> tasks = enumerate_tasks(3, 4)
    >>> tasks_in_words(tasks[8:], tasks), tasks_in_words(tasks[1:8], tasks, named=tasks[:1])
    ('mov=2|3', 'other mov=1')
    >>> tasks_in_words(["soup", "pizza"], ["soup", "pizza", "paella"])
    'soup|pizza'
    """
    if len(some) == len(tasks):
        return "any task"
    if len(some) + len(named) == len(tasks) and named:
        return "the others"
    left = [task for task in tasks if task not in named]
    texts = (_singled_out(some, tasks), _singled_out(some, left) and f"other {_singled_out(some, left)}")
    if any(texts):
        return min((text for text in texts if text), key=len)
    return "|".join(str(task) for task in some) if len(some) <= NAMED else f"{len(some)} tasks"


def _singled_out(some: Sequence[Any], tasks: Sequence[Any]) -> str:
    """The fewest parts that `some` alone have among `tasks`; "" if there are none, or tasks have no parts."""
    parts = parts_of(tasks)
    wanted = {part: list(dict.fromkeys(part_of(task, part) for task in some)) for part in parts}
    for part in reversed(parts):
        if _picked(wanted, tasks, but=part) == len(some):
            del wanted[part]
    if parts == ("task",) or _picked(wanted, tasks) > len(some):
        return ""
    return " ".join(f"{part}={'|'.join(map(str, values))}" for part, values in wanted.items())


def _picked(wanted: Mapping[str, Sequence[Any]], tasks: Sequence[Any], but: str = "") -> int:
    """How many tasks have the wanted parts, but for one of them."""
    return sum(
        all(part_of(task, part) in values for part, values in wanted.items() if part != but) for task in tasks
    )


def groups_in_words(groups: Sequence[Group], tasks: Sequence[Any]) -> str:
    """Which tasks a step tells apart."""
    if len(groups) == 1:
        return f"a press has {percent(groups[0].press_probability)} under any task, and tells nothing"
    among = [task for task in tasks if any(task in group.tasks for group in groups)]
    said, named = [], list[Any]()
    for group in groups:
        said.append(f"{percent(group.press_probability)} under {tasks_in_words(group.tasks, among, named)}")
        named += group.tasks
    if len(groups) > NAMED:
        said[NAMED - 1 :] = [f"down to {said[-1]} ({len(groups)} groups of tasks)"]
    return f"a press has {', '.join(said)}"


def shifts_in_words(tasks: Sequence[Any], before: Floats, after: Floats, *, pressed: bool) -> str:
    """For each part of the task, what a press speaks for most, or silence against; the greatest shift first.

    >>> import numpy as np
    >>> shifts_in_words(["soup", "pizza"], np.array([0.5, 0.5]), np.array([0.25, 0.75]), pressed=True)
    'task=pizza 0.50 -> 0.75'
    """
    moved = shifts(tasks, before, after)[:: 1 if pressed else -1]
    said: dict[str, str] = {}
    for first in moved:
        if first.part in said or abs(first.after - first.before) < HARDLY:
            continue
        alike = sorted(str(shift.value) for shift in moved if _is_alike(shift, first))
        each = " each" if len(alike) > 1 else ""
        said[first.part] = f"{first.part}={'|'.join(alike)} {first.before:.2f} -> {first.after:.2f}{each}"
    return ", ".join(said.values()) or "the belief hardly moves"


def _is_alike(one: Shift, other: Shift) -> bool:
    """Whether they are of one part, from and to the same probabilities but for rounding."""
    difference = max(abs(one.before - other.before), abs(one.after - other.after))
    return one.part == other.part and difference < ALIKE


def press_in_words(branch: Branch) -> str:
    """The probability of a press, and why it would be made."""
    reasons = sorted(branch.reasons.items(), key=lambda reason: -reason[1])
    why = ", ".join(f"{state} {percent(p)}" for state, p in reasons[:NAMED] if p >= HARDLY)
    return f"{percent(branch.probability)}: {why}"


def plan_in_words(root: PlannedStep, tasks: Sequence[Any], presses: Sequence[Branch]) -> list[str]:
    """The plan as lines, step by step, what follows a press further in; only `presses` are followed."""
    shown = {id(branch) for branch in presses}
    lines, left_out = ["Plan:"], []

    def say(first: PlannedStep, start: int, indent: str) -> None:
        for number, step in enumerate(first.chain(), start):
            lines.append(f"{indent}{number}. {step.action}: {groups_in_words(step.groups, tasks)}")
            if id(step.press) not in shown:
                left_out.append(step.press)
                continue
            said = shifts_in_words(tasks, step.before, step.press.marginal, pressed=True)
            line = f"{indent}   if pressed ({press_in_words(step.press)}): {said}"
            then, silent = step.press.then, step.silent.then
            if then is None:
                lines.append(line)
            elif silent is not None and then.is_same_plan(silent):
                lines.append(f"{line}; then as if not pressed")
            elif any(id(later.press) in shown for later in then.chain()):
                lines.append(f"{line}; then")
                say(then, number + 1, indent + "      ")
            else:
                lines.append(f"{line}; then {actions_in_words(then)}")
                left_out.extend(later.press for later in then.chain())

    say(root, 1, "  ")
    *_, last = root.chain()
    moved = shifts_in_words(tasks, root.before, last.silent.marginal, pressed=False)
    count = sum(1 for _ in root.chain())
    lines.append(f"  No press in {count} step{'s' * (count > 1)} ({percent(last.silent.reach)}): {moved}.")
    if left_out:
        together = percent(sum(branch.reach for branch in left_out))
        lines.append(f"  Not followed: {len(left_out)} less likely presses, together {together}.")
    return lines


def actions_in_words(first: PlannedStep) -> str:
    """The actions of a plan as long as nothing is pressed."""
    runs = groupby(str(step.action) for step in first.chain())
    counted = ((action, sum(1 for _ in run)) for action, run in runs)
    return ", ".join(f"{action} x{count}" if count > 1 else action for action, count in counted)
