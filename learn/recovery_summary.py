"""What a recovery came to: errors by parameter, the learning curve, and where learning begins to pay."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest

from learn.audit import AS_NONE
from learn.bootstrap import ratio_interval
from learn.coordinates import names_of, vector_of
from learn.recovery import REFERENCES
from taskcomm.teacher import TeacherModel

Row = Mapping[str, Any]
Floats = NDArray[np.float64]
RESAMPLES = 2000
LEVEL = 0.95


def scaled(parameter: str, value: float) -> float:
    """The scale that errors are counted on: log odds, log seconds, or, for delay and hold, seconds.

    >>> scaled("mistake", 0.5), scaled("that_mov.rise", 1.0), scaled("that_mov.delay", 0.5)
    (0.0, 0.0, 0.5)
    """
    name = parameter.split(".")[-1]
    if name in ("mistake", "peak"):
        return math.log(value / (1 - value)) if value > 0 else -math.inf
    return value if name in ("delay", "hold") else math.log(value)


def cells(rows: Iterable[Row]) -> dict[tuple[str, str, int], list[Row]]:
    """The fits by truth, source and size."""
    found: dict[tuple[str, str, int], list[Row]] = {}
    for row in rows:
        if row["source"] not in REFERENCES:
            found.setdefault((row["truth"], row["source"], row["size"]), []).append(row)
    return found


def parameter_rows(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """One flat row for each truth, source, size and learned parameter.

    Errors are learned minus true on the scale of `scaled`, over the studies that had data for the parameter:
    `bias` with its interval (studies resampled), `rmse`, and the 10th, 50th and 90th percentile. `no_data`,
    `at_bound` and `at_kink` are shares of all studies. `steps` and `presses` are those expected, per trial,
    to bear on the parameter at its true value. Of the studies that had an interval for it, `intervals`, the
    share `coverage` covered the true value; beside it the Wilson interval of that share.
    """
    truths = {row["truth"]: TeacherModel.from_dict(row["model"]) for row in rows if row["source"] == "true"}
    found = []
    for (truth, source, size), studies in cells(rows).items():
        names = names_of(list(truths[truth].approvals))
        true = dict(zip(names, vector_of(truths[truth]).tolist(), strict=True))
        learned = [vector_of(TeacherModel.from_dict(study["model"])) for study in studies]
        for place, name in enumerate(names):
            marks = [study["marks"][name] for study in studies]
            if all(mark == "fixed" for mark in marks):
                continue
            values = [float(vector[place]) for vector in learned]
            about = {"truth": truth, "source": source, "size": size, "parameter": name, "true": true[name]}
            errors = _errors(name, values, true[name], marks)
            found.append(about | errors | _covered(name, true[name], studies) | _exposed(name, studies))
    return found


def _errors(name: str, values: Sequence[float], true: float, marks: Sequence[str]) -> dict[str, Any]:
    informed = [value for value, mark in zip(values, marks, strict=True) if mark != "no data"]
    errors = np.array([scaled(name, value) for value in informed]) - scaled(name, true)
    bias = ratio_interval(errors, np.ones(len(errors)))
    spread = np.quantile(errors, [0.1, 0.5, 0.9]) if len(errors) else np.full(3, math.nan)
    shares = {
        what: float(np.mean([mark in texts for mark in marks]))
        for what, texts in {
            "no_data": ["no data"],
            "at_bound": ["at its bound", AS_NONE],
            "at_kink": ["at a kink"],
        }.items()
    }
    return {
        "studies": len(values),
        "bias": bias.estimate,
        "bias_low": bias.low,
        "bias_high": bias.high,
        "rmse": float(np.sqrt(np.mean(errors**2))) if len(errors) else math.nan,
        **dict(zip(("error_10", "median_error", "error_90"), map(float, spread), strict=True)),
        **shares,
    }


def _covered(name: str, true: float, studies: Sequence[Row]) -> dict[str, float]:
    """How often the intervals hold the true value; rounding apart."""
    found = [study["intervals"][name] for study in studies if name in study.get("intervals", ())]
    inside = [
        (low is None or low <= true * (1 + 1e-9)) and (high is None or true * (1 - 1e-9) <= high)
        for low, high in found
    ]
    share, ends = math.nan, (math.nan, math.nan)
    if inside:
        counted = binomtest(sum(inside), len(inside))
        share, ends = float(counted.statistic), counted.proportion_ci(method="wilson")
    return {"intervals": len(inside), "coverage": share, "coverage_low": ends[0], "coverage_high": ends[1]}


def _exposed(name: str, studies: Sequence[Row]) -> dict[str, float]:
    return {
        what: float(np.mean([study[what][name] / study["size"] for study in studies]))
        for what in ("steps", "presses")
    }


def _score_matrix(rows: Iterable[Row]) -> Floats:
    return np.array([row["scores"] for row in rows], dtype=np.float64)


def _drawn(matrix: Floats, columns: Floats, rng: np.random.Generator) -> Floats:
    """Means of the matrix with rows resampled, and columns as they were already, one for each draw."""
    count = len(matrix)
    rows = rng.multinomial(count, np.full(count, 1 / count), size=len(columns)) / count
    return np.asarray(((rows @ matrix) * columns).sum(axis=1), dtype=np.float64)


def _columns(count: int, rng: np.random.Generator) -> Floats:
    return np.asarray(rng.multinomial(count, np.full(count, 1 / count), size=RESAMPLES) / count)


def _ends(draws: Floats) -> tuple[float, float]:
    low, high = np.quantile(draws, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return float(low), float(high)


def curve_rows(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """The learning curve: one flat row for each truth, source and size.

    In nats per fresh trial: `gain` is learned minus intuitive, `short` is true minus learned. Intervals
    resample both the studies and the fresh trials. `possible` is true minus intuitive. `better` is the share
    of studies whose model beats the intuitive one on all the fresh trials together.
    """
    found = []
    for (truth, source, size), studies in cells(rows).items():
        true, intuitive = (_reference(rows, truth, name) for name in REFERENCES)
        learned, rng = _score_matrix(studies), np.random.default_rng(0)
        columns = _columns(learned.shape[1], rng)
        gain, short = learned - intuitive, true - learned
        row: dict[str, Any] = {"truth": truth, "source": source, "size": size, "studies": len(studies)}
        for name, values in (("gain", gain), ("short", short)):
            low, high = _ends(_drawn(values, columns, rng))
            row |= {name: float(values.mean()), f"{name}_low": low, f"{name}_high": high}
        row["possible"] = float((true - intuitive).mean())
        row["better"] = float((gain.mean(axis=1) > 0).mean())
        row["not_converged"] = float(np.mean([not study["converged"] for study in studies]))
        row["trial_steps"] = float(np.mean([study["steps_in_all"] / size for study in studies]))
        row["trial_presses"] = float(np.mean([study["presses_in_all"] / size for study in studies]))
        found.append(row)
    return found


def _reference(rows: Iterable[Row], truth: str, source: str) -> Floats:
    (row,) = (row for row in rows if row["truth"] == truth and row["source"] == source)
    return np.array(row["scores"], dtype=np.float64)


@dataclass(frozen=True)
class Crossing:
    """From how many trials on the learned model foresees better than the intuitive one.

    0 where it did at every size tried, from `smallest` up, infinite where it did not at `largest`.
    """

    estimate: float
    low: float
    high: float
    smallest: int
    largest: int

    def text(self, value: float) -> str:
        """A number of trials, as far as it is known.

        >>> crossing = Crossing(5.2, 0.0, float("inf"), 2, 200)
        >>> crossing.text(5.2), crossing.text(0.0), str(crossing)
        ('5', '≤ 2', '5 (≤ 2 to > 200)')
        """
        if value == 0:
            return f"≤ {self.smallest}"
        return f"{value:.0f}" if math.isfinite(value) else f"> {self.largest}"

    def __str__(self) -> str:
        return f"{self.text(self.estimate)} ({self.text(self.low)} to {self.text(self.high)})"


def crossing(rows: Sequence[Row], truth: str, source: str) -> Crossing:
    """Where the mean gain over the intuitive model rises above 0 for good, log-linear between sizes.

    The interval resamples studies and fresh trials. Studies of different sizes share trials, which it does
    not know.
    """
    sizes = sorted(size for name, kind, size in cells(rows) if (name, kind) == (truth, source))
    intuitive, rng = _reference(rows, truth, "intuitive"), np.random.default_rng(0)
    columns = _columns(len(intuitive), rng)
    matrices = [_score_matrix(cells(rows)[truth, source, size]) - intuitive for size in sizes]
    draws = np.stack([_drawn(matrix, columns, rng) for matrix in matrices], axis=1)
    at = [_crossed(sizes, gains) for gains in draws]
    low, high = np.quantile(at, [(1 - LEVEL) / 2, (1 + LEVEL) / 2], method="inverted_cdf")
    estimate = _crossed(sizes, np.array([matrix.mean() for matrix in matrices]))
    return Crossing(estimate, float(low), float(high), sizes[0], sizes[-1])


def _crossed(sizes: Sequence[int], gains: Floats) -> float:
    below = np.flatnonzero(gains <= 0)
    if not len(below):
        return 0.0
    last = int(below[-1])
    if last == len(sizes) - 1:
        return math.inf
    share = gains[last] / (gains[last] - gains[last + 1])
    return float(sizes[last] * (sizes[last + 1] / sizes[last]) ** share)
