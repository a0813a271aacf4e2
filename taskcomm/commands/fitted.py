"""A fit, told: the table of parameters, the certificate, and the same as JSON."""

from collections.abc import Callable, Sequence
from typing import Any, cast

from learn.certainty import uncertainty
from learn.certificate import SURPASSED
from learn.coordinates import model_at
from learn.exposure import FitError
from learn.intervals import Method, Uncertainty
from learn.report import parameter_table
from learn.result import FitResult
from taskcomm.channels import ObservationModel
from taskcomm.commands.terminal import Terminal
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial


def with_intervals(
    result: FitResult,
    trials: Sequence[Trial],
    kind: str,
    seed: int,
    jobs: int,
    terminal: Terminal,
    again: Callable[[TeacherModel], FitResult],
) -> FitResult:
    """The fit with its intervals, of `kind` likelihood, wald or bootstrap; as it is with none.

    Where the profiles find a model more likely than the fit, it is made `again`, begun from that one too; if
    they still do, the certificate says so. A degenerate fit gets none: there is nothing to be sure of.
    Raises FitError where there can be none.
    """
    if kind == "none" or result.certificate.kind == "degenerate":
        return result
    found = _found(result, trials, kind, seed, jobs, terminal)
    if found.above > SURPASSED and found.highest is not None:
        terminal.message(
            f"the intervals found a model {found.above:.2f} nats more likely than the fit: fitting again,"
            " from there too"
        )
        result = again(model_at(found.highest, result.model))
        found = _found(result, trials, kind, seed, jobs, terminal)
    return result.with_uncertainty(found)


def _found(
    result: FitResult, trials: Sequence[Trial], kind: str, seed: int, jobs: int, terminal: Terminal
) -> Uncertainty:
    total = 200 if kind == "bootstrap" else len(result.certificate.ridges) + result.num_free
    learned = [name for name in ("delays", "decays", "holds") if getattr(result.settings, name)]
    if kind == "likelihood" and learned:
        terminal.message(
            f"intervals from the likelihood: with {' and '.join(learned)} they may take many times as long as"
            " the fit; --intervals wald is quick, --intervals none leaves them out"
        )
    try:
        with terminal.progress("intervals", total) as progress:
            return uncertainty(
                result, trials, method=cast(Method, kind), seed=seed, jobs=jobs,
                progress=lambda done, _: progress(done),
            )  # fmt: skip
    except ValueError as error:
        raise FitError(f"--intervals {kind}: {error}") from None


def say_widened(start: TeacherModel, longest: float | None, terminal: Terminal) -> None:
    """Say where the initial model is itself beyond --longest, which then does not hold for it."""
    tops = start.approvals.items()
    times = {f"{state}.{name}": getattr(top, name) for name in ("rise", "fall") for state, top in tops}
    beyond = [name for name in times if longest is not None and times[name] > longest]
    if beyond:
        name = max(beyond, key=lambda name: times[name])
        terminal.message(
            f"warning: --longest {longest:g}: the initial model has {name} = {times[name]:g} s, so"
            f" {len(beyond)} of its rises and falls may stay as long as they are; an --initial with shorter"
            " ones does not widen it"
        )


def document(result: FitResult) -> dict[str, Any]:
    """What `--json` tells of a fit."""
    return {
        "converged": result.converged,
        "status": result.status,
        "log_likelihood": result.log_likelihood,
        "dropped": result.dropped,
        "certificate": result.certificate.to_dict(),
        "parameters": [row.to_dict() for row in result.table()],
        "audit": result.audit_to_dict(),
        "uncertainty": None if result.uncertainty is None else _summary(result.uncertainty),
        "remarks": list(result.remarks),
        "observation": result.model.observation.to_dict(),
    }


def _summary(found: Uncertainty) -> dict[str, Any]:
    """How the intervals were made; they themselves stand with the parameters."""
    return {key: getattr(found, key) for key in ("method", "level", "teachers", "above", "resamples", "seed")}


def _observed(seen: ObservationModel, name: str) -> str:
    """What was learned of one part of the observation model; a channel is too much for a line."""
    if name in seen.channels:
        return "a channel, in the model file"
    return f"{getattr(seen, name):.3g} per step"


def say(result: FitResult, trials: int, terminal: Terminal) -> None:
    """Table, certificate and remarks for people."""
    terminal.table(
        f"Teacher model fitted to {trials} trials: log-likelihood {result.log_likelihood:.2f} nats",
        *parameter_table(result),
    )
    if result.settings.prior is not None:
        terminal.line(f"prior: the initial model, as {result.settings.prior.trials:g} trials would hold it")
    if result.settings.dropped_mass:
        terminal.line(
            f"left out: memories that would raise the initial model's log-likelihood by at most"
            f" {result.dropped:.2g} nats"
        )
    for name in result.settings.observe:
        terminal.line(f"observed: {name}: {_observed(result.model.observation, name)}")
    for verdict in ("weak", "none"):
        which = [f"{each.parameter} ({each.why})" for each in result.audit if each.verdict == verdict]
        if which:
            terminal.line(f"{verdict}: {', '.join(which)}")
    terminal.line()
    terminal.line("Certificate")
    for line in result.certificate.lines():
        terminal.line(f"  {line}")
    for remark in result.wider_remarks:
        terminal.line(f"- {remark}")
