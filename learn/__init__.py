"""Learning the teacher model from trials: fits, their certainty, comparisons.

Names load when they are first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

_HOME = {
    "Bounds": "learn.coordinates",
    "Certificate": "learn.certificate",
    "ClosedLoop": "learn.closed_loop",
    "Comparison": "learn.compare",
    "FitError": "learn.exposure",
    "FitResult": "learn.result",
    "MistakePrior": "learn.mstep",
    "Population": "learn.population",
    "Uncertainty": "learn.intervals",
    "Prior": "learn.prior",
    "compare_models": "learn.compare",
    "fit": "learn.em",
    "fit_population": "learn.empirical_bayes",
    "log_likelihood": "learn.estep",
    "log_likelihoods": "learn.estep",
    "responsibilities": "learn.estep",
    "run_closed_loop": "learn.closed_loop",
    "trial_hash": "learn.exposure",
    "uncertainty": "learn.certainty",
}
__all__ = [*sorted(_HOME)]

if TYPE_CHECKING:
    from learn.certainty import uncertainty as uncertainty
    from learn.certificate import Certificate as Certificate
    from learn.closed_loop import ClosedLoop as ClosedLoop
    from learn.closed_loop import run_closed_loop as run_closed_loop
    from learn.compare import Comparison as Comparison
    from learn.compare import compare_models as compare_models
    from learn.coordinates import Bounds as Bounds
    from learn.em import fit as fit
    from learn.empirical_bayes import fit_population as fit_population
    from learn.estep import log_likelihood as log_likelihood
    from learn.estep import log_likelihoods as log_likelihoods
    from learn.estep import responsibilities as responsibilities
    from learn.exposure import FitError as FitError
    from learn.exposure import trial_hash as trial_hash
    from learn.intervals import Uncertainty as Uncertainty
    from learn.mstep import MistakePrior as MistakePrior
    from learn.population import Population as Population
    from learn.prior import Prior as Prior
    from learn.result import FitResult as FitResult


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'learn' has no attribute {name!r}")
    value = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__]
