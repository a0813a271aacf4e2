"""Bands about a table-top: between what it may lie, at each moment, given how sure a fit is."""

import numpy as np

from learn.coordinates import model_at
from learn.intervals import Uncertainty
from learn.plots import Band, table_top_line
from taskcomm.lattice import Floats
from taskcomm.teacher import TeacherModel


def table_top_bands(found: Uncertainty, model: TeacherModel) -> Band:
    """The band of P(M = m) for `learn.plots.table_top`: band(state, seconds, cue) gives its lower and upper
    ends, each of the shape of `seconds`.

    With profile likelihoods, the least and the greatest value over all the parameters within the drop that
    the profiles visited: as far out as any interval reaches. With the bootstrap, percentiles of its fits.
    Every moment is taken for itself. Raises ValueError for an uncertainty without draws: from a file, or by
    standard errors.
    """
    if found.draws is None:
        raise ValueError("bands: need an uncertainty just made by profile likelihood or bootstrap")
    models = [model_at(vector, model) for vector in found.draws]

    def band(state: str, seconds: Floats, cue: str) -> tuple[Floats, Floats]:
        lines = np.array([table_top_line(each.approvals[state], seconds, cue) for each in models])
        if found.method == "likelihood":
            return lines.min(axis=0), lines.max(axis=0)
        low, high = np.quantile(lines, [(1 - found.level) / 2, (1 + found.level) / 2], axis=0)
        return low, high

    return band
