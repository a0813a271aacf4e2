"""Priors on all that is learned: a model believed beforehand, worth so many trials."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from taskcomm.lattice import Floats
from taskcomm.teacher import TeacherModel


@dataclass(frozen=True)
class Prior:
    """What is believed before the trials: `model`, as firmly as `trials` trials with the same cues would.

    A normal density over the free coordinates (log odds, logarithms of times), centred on `model` (by
    default the initial model of the fit), whose precision is `trials` times the information that one of
    the fitted trials would hold on average if the teachers were `model`: a unit-information prior, but for
    its strength. 0 is no prior; as it grows the fit goes to `model`. What no trial could inform, no prior
    of this kind informs either. The information is an average over `draws` imaginary trials: cues of the
    trials, presses drawn from `model` with `seed`.

    Raises ValueError naming the field.

    Source: Kass and Wasserman, A reference Bayesian test for nested hypotheses and its relationship to the
    Schwarz criterion, 1995.
    """

    trials: float
    model: TeacherModel | None = None
    draws: int = 100
    seed: int = 0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.trials) and self.trials >= 0):
            raise ValueError(f"prior.trials: must be a number of trials, 0 or more, not {self.trials!r}")
        if self.draws < 1:
            raise ValueError(f"prior.draws: must be at least 1, not {self.draws!r}")

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for provenance; the model by its hash."""
        centre = None if self.model is None else self.model.sha256
        return {"trials": self.trials, "model_sha256": centre, "draws": self.draws, "seed": self.seed}


@dataclass(frozen=True)
class Pull:
    """log prior = -(x - centre) precision (x - centre) / 2, over the k free coordinates x.

    `centre` (k,), `precision` (k, k) in nats per squared unit of coordinate.

    >>> pull = Pull(np.zeros(1), np.array([[4.0]]))
    >>> pull.log_density(np.ones(1)), float(pull.rates(np.ones(1))[0])
    (-2.0, -4.0)
    """

    centre: Floats
    precision: Floats

    def log_density(self, point: Floats) -> float:
        """Up to a constant, in nats: 0 at the centre."""
        away = point - self.centre
        return -0.5 * float(away @ self.precision @ away)

    def rates(self, point: Floats) -> Floats:
        """Derivatives of `log_density` in the coordinates."""
        return np.asarray(-self.precision @ (point - self.centre), dtype=np.float64)
