"""What stands behind a study's numbers: who took part, in which order, and how far annotators agree."""

from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np

from learn.study_trials import counted, teacher_of
from taskcomm.trials import Trial


def answer_rows(answers: Mapping[str, Sequence[float]]) -> list[dict[str, Any]]:
    """Each item that participants answered in numbers: n, mean, sd, least, greatest.

    >>> answer_rows({"age": [18.0, 20.0, 31.0]})[0]["mean"]
    23.0
    """
    return [
        {
            "item": item,
            "n": len(values),
            "mean": float(np.mean(values)),
            "sd": float(np.std(values, ddof=1)) if len(values) > 1 else None,
            "least": float(min(values)),
            "greatest": float(max(values)),
        }
        for item, values in answers.items()
        if values
    ]


def orders(trials: Sequence[Trial]) -> dict[tuple[str, ...], int]:
    """How many teachers had their conditions in which order, for those with more than one."""
    of: dict[str, list[Trial]] = {}
    for trial in trials:
        of.setdefault(teacher_of(trial), []).append(trial)
    found = Counter(
        tuple(trial.condition for trial in sorted(members, key=lambda trial: trial.trial_index))
        for members in of.values()
        if len({trial.condition for trial in members}) > 1
    )
    return dict(sorted(found.items()))


def agreement_rows(trials: Sequence[Trial]) -> list[dict[str, Any]]:
    """Every two annotators: presses that both labelled, share on which they agree, and Cohen's kappa.

    Kappa is (agreed - chance) / (1 - chance), chance being the agreement of two who label at random, each as
    often so as they do; None where both say one thing alone.

    Source: J. Cohen, A coefficient of agreement for nominal scales (1960).
    """
    pairs: dict[tuple[str, str], list[tuple[str, str]]] = {}
    for trial in trials:
        for said in trial.labelled.values():
            named = sorted((str(who), state) for who, state in said.items())
            for (one, first), (other, second) in combinations(named, 2):
                pairs.setdefault((one, other), []).append((first, second))
    return [
        {"first": one, "second": other, "presses": len(both), **_agreed(both)}
        for (one, other), both in sorted(pairs.items())
    ]


def _agreed(both: Sequence[tuple[str, str]]) -> dict[str, float | None]:
    share = sum(first == second for first, second in both) / len(both)
    left, right = (Counter(pair[place] for pair in both) for place in (0, 1))
    chance = sum(left[state] * right[state] for state in left) / len(both) ** 2
    return {"agreed": share, "kappa": None if chance == 1 else (share - chance) / (1 - chance)}


def background_sentences(trials: Sequence[Trial], answers: Mapping[str, Sequence[float]]) -> list[str]:
    """All of it in sentences, none for what there is not."""
    said = [
        f"{row['item'].capitalize()}: {row['least']:g} to {row['greatest']:g}, mean {row['mean']:.1f}"
        + (f", standard deviation {row['sd']:.1f}" if row["sd"] is not None else "")
        + f" (n = {row['n']})."
        for row in answer_rows(answers)
    ]
    found = orders(trials)
    if found:
        listed = "; ".join(f"{', then '.join(order)}: {number}" for order, number in found.items())
        said.append(f"Order of conditions, teachers: {listed}.")
    for row in agreement_rows(trials):
        kappa = "" if row["kappa"] is None else f", Cohen's kappa {row['kappa']:.2f}"
        said.append(
            f"Annotators {row['first']} and {row['second']} agree on {row['agreed']:.0%} of"
            f" {counted(row['presses'], 'press')}{kappa}."
        )
    return said
