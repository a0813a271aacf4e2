"""What a fit found, how it got there, and how much it may be trusted."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf
from typing import NamedTuple

from learn.certificate import Certificate
from learn.coordinates import NAMES, names_of, vector_of
from learn.settings import Settings
from taskcomm.lattice import Bools, Floats
from taskcomm.teacher import TeacherModel

OPTIONAL = (".delay", ".decay", ".hold")


class Start(NamedTuple):
    """One start of a fit: its name, the log-likelihoods (with prior) that EM began and ended with, how
    many iterations it took, whether they converged, and what the search made of it."""

    name: str
    begun: float
    em_alone: float
    iterations: int
    converged: bool
    searched: float


class Row(NamedTuple):
    """One parameter: before and after, the expected steps and presses that informed it, and remarks."""

    parameter: str
    initial: float
    learned: float
    presses: float
    steps: float
    mark: str


@dataclass(frozen=True)
class FitResult:
    """A fitted teacher model.

    `model` carries its provenance. `certificate` says whether the fit may be trusted; `converged` and
    `status` are its answer and that in words: True only if EM converged within its iterations, no
    one-sided slope at the end is above the tolerance, and the maximum is not degenerate.
    `log_likelihood` is that of the presses, in nats, without the priors; `objective` is with them, up to a
    constant. `paths` holds the objective of every iteration of every start, the search included, and
    `monotone` says that it never fell. `starts` is the table of starts, `em_alone` the best that EM
    reached without the search, `search_gain` what the search added. `steepest` is the greatest
    one-sided slope at the end, in nats per unit of log parameter (per second of delay).

    `responsibilities` holds, trial by trial, P(M_t = m | trial) of every press, shape (presses, mental
    states). `steps` and `presses` count, for every parameter, the expected steps and presses whose
    probability it changes (for mistake: steps in which nothing else could be the reason, and expected
    mistakes). `marks` are remarks by parameter: "no data", "fixed", "at its bound", "at a kink",
    "ridge"; `remarks` says the same in sentences. `num_free` is how many coordinates were learned (a
    shared parameter is one), for BIC; `free` (1 + 6 M,) which parameters.
    """

    model: TeacherModel
    initial: TeacherModel
    log_likelihood: float
    objective: float
    converged: bool
    status: str
    iterations: int
    paths: tuple[Floats, ...]
    starts: tuple[Start, ...]
    best_start: int
    em_alone: float
    search_gain: float
    steepest: float
    monotone: bool
    trial_ids: tuple[str, ...]
    trial_hashes: tuple[str, ...]
    log_likelihoods: Floats
    responsibilities: tuple[Floats, ...]
    steps: Mapping[str, float]
    presses: Mapping[str, float]
    marks: Mapping[str, str]
    remarks: tuple[str, ...]
    free: Bools
    num_free: int
    settings: Settings
    certificate: Certificate

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters: mistake, that_mov.peak, ..."""
        return names_of(list(self.model.approvals))

    def table(self) -> tuple[Row, ...]:
        """A row for each parameter: mistake, then approval by approval.

        Delays, decays and holds have one only where they were learned, or given.
        """
        before = dict(zip(self.parameters, map(float, vector_of(self.initial)), strict=True))
        after = dict(zip(self.parameters, map(float, vector_of(self.model)), strict=True))
        order = ["mistake"] + [f"{state}.{name}" for state in self.model.approvals for name in NAMES]
        return tuple(
            Row(name, before[name], after[name], self.presses[name], self.steps[name], self.marks[name])
            for name in order
            if not name.endswith(OPTIONAL) or self.marks[name] != "fixed" or before[name] not in (0, inf)
        )
