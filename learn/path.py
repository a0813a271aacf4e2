"""Where a fit starts, and the way it takes from there."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from learn.coordinates import NAMES, Coordinates, vector_of
from learn.mstep import Objective, maximise
from learn.timescale import STEP
from taskcomm.channels import ObservationModel
from taskcomm.lattice import Floats
from taskcomm.teacher import TeacherModel


@dataclass
class Path:
    """The objective along one start: EM, search, EM again. It never falls.

    `ended` is where its own climb ended, before the search of the best of the starts.
    """

    name: str
    point: Floats
    values: list[float] = field(default_factory=list)
    iterations: int = 0
    converged: bool = False
    ended: Floats | None = None
    em_alone: float = 0.0
    searched: float = 0.0
    observation: ObservationModel | None = None

    def resume(self, objective: Objective) -> None:
        """Set the objective's observation model, where one is learned, to where the path stands."""
        if objective.observing is not None and self.observation is not None:
            objective.observing.set(self.observation)

    def run(self, objective: Objective, max_iter: int, rtol: float) -> None:
        """EM from where the path stands, within what is left of `max_iter` iterations."""
        metric, self.converged = None, False
        value = None
        while True:
            expectation = objective.expect(self.point)
            after = expectation.value + objective.log_prior(objective.space.vector(self.point))
            self.values.append(after)
            if value is not None and after - value <= rtol * abs(after):
                self.converged = True
                return
            if self.iterations >= max_iter:
                return
            value = after
            self.iterations += 1
            self.point, metric = maximise(objective, self.point, expectation, metric)
            if objective.observing is not None:
                objective.observing.learn(expectation)
                self.observation = objective.observing.observation

    def stand(self, objective: Objective, point: Floats) -> None:
        """Go to `point` and to where the objective's observation model stands."""
        assert objective.observing is not None
        self.point, self.observation = point, objective.observing.observation
        self.values.append(objective.value(point))

    def move(self, objective: Objective, point: Floats) -> float:
        """Go to `point` if the objective is higher there; the gain."""
        value = objective.value(point)
        gain = value - self.values[-1]
        if not gain > 0:
            return 0.0
        self.point = point
        self.values.append(value)
        return gain


def starting_points(
    model: TeacherModel, space: Coordinates, count: int, rng: np.random.Generator
) -> list[tuple[str, Floats]]:
    """The initial model first, then wide supports (long falls, no delay), then seeded random ones.

    Where decays are learned, plateaus that fade in a few seconds come early. Times are for steps of up to
    STEP seconds; where steps are longer, as many steps.
    """
    states, longest = len(model.approvals), space.longest
    vector = vector_of(model)
    unit = max(model.dt, STEP)

    def with_times(**times: ArrayLike) -> Floats:
        rows = vector[1:].reshape(len(NAMES), states).copy()
        for name, values in times.items():
            rows[NAMES.index(name)] = values
        other = np.concatenate([vector[:1], rows.ravel()])
        return space.point(np.where(space.free, np.minimum(other, longest), vector))

    points = [("initial", space.point(vector))]
    for rise, fall in ((2 * unit, 12 * unit), (8 * unit, 12 * unit), (model.dt, 16 * unit)):
        point = with_times(rise=rise, fall=fall, delay=0.0)
        points.append((f"wide: rise {rise:g} s, fall {fall:g} s", point))
    if "delay" in space.kinds:
        rise, fall, delay = 2 * unit, 4 * unit, 1.5 * unit
        late = with_times(rise=rise, fall=fall, delay=delay)
        points.insert(2, (f"late: rise {rise:g} s, fall {fall:g} s, delay {delay:g} s", late))
    if "decay" in space.kinds:
        decay, fall = 6 * unit, 8 * unit
        fading = with_times(fall=fall, delay=0.0, decay=decay)
        points.insert(1, (f"fading: decay {decay:g} s, fall {fall:g} s", fading))
    while len(points) < count:
        rises, falls = unit * np.exp(rng.uniform(0, np.log(12), size=(2, states)))
        delays = 2 * unit * rng.uniform(0, 1, size=states)
        decays = unit * np.exp(rng.uniform(0, np.log(60), size=states))
        random = with_times(rise=rises, fall=falls, delay=delays, decay=decays)
        points.append((f"random {len(points)}", random))
    return points[:count]
