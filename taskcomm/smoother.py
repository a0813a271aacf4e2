"""Why each press happened, given the whole trial: exact forward-backward (MODEL.md, section 5)."""

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from taskcomm.lattice import Bools, Extent, Floats, Ints, Lattice, build_unit, join
from taskcomm.teacher import Parameters, TeacherModel
from taskcomm.trials import Trial
from taskcomm.world import World


def cue_tables(trial: Trial, world: World, cues: Ints) -> Bools:
    """The cue of every approval state over a trial, under every task: shape (T, M, tasks).

    `cues` are rows of `world.cues(state)`.
    """
    table: dict[Hashable, NDArray[np.bool_]] = {}
    for state in trial.states:
        if state not in table:
            table[state] = np.asarray(world.cues(state), dtype=np.bool_)[cues]
    if not trial.num_steps:
        return np.zeros((0, len(cues), len(world.tasks)), dtype=np.bool_)
    return np.stack([table[state] for state in trial.states])


def task_prior(world: World, prior: ArrayLike | None) -> Floats:
    """`prior` as an array over `world.tasks`, uniform if None; ValueError if it is no distribution."""
    count = len(world.tasks)
    weight = np.full(count, 1 / count) if prior is None else np.array(prior, dtype=np.float64)
    if weight.shape != (count,) or not (weight >= 0).all() or not np.isclose(weight.sum(), 1, atol=1e-9):
        raise ValueError(f"prior: must be {count} probabilities that sum to 1, one per task")
    return np.asarray(weight / weight.sum(), dtype=np.float64)


def hypotheses(table: Bools, prior: Floats, task: int | None) -> tuple[list[Bools], list[Floats]]:
    """The distinct cue tables (T, M) that the tasks in question give, each with its tasks' weights.

    Weights are over all tasks: 1 for the known task, else the prior of the tasks that share the table.
    """
    if task is not None:
        only = np.zeros(len(prior))
        only[task] = 1.0
        return [table[:, :, task]], [only]
    groups: dict[bytes, tuple[Bools, Floats]] = {}
    for k in np.flatnonzero(prior):
        cues = np.ascontiguousarray(table[:, :, k])
        _, weights = groups.setdefault(cues.tobytes(), (cues, np.zeros(len(prior))))
        weights[k] = prior[k]
    return [cues for cues, _ in groups.values()], [weights for _, weights in groups.values()]


class Chain:
    """The buffers of the passes over one lattice, and the passes themselves.

    `run(parameters)` gives the log-likelihood of every unit, in nats, shape (units,); `smooth(weights)`
    then leaves `memory` (memories,) and `flow` (memories, 1 + M), see `_chain.backward`.
    """

    def __init__(self, lattice: Lattice) -> None:
        memories, layers = len(lattice.memory_next), len(lattice.layer_first)
        self.lattice = lattice
        self.units = len(lattice.unit_layers) - 1
        self.share, self.slope = np.zeros(lattice.size), np.zeros((5, lattice.size))
        self.quiet, self.entered, self.left, self.ahead, self.memory = np.zeros((5, memories))
        self.flow = np.zeros(lattice.memory_next.shape)
        self.total, self.log_likelihood = np.zeros(layers), np.zeros(self.units)
        self.parameters: Parameters | None = None

    def trace(self, parameters: Parameters) -> None:
        """The levels along every track at these parameters, with their rates."""
        from taskcomm import _chain

        p = parameters
        self.parameters = p
        _chain.trace(
            self.lattice, 0, self.units, p.dt, p.rise, p.fall, p.steps_late, p.part_late, p.decay, p.hold,
            self.share, self.slope,
        )  # fmt: skip

    def run(self, parameters: Parameters) -> Floats:
        """Log-likelihood of every unit at these parameters."""
        from taskcomm import _chain

        self.trace(parameters)
        _chain.forward(
            self.lattice, 0, self.units, parameters.mistake, parameters.peak, self.share, self.quiet,
            self.entered, self.left, self.total, self.log_likelihood,
        )  # fmt: skip
        return self.log_likelihood.copy()

    def smooth(self, unit_weight: Floats) -> None:
        """The backward pass after `run`, with the units weighted."""
        from taskcomm import _chain

        p = self.parameters
        assert p is not None
        _chain.backward(
            self.lattice, 0, self.units, p.mistake, p.peak, self.share, self.quiet, self.entered, self.left,
            self.total, unit_weight, self.ahead, self.memory, self.flow,
        )  # fmt: skip

    def reasons(self, unit: int) -> Floats:
        """P(reason | trial) of every press of a unit, shape (presses, 1 + M), after `smooth`."""
        p, lattice = self.parameters, self.lattice
        assert p is not None
        layers = range(lattice.unit_layers[unit], lattice.unit_layers[unit + 1] - 1)
        result = np.zeros((len(layers), len(p.peak) + 1))
        for row, layer in enumerate(layers):
            memories = slice(lattice.layer_memories[layer], lattice.layer_memories[layer + 1])
            levels = self.share[lattice.memory_base[memories] + lattice.layer_press[layer]]
            result[row, 0] = (self.flow[memories, 0] * p.mistake).sum()
            result[row, 1:] = (self.flow[memories, 1:] * p.peak * levels).sum(axis=0)
        return result


@dataclass(frozen=True)
class Smoothed:
    """What a whole trial says of its presses.

    `steps` (K,) are the steps with a press; `reasons` (K, 2 + M) is P(M_t = m | whole trial), columns
    as `mental_states`; `task` is P(task | whole trial) over `world.tasks`; `log_likelihood` is in nats:
    of the presses given the task where it is known, else summed over the tasks with their prior.
    """

    mental_states: tuple[str, ...]
    steps: Ints
    reasons: Floats
    task: Floats
    log_likelihood: float

    def of_press(self, press: int) -> Mapping[str, float]:
        """P(M_t = m | whole trial) of one press, counted from 0."""
        return dict(zip(self.mental_states, map(float, self.reasons[press]), strict=True))


def index_of_task(trial: Trial, world: World, task: Any) -> int:
    """Where a task stands in `world.tasks`; ValueError names the trial and the task."""
    tasks: Sequence[Any] = world.tasks
    for k, candidate in enumerate(tasks):
        if candidate == task:
            return k
    raise ValueError(f"trial {trial.trial_id}: {task} is not a task of its world ({len(tasks)} tasks)")


def smooth(
    trial: Trial, model: TeacherModel, world: World | None = None, prior: ArrayLike | None = None
) -> Smoothed:
    """P(M_t = m | whole trial) at every press, exact, with the trial's task known or not (None).

    Raises ValueError if the model's dt is not the trial's, the task is none of its world's, or the
    trial is past `MAX_MEMORIES` (LatticeTooLarge); ModelError for a cue that the world lacks.

    >>> from taskcomm.world import NOA, Action, BallWorld
    >>> from taskcomm.trials import Step
    >>> world = BallWorld()
    >>> steps = (Step(Action.parse("light_on(1)"), False), Step(NOA, False), Step(NOA, True))
    >>> trial = Trial("example", world, world.tasks[0], steps)
    >>> {state: round(p, 3) for state, p in smooth(trial, TeacherModel.intuitive()).of_press(0).items()}
    {'waiting': 0.0, 'mistake': 0.062, 'that_mov': 0.938, 'that_wrt': 0.0, 'that_dist': 0.0}

    Source: the paper, section 3.3; MODEL.md, section 5.
    """
    world = trial.world if world is None else world
    if abs(model.dt - trial.dt) > 1e-9 * trial.dt:
        raise ValueError(f"trial {trial.trial_id}: dt = {trial.dt:g} s, but the model's is {model.dt:g} s")
    parameters = model.parameters(world.cue_names)
    weight = task_prior(world, prior)
    task = None if trial.task is None else index_of_task(trial, world, trial.task)
    tables, shares = hypotheses(cue_tables(trial, world, parameters.cue), weight, task)
    extent = Extent.of(parameters)
    chain = Chain(join([build_unit(table, trial.presses, extent, model.dt) for table in tables]))
    evidence = chain.run(parameters) + np.log([share.sum() for share in shares])
    best = evidence.max()
    posterior = np.exp(evidence - best)
    answer = best + np.log(posterior.sum())
    posterior /= posterior.sum()
    chain.smooth(posterior)
    reasons = np.zeros((int(trial.presses.sum()), 2 + len(parameters.peak)))
    reasons[:, 1:] = sum(chain.reasons(unit) for unit in range(chain.units))
    over_tasks = sum(p * share / share.sum() for p, share in zip(posterior, shares, strict=True))
    return Smoothed(
        mental_states=model.mental_states,
        steps=np.flatnonzero(trial.presses),
        reasons=reasons,
        task=np.asarray(over_tasks, dtype=np.float64),
        log_likelihood=float(answer),
    )
