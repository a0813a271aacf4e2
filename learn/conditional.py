"""The transition into M as one conditional pomegranate Distribution (MODEL.md, section 7).

The table-tops are coupled through the probability of waiting, so they are one distribution over the
mental states, given the cue history and the last resets, not one for each state. This is the plain and
slow way to say what `learn.estep` and `learn.mstep` compute, with rates from torch's automatic
differentiation: a check of them, and a part for models built with pomegranate.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from learn.ascent import ascend, climb_from
from learn.coordinates import NAMES, Bounds, Coordinates, model_at, vector_of
from learn.estep import Evidence
from learn.exposure import expose
from learn.without_jit import without_jit
from taskcomm.lattice import Floats
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial
from taskcomm.world import World

WAITING = 0


def transitions(
    trials: Sequence[Trial], world: World, model: TeacherModel
) -> tuple[NDArray[np.int64], Floats]:
    """Every transition into M that the trials may have made, and its probability under `model`.

    Rows as `table_top_transition` takes them, over the longest trial; weights are those of the E-step:
    P(memory, M_t | trial). For data of moderate size: rows are steps times memories.
    """
    evidence = Evidence(expose(trials, world, model))
    lattice, exposure = evidence.exposure.lattice, evidence.exposure
    expectation = evidence.expect(model.parameters(world.cue_names))
    states, longest = len(model.approvals), int(exposure.steps.max())
    rows, weights = [], []
    for unit, trial in enumerate(exposure.unit_trial):
        steps, tracks = int(exposure.steps[trial]), slice(*lattice.unit_tracks[unit : unit + 2])
        starts = lattice.track_cue[tracks][
            [list(lattice.track_state[tracks]).index(m) for m in range(states)]
        ]
        cues = np.stack([lattice.cues[at : at + steps] for at in starts], axis=1)
        layers = range(*lattice.unit_layers[unit : unit + 2])
        for layer in layers:
            begin, end = int(lattice.layer_first[layer]), int(lattice.layer_press[layer])
            for s in range(*lattice.layer_memories[layer : layer + 2]):
                resets = lattice.track_first[lattice.memory_track[s]] - 1
                for t in range(begin, end + (layer != layers[-1])):
                    history = np.zeros((longest, states), dtype=np.int64)
                    history[longest - t - 1 :] = cues[: t + 1]
                    ages = np.where(resets >= 0, t - resets, longest)
                    for outcome in [WAITING] if t < end else range(states + 2):
                        rows.append(np.concatenate([history.ravel(), ages, [outcome]]))
                        weights.append(expectation.memory[s] if t < end else expectation.press[s, outcome])
    kept = np.array(weights) > 0
    return np.array(rows)[kept], np.array(weights)[kept]


def table_top_transition(model: TeacherModel, *, delays: bool = False, steps: int = 200) -> Any:
    """P(M_t | cues so far, last resets) of `model` as a pomegranate Distribution, in float64.

    A row of X holds, for a window of H steps that goes back to the start of the trial, the H x M cues
    (oldest first, zeros before the start), then for each approval state how many steps ago it was last
    reset (H: never), then M_t as its index in `model.mental_states`. `log_probability(X)` is in nats.
    `summarize(X, sample_weight)` adds weighted rows; `from_summaries()` raises their weighted
    log-probability jointly over mistake, peaks, rises, falls and, with `delays`, delays, by up to
    `steps` quasi-Newton steps: the M-step. `.model` is the TeacherModel it stands at.

    Loads torch and pomegranate. Raises ValueError for a model with rest, which depends on more than
    the last resets.
    """
    if model.rest:
        raise ValueError("rest: a press-free interval depends on more than cues and last resets")
    return _classes()(model, delays, steps)


@cache
def _classes() -> Any:
    """The class itself, made when torch is first needed. Loading takes seconds, fewer without the JIT."""
    with without_jit():
        import torch
        from pomegranate.distributions._distribution import ConditionalDistribution

    class TableTopTransition(ConditionalDistribution):  # type: ignore[misc]
        def __init__(self, model: TeacherModel, delays: bool, steps: int) -> None:
            super().__init__(inertia=0.0, frozen=False, check_data=False)
            self.name = "TableTopTransition"
            self.base, self.delays, self.steps = model, delays, steps
            vector = torch.tensor(vector_of(model), dtype=torch.float64)
            self.vector = torch.nn.Parameter(vector, requires_grad=False)
            self._initialized = True
            self._reset_cache()

        @property
        def model(self) -> TeacherModel:
            return model_at(self.vector.detach().numpy(), self.base)

        def _reset_cache(self) -> None:
            self._rows: list[Any] = []
            self._weights: list[Any] = []

        def _levels(self, cues: Any, ages: Any, vector: Any) -> tuple[Any, Any]:
            """Levels and on-times at the end of the last step, each (rows, M)."""
            dt, states = self.base.dt, ages.shape[1]
            _, rise, fall, delay, _, _ = vector[1:].reshape(len(NAMES), states)
            late = torch.floor(delay.detach() / dt + 1e-9)
            early = torch.clamp(delay - late * dt, min=0.0)
            level = torch.zeros_like(ages, dtype=torch.float64)
            on_time = torch.zeros_like(level)
            window = cues.shape[1]
            for t in range(window):
                for back, seconds in ((late + 1, early), (late, dt - early)):
                    at = t - back.long()
                    seen = cues[:, at.clamp(min=0), torch.arange(states)] & (at >= 0)
                    rising = torch.clamp(level + seconds / rise, max=1.0)
                    falling = torch.clamp(level - seconds / fall, min=0.0)
                    level = torch.where(seen, rising, falling)
                    quiet = torch.where(seconds > 0, 0.0, on_time)
                    on_time = torch.where(seen, on_time + seconds, quiet)
                if t < window - 1:
                    reset = ages == window - 1 - t
                    level = torch.where(reset, 0.0, level)
                    on_time = torch.where(reset, 0.0, on_time)
            return level, on_time

        def _log_probability(self, X: Any, vector: Any) -> Any:
            states = len(self.base.approvals)
            cues, ages, outcome = X[:, : -states - 1], X[:, -states - 1 : -1], X[:, -1]
            level, on_time = self._levels(cues.reshape(len(X), -1, states) > 0, ages, vector)
            approvals = vector[1 : 1 + states] * level
            for m, top in enumerate(self.base.approvals.values()):
                if top.decay is not None:
                    fading = torch.exp(-torch.clamp(on_time[:, m] - top.hold, min=0.0) / top.decay)
                    approvals = approvals * torch.where(torch.arange(states) == m, fading[:, None], 1.0)
            mistake = vector[0].expand(len(X), 1)
            waiting = 1 - mistake - approvals.sum(dim=1, keepdim=True)
            every = torch.cat([waiting, mistake, approvals], dim=1)
            return torch.log(every.gather(1, outcome[:, None])[:, 0])

        def log_probability(self, X: Any) -> Any:
            return self._log_probability(torch.as_tensor(X), self.vector)

        def summarize(self, X: Any, sample_weight: Any = None) -> None:
            X = torch.as_tensor(X)
            weight = torch.ones(len(X)) if sample_weight is None else torch.as_tensor(sample_weight)
            self._rows.append(X)
            self._weights.append(weight.reshape(len(X), -1)[:, 0].double())

        def from_summaries(self) -> None:
            if self.frozen or not self._rows:
                return
            X, weight = torch.cat(self._rows), torch.cat(self._weights)
            states = len(self.base.approvals)
            free = np.zeros(1 + len(NAMES) * states, dtype=np.bool_)
            free[: 1 + (4 if self.delays else 3) * states] = True
            seen = X[:, : -states - 1].reshape(len(X), -1, states).any(dim=1).any(dim=0).numpy()
            free[1:] &= np.tile(seen, len(NAMES))
            space = Coordinates(self.model, Bounds(), free)

            def value_and_rates(point: Floats) -> tuple[float, Floats]:
                at = space.vector(point)
                vector = torch.tensor(at, requires_grad=True)
                value = (weight * self._log_probability(X, vector)).sum()
                (rates,) = torch.autograd.grad(value, vector)
                return float(value.detach()), space.rates(at, rates.numpy())

            climb = climb_from(value_and_rates, space.point(self.vector.numpy()))
            climb = ascend(value_and_rates, climb, space.least, space.most, self.steps)
            self.vector.data = torch.tensor(space.vector(climb.point))
            self._reset_cache()

    return TableTopTransition
