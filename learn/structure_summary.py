"""What searches of simulated truths came to: confusions, and whether what is named holds the truth."""

import csv
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from learn.candidates import CUE_OF, NONE, Structure
from learn.coverage import proportion_interval
from learn.structure_study import DIFFER, text_of, truths

OTHER = "other"
KINDS = ("cue", "rest", "delay", "decay")
Row = Mapping[str, str]


def read_rows(path: Path) -> list[dict[str, str]]:
    """The rows of a kept table."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def label_of(structure: str) -> str:
    """The truth whose structure this is, whether a delay or decay is shared or not; else `other`.

    >>> label_of("mov_lit, wrt_lit_while_mov_held, mov_at_dist; delay per state; decay shared")
    'delay + decay'
    """
    plain = structure.replace("per state", "shared")
    for name, model in truths().items():
        true = Structure.of(model)
        found, _, rest = plain.partition("; rest")
        if found == str(true.with_value("rest", 0.0)) and bool(rest) == (true.rest > 0):
            return name
    return OTHER


def confusion(rows: Iterable[Row], size: int) -> dict[str, Counter[str]]:
    """By truth, how often each was chosen, of the studies of one size."""
    counts: dict[str, Counter[str]] = {name: Counter() for name in truths()}
    for row in rows:
        if int(row["trials"]) == size:
            counts[row["truth"]][label_of(row["chosen"])] += 1
    return counts


@dataclass(frozen=True)
class Claim:
    """What one search named of one factor. `kind` is cue, rest, delay or decay.

    `holds`: the true value is among those named. `told`: one is named alone, or, of a delay, decay or rest,
    all that are named say that there is one. `right`: told, and so it is.
    """

    truth: str
    trials: int
    kind: str
    present: bool
    holds: bool
    told: bool
    right: bool


def claims(rows: Iterable[Row]) -> list[Claim]:
    """Every factor of every search."""
    found = []
    true = {name: Structure.of(model) for name, model in truths().items()}
    intuitive = true["intuitive"]
    for row in rows:
        for factor in intuitive.factors:
            value, plain = (text_of(each.value(factor)) for each in (true[row["truth"]], intuitive))
            named = row[factor].split("|")
            if factor.startswith(CUE_OF):
                told = len(named) == 1
                right = told and named == [value]
            else:
                told = len({name in (NONE, "0") for name in named}) == 1
                right = told and (named[0] in (NONE, "0")) == (value in (NONE, "0"))
            kind = "cue" if factor.startswith(CUE_OF) else factor
            found.append(
                Claim(row["truth"], int(row["trials"]), kind, value != plain, value in named, told, right)
            )
    return found


def share(hits: Sequence[bool]) -> dict[str, Any]:
    """How many, and what share with its Wilson 95% interval."""
    if not hits:
        return {"of": 0, "share": None, "low": None, "high": None}
    low, high = proportion_interval(sum(hits), len(hits))
    ends = {"low": round(low, 4), "high": round(high, 4)}
    return {"of": len(hits), "share": round(sum(hits) / len(hits), 4), **ends}


def claim_rows(rows: Iterable[Row]) -> list[dict[str, Any]]:
    """By size and kind of factor: shares of what holds the truth, what is told, and, of that, what is right.

    The truth DIFFER is left out: the claims are of teachers who are alike.
    """
    every = [claim for claim in claims(rows) if claim.truth != DIFFER]
    found = []
    for size in sorted({claim.trials for claim in every}):
        for kind in KINDS:
            here = [claim for claim in every if claim.trials == size and claim.kind == kind]
            told = [claim for claim in here if claim.told]
            found.append(
                {
                    "trials": size,
                    "factor": kind,
                    **{f"holds_{k}": v for k, v in share([claim.holds for claim in here]).items()},
                    **{f"told_{k}": v for k, v in share([claim.told for claim in here]).items() if k != "of"},
                    **{f"right_{k}": v for k, v in share([claim.right for claim in told]).items()},
                }
            )
    return found


def difference_rows(rows: Iterable[Row]) -> list[dict[str, Any]]:
    """How many studies each difference from the intuitive structure takes to be found.

    By kind and size, of the studies whose truth has it: in how many it was told, in how many it could not be
    told, and in how many it was denied.
    """
    every = [claim for claim in claims(rows) if claim.present]
    found = []
    for kind in KINDS:
        for size in sorted({claim.trials for claim in every}):
            here = [claim for claim in every if (claim.kind, claim.trials) == (kind, size)]
            found.append(
                {
                    "difference": kind,
                    "trials": size,
                    "studies": len(here),
                    "told": sum(claim.right for claim in here),
                    "cannot_tell": sum(not claim.told for claim in here),
                    "denied": sum(claim.told and not claim.right for claim in here),
                }
            )
    return found
