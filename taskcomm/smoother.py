"""Why each press happened, given the whole trial: exact forward-backward (MODEL.md, section 5)."""

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from taskcomm.courses import courses_of
from taskcomm.lattice import MAX_MEMORIES, Bools, Extent, Floats, Ints, Lattice, build_unit, join
from taskcomm.observation import observation_logs
from taskcomm.parallel import over_ranges
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


def seen(trial: Trial, world: World, model: TeacherModel, labels: bool = False) -> Floats | None:
    """ln P(observation | M, task) of every step, (T, tasks, 2 + M), or None where presses are all there is.

    With `labels`, a press that annotators have labelled has been made for one of the reasons they gave, the
    last of each.
    Raises ValueError naming trial and step for a signal or a label that the model cannot take.
    """
    given = trial.labelled if labels else {}
    if model.observation.is_exact_key and trial.recorded.all() and not given:
        return None
    try:
        logs = observation_logs(trial, world, model)
    except ValueError as error:
        raise ValueError(f"trial {trial.trial_id}: {error}") from None
    for t, said in given.items():
        states = set(said.values())
        if unknown := states - set(model.mental_states):
            raise ValueError(
                f"trial {trial.trial_id}: step {t} is labelled {min(unknown)!r}, no state of the model"
            )
        logs[t, :, [state not in states for state in model.mental_states]] = -np.inf
    return logs


class Hypothesis(NamedTuple):
    """What a trial shows under some tasks: cues (T, M), ln P(observation | M) (T, 2 + M) unless plain, and
    the weight of each task, (tasks,), 0 for those under which it shows something else."""

    cues: Bools
    logs: Floats | None
    share: Floats


def hypotheses(
    table: Bools, logs: Floats | None, prior: Floats, task: int | None, together: bool = True
) -> list[Hypothesis]:
    """What a trial shows under each task, tasks that show the same `together` or not.

    `table` (T, M, tasks) and `logs` (T, tasks, 2 + M) are those of all tasks; a known `task` weighs 1.
    """

    def of(k: int) -> tuple[Bools, Floats | None]:
        return np.ascontiguousarray(table[:, :, k]), None if logs is None else logs[:, k].copy()

    if task is not None:
        return [Hypothesis(*of(task), np.eye(len(prior))[task])]
    groups: dict[Any, Hypothesis] = {}
    for k in np.flatnonzero(prior):
        cues, observed = of(int(k))
        key = (cues.tobytes(), b"" if observed is None else observed.tobytes()) if together else (k, k)
        groups.setdefault(key, Hypothesis(cues, observed, np.zeros(len(prior)))).share[k] = prior[k]
    return list(groups.values())


class Chain:
    """The buffers of the passes over one lattice, and the passes themselves.

    `run(parameters)` gives the log-likelihood of every unit, in nats, shape (units,); `smooth(weights)`
    then leaves `memory` (memories,), and `press` and `flow` (memories, 2 + M), see `_chain.backward`.
    """

    def __init__(self, lattice: Lattice) -> None:
        memories, layers = len(lattice.memory_next), len(lattice.layer_first)
        self.lattice, (self.courses, self.ranges) = lattice, courses_of(lattice)
        self.units = len(lattice.unit_layers) - 1
        levels, cells = int(self.courses.line_at[-1]), len(self.courses.cell_level)
        self.share, self.slope = np.zeros(levels), np.zeros((5, levels))
        self.waiting, self.before, self.scale = np.zeros((3, cells))
        self.quiet, self.entered, self.ahead = np.zeros((3, memories))
        self.flow = np.zeros((memories, lattice.event.shape[1]))
        self.memory, self.press = np.zeros(memories), np.zeros_like(self.flow)
        self.total, self.log_likelihood = np.zeros(layers), np.zeros(self.units)
        self.parameters: Parameters | None = None

    def sweep(self, kernel: Any, *arguments: Any) -> None:
        """kernel(lattice, courses, first, last, *arguments) over all units, in ranges, on threads."""
        lattice, courses = self.lattice, self.courses
        over_ranges(lambda first, last: kernel(lattice, courses, first, last, *arguments), self.ranges)

    def trace(self, parameters: Parameters) -> None:
        """The levels along every line at these parameters, their rates, and P(waiting) in every cell."""
        from taskcomm import _chain

        p = parameters
        self.parameters = p
        self.sweep(
            _chain.trace, p.dt, p.rise, p.fall, p.steps_late, p.part_late, p.decay, p.hold,
            self.share, self.slope,
        )  # fmt: skip
        self.sweep(_chain.along, p.mistake, p.peak, self.share, self.waiting, self.before, self.scale)

    def run(self, parameters: Parameters) -> Floats:
        """Log-likelihood of every unit at these parameters."""
        from taskcomm import _chain

        self.trace(parameters)
        self.sweep(
            _chain.forward, parameters.mistake, parameters.peak, self.share, self.waiting, self.before,
            self.scale, self.quiet, self.entered, self.total, self.log_likelihood,
        )  # fmt: skip
        return self.log_likelihood.copy()

    def smooth(self, unit_weight: Floats) -> None:
        """The backward pass after `run`, with the units weighted; `memory` and `press` are new arrays."""
        from taskcomm import _chain

        p = self.parameters
        assert p is not None
        self.memory, self.press = np.empty_like(self.memory), np.empty_like(self.press)
        self.sweep(
            _chain.backward, p.mistake, p.peak, self.share, self.waiting, self.quiet, self.entered,
            self.total, self.log_likelihood, unit_weight, self.ahead, self.memory, self.flow, self.press,
        )  # fmt: skip

    def reasons(self, unit: int) -> Floats:
        """P(M | trial) at every event of a unit, shape (events, 2 + M), after `smooth`."""
        first, last = self.lattice.unit_layers[unit : unit + 2]
        begin = self.lattice.layer_memories[first:last]
        return np.add.reduceat(self.press[: self.lattice.layer_memories[last]], begin)[:-1]

    def events(self, unit: int) -> Ints:
        """The steps of a unit's events, shape (events,)."""
        layers = self.lattice.unit_layers[unit : unit + 2]
        return self.lattice.layer_press[layers[0] : layers[1] - 1]


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

    Raises ValueError if the model's dt is not the trial's, the task is none of its world's, what was
    observed is impossible, or the trial is past `MAX_MEMORIES` (LatticeTooLarge); ModelError for a cue that
    the world lacks.

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
    shown = hypotheses(cue_tables(trial, world, parameters.cue), seen(trial, world, model), weight, task)
    extent = Extent.of(parameters)
    units = [build_unit(one.cues, trial.presses, extent, model.dt, MAX_MEMORIES, one.logs) for one in shown]
    chain = Chain(join(units))
    evidence = chain.run(parameters) + np.log([one.share.sum() for one in shown])
    best = evidence.max()
    if best == -np.inf:
        raise ValueError(f"trial {trial.trial_id}: what was observed is impossible under the model")
    posterior = np.exp(evidence - best)
    answer = best + np.log(posterior.sum())
    posterior /= posterior.sum()
    chain.smooth(posterior)
    reasons = np.zeros((trial.num_steps, 2 + len(parameters.peak)))
    for unit in range(chain.units):
        reasons[chain.events(unit)] += chain.reasons(unit)
    over_tasks = sum(p * one.share / one.share.sum() for p, one in zip(posterior, shown, strict=True))
    return Smoothed(
        mental_states=model.mental_states,
        steps=np.flatnonzero(trial.presses),
        reasons=reasons[trial.presses],
        task=np.asarray(over_tasks, dtype=np.float64),
        log_likelihood=float(answer),
    )
