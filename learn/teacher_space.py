"""The coordinates in which teachers differ, and what trials say of one teacher in them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from learn.coordinates import Coordinates, model_at, names_of, vector_of
from learn.em import MOST_MEMORIES
from learn.estep import Evidence
from learn.exposure import FitError, expose
from learn.laplace import Own
from learn.mstep import Objective
from learn.settings import Settings
from taskcomm.lattice import Bools, Floats
from taskcomm.teacher import ModelError, TeacherModel
from taskcomm.trials import Trial


@dataclass(frozen=True)
class TeacherSpace:
    """Models that differ from `model` in the parameters that are `free` (1 + 6 M,), as `settings` allow.

    A teacher is a point (n,): log odds against waiting, log rise, log fall and, where they are free, delay,
    log decay and hold. Points beyond the bounds stand for those at the bound.
    """

    model: TeacherModel
    free: Bools
    settings: Settings

    @cached_property
    def coordinates(self) -> Coordinates:
        return Coordinates(self.model, self.settings.bounds, self.free, self.settings.shared)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """What each coordinate is of: mistake, that_mov.peak, ...; or delay, where it is shared."""
        space, names = self.coordinates, names_of(list(self.model.approvals))
        shared = [kind in self.settings.shared for kind in space.kinds]
        pairs = zip(space.index, space.kinds, shared, strict=True)
        return tuple(kind if one_for_all else names[i] for i, kind, one_for_all in pairs)

    def point(self, model: TeacherModel) -> Floats:
        """Where a model stands, (n,)."""
        return self.coordinates.point(vector_of(model))

    def model_at(self, point: Floats, provenance: dict[str, Any]) -> TeacherModel:
        """The model at a point."""
        space = self.coordinates
        vector = space.vector(np.clip(point, space.least, space.most))
        return replace(model_at(vector, self.model), provenance=provenance)

    def own(self, trials: Sequence[Trial]) -> Own:
        """The log-likelihood of one teacher's trials, which may be none. Raises FitError, see `expose`."""
        space = self.coordinates
        if not trials:
            return Own(None, space.least, space.most)
        world = trials[0].world
        try:
            base = self.model.parameters(world.cue_names)
        except ModelError as error:
            raise FitError(str(error)) from None
        extent = space.extent(base)
        settings = self.settings
        exposure = expose(
            trials, world, self.model, extent, settings.task_prior, MOST_MEMORIES, "a teacher's posterior",
            settings.labels, settings.dropped_mass,
        )  # fmt: skip
        return Own(Objective(Evidence(exposure), base, space, None), space.least, space.most)
