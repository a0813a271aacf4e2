"""What a fit found, how it got there, and how much it may be trusted."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import inf, isfinite
from typing import Any, NamedTuple, Self

from learn.audit import Audited, audited
from learn.certificate import Certificate
from learn.coordinates import NAMES, names_of, vector_of
from learn.intervals import ParameterInterval, Uncertainty
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
    """One parameter: before and after, the expected steps and presses that informed it, and remarks.

    `verdict` is that of `learn.audit`; `interval` is there once uncertainty is.
    """

    parameter: str
    initial: float
    learned: float
    presses: float
    steps: float
    mark: str
    verdict: str
    interval: ParameterInterval | None

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON: no decay is None, an open end of the interval too."""
        plain = {k: None if v in (inf, -inf) else v for k, v in self._asdict().items() if k != "interval"}
        if self.interval is None or self.interval.low is None:
            return plain | {"low": None, "high": None, "interval": "none"}
        own = self.interval
        low, high = None if own.open_low else own.low, None if own.open_high else own.high
        return plain | {"low": low, "high": high, "interval": own.how}


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
    mistakes). `marks` are remarks by parameter: "no data", "fixed", "flat", "at its bound", "at a kink",
    "ridge", of a decay "as good as none"; `remarks` says the same in sentences. `num_free` is how many
    coordinates were learned (a shared parameter is one), for BIC; `free` (1 + 6 M,) which parameters.
    `dropped` (nats) bounds what the memories left out for `dropped_mass` would add to the log-likelihood of
    the initial model. `uncertainty` is None until `with_uncertainty`.
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
    dropped: float = 0.0
    uncertainty: Uncertainty | None = None

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters: mistake, that_mov.peak, ..."""
        return names_of(list(self.model.approvals))

    @property
    def wider_remarks(self) -> tuple[str, ...]:
        """Those of `remarks` that are of an approval state or of all, which no mark of a parameter says."""
        return tuple(remark for remark in self.remarks if remark.split()[0] not in self.marks)

    @property
    def audit(self) -> tuple[Audited, ...]:
        """What bears on each parameter and a verdict, see `learn.audit`, in the order of `parameters`."""
        found = {} if self.uncertainty is None else self.uncertainty.by_parameter
        return tuple(
            audited(name, self.steps[name], self.presses[name], self.marks[name], found.get(name))
            for name in self.parameters
        )

    def table(self) -> tuple[Row, ...]:
        """A row for each parameter: mistake, then approval by approval.

        Delays, decays and holds have one only where they were learned, or given. Where uncertainty says
        of a peak and a rise that their ratio alone is known, that ratio has a row too.
        """
        before = dict(zip(self.parameters, map(float, vector_of(self.initial)), strict=True))
        after = dict(zip(self.parameters, map(float, vector_of(self.model)), strict=True))
        found = {} if self.uncertainty is None else self.uncertainty.by_parameter
        of = {each.parameter: each for each in self.audit}
        order = ["mistake"] + [f"{state}.{name}" for state in self.model.approvals for name in NAMES]
        rows = []
        for name in order:
            if not name.endswith(OPTIONAL) or self.marks[name] != "fixed" or before[name] not in (0, inf):
                known = (self.presses[name], self.steps[name], self.marks[name], of[name].verdict)
                rows.append(Row(name, before[name], after[name], *known, found.get(name)))
            if (ratio := found.get(f"{name}/rise")) is not None:
                rise = name.replace(".peak", ".rise")
                known = (self.presses[name], self.steps[name], "", "informed")
                at_first = before[name] / before[rise]
                rows.append(Row(ratio.parameter, at_first, ratio.estimate, *known, ratio))
        return tuple(rows)

    def with_uncertainty(self, found: Uncertainty) -> Self:
        """The result with intervals: in its table, its audit, its certificate, and its model's provenance."""
        seen = self.certificate.with_profiles(found.above)
        result = replace(
            self, uncertainty=found, certificate=seen, converged=seen.trusted, status=seen.status
        )
        finite = tuple(each for each in found.intervals if isfinite(each.estimate))  # JSON knows no other
        kept = replace(found, intervals=finite).to_dict()
        judged = {"converged": seen.trusted, "status": seen.status, "certificate": seen.to_dict()}
        audit = {"audit": result.audit_to_dict(), "uncertainty": kept}
        note = {**self.model.provenance, **judged, **audit}
        return replace(result, model=replace(self.model, provenance=note))

    def audit_to_dict(self) -> dict[str, dict[str, Any]]:
        """The audit as plain values, by parameter, for provenance."""
        return {
            each.parameter: {k: v for k, v in each.to_dict().items() if k != "parameter"}
            | {"mark": self.marks[each.parameter]}
            for each in self.audit
        }
