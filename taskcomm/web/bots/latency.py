"""How long a simulated person takes."""

import numpy as np

QUICKEST, MEDIAN, SLOWEST, SPREAD = 0.05, 0.35, 0.8, 0.4  # of a step


def latency(step: float, rng: np.random.Generator) -> float:
    """Seconds into a step at which a person acts: log-normal, median 0.35 of a step, cut at 0.05 and 0.8."""
    share = MEDIAN * float(np.exp(SPREAD * rng.standard_normal()))
    return step * float(np.clip(share, QUICKEST, SLOWEST))
