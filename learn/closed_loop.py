"""Robots that differ in their teacher model or their planner, each teaching trial run with all of them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from learn.bootstrap import Interval, ratio_interval
from learn.remembering import Remembering
from taskcomm.parallel import map_in_order
from taskcomm.planner import EntropyPlanner
from taskcomm.replay import belief_path
from taskcomm.robot import Robot
from taskcomm.simulate import SimulatedTeacher, run_trial
from taskcomm.teacher import ModelError, TeacherModel
from taskcomm.trials import Trial
from taskcomm.world import World

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class Design:
    """A robot as an arm has it: its teacher model, how many steps its planner looks ahead, its deadline.

    With a `deadline` (s for one decision) `horizon` is the most it looks ahead, and outcomes depend on how
    fast and how busy the machine is.
    """

    model: TeacherModel
    horizon: int = 3
    deadline: float | None = None


@dataclass(frozen=True)
class Outcome:
    """One trial of one arm: `steps` observations, then Final (right or wrong) or a timeout.

    `entropy` (nats), `highest` (probability of the likeliest task) and `right` (whether that is the
    teacher's) are (steps + 1,), before the first step and after each; empty where they were not kept.
    """

    steps: int
    correct: bool
    timeout: bool
    presses: int
    entropy: Floats
    highest: Floats
    right: Bools


@dataclass(frozen=True)
class ClosedLoop:
    """The outcomes of every arm on the same trials: `outcomes[arm][n]` has the task and draws of trial n.

    `groups[n]` is the simulated teacher of trial n. `settings` says how it was made. Times are in
    seconds; a timeout counts at its length, as not correct.
    """

    outcomes: Mapping[str, tuple[Outcome, ...]]
    groups: tuple[int, ...]
    dt: float
    settings: Mapping[str, Any] = field(default_factory=dict)

    @property
    def arms(self) -> tuple[str, ...]:
        return tuple(self.outcomes)

    @property
    def trials(self) -> int:
        """Trials of each arm."""
        return len(self.groups)

    def time(self, arm: str) -> Floats:
        """Seconds to Final or to the timeout, shape (trials,)."""
        return np.array([outcome.steps for outcome in self.outcomes[arm]]) * self.dt

    def correct(self, arm: str) -> Bools:
        """Whether Final showed the teacher's task, shape (trials,)."""
        return np.array([outcome.correct for outcome in self.outcomes[arm]], dtype=np.bool_)

    def timeout(self, arm: str) -> Bools:
        """Whether the trial ended without Final, shape (trials,)."""
        return np.array([outcome.timeout for outcome in self.outcomes[arm]], dtype=np.bool_)

    def presses(self, arm: str) -> NDArray[np.int64]:
        """Presses of the teacher, shape (trials,)."""
        return np.array([outcome.presses for outcome in self.outcomes[arm]], dtype=np.int64)

    def mean(self, arm: str, what: str) -> Interval:
        """Mean over the trials of `time`, `correct`, `timeout` or `presses`, with its interval."""
        values = np.asarray(getattr(self, what)(arm), dtype=np.float64)
        return ratio_interval(values, np.ones(self.trials), self.groups)

    def difference(self, arm: str, baseline: str, what: str) -> Interval:
        """Mean of arm minus baseline, trial by trial, with its paired interval."""
        ours, theirs = (np.asarray(getattr(self, what)(name), dtype=np.float64) for name in (arm, baseline))
        return ratio_interval(ours - theirs, np.ones(self.trials), self.groups)

    def time_ratio(self, arm: str, baseline: str) -> Interval:
        """Mean time of arm over mean time of baseline, with its paired interval."""
        return ratio_interval(self.time(arm), self.time(baseline), self.groups)

    def rows(self) -> list[dict[str, Any]]:
        """One row for every trial and arm, for a table file."""
        return [
            {
                "trial": index,
                "teacher": self.groups[index],
                "arm": arm,
                "time_s": outcome.steps * self.dt,
                "correct": int(outcome.correct),
                "timeout": int(outcome.timeout),
                "presses": outcome.presses,
            }
            for index in range(self.trials)
            for arm, outcome in ((arm, self.outcomes[arm][index]) for arm in self.arms)
        ]


@dataclass
class Runner:
    """Runs trial n with any arm: its task, teacher and draws follow from `seed` and n alone.

    Robots are made on first use, so that each process has its own. Raises ModelError for models with
    different dt.
    """

    world: World
    arms: Mapping[str, Design]
    truths: tuple[TeacherModel, ...]
    seed: int
    threshold: float
    max_steps: int
    robots: dict[str, Robot] = field(default_factory=dict)

    def __post_init__(self) -> None:
        steps = sorted({model.dt for model in (*(arm.model for arm in self.arms.values()), *self.truths)})
        if len(steps) > 1:
            raise ModelError(f"dt: the closed loop has models with {', '.join(f'{dt:g} s' for dt in steps)}")

    @property
    def dt(self) -> float:
        """Length of a time step in seconds, the same in all models."""
        return self.truths[0].dt

    def planner(self, arm: str) -> EntropyPlanner:
        """A new planner for the robot of an arm."""
        return EntropyPlanner(self.world, self.arms[arm].model, horizon=self.arms[arm].horizon)

    def robot(self, arm: str) -> Robot:
        """The robot of an arm, the same one in every trial."""
        if arm not in self.robots:
            model, deadline = self.arms[arm].model, self.arms[arm].deadline
            planner = Remembering(self.planner(arm))  # all trials begin alike
            self.robots[arm] = Robot(self.world, model, planner, self.threshold, deadline=deadline)
        return self.robots[arm]

    def memory(self, arm: str) -> Remembering:
        """What the robot of an arm decided in its last trial, and remembers."""
        planner = self.robot(arm).planner
        assert isinstance(planner, Remembering)
        return planner

    def warm_up(self) -> None:
        """Compile the search here, once, and not in every process."""
        self.planner(next(iter(self.arms))).warm_up()

    def group(self, index: int) -> int:
        """The simulated teacher of a trial: people take turns; a single truth is a new person each time."""
        return index % len(self.truths) if len(self.truths) > 1 else index

    def trial(self, arm: str, index: int) -> Trial:
        """Trial `index` of an arm."""
        task_draws = np.random.default_rng([self.seed, index, 1])
        task = self.world.tasks[int(task_draws.integers(len(self.world.tasks)))]
        teacher = SimulatedTeacher(self.world, self.truths[index % len(self.truths)], task)
        rng = np.random.default_rng([self.seed, index, 2])  # the same luck for every arm
        return run_trial(self.robot(arm), teacher, rng, max_steps=self.max_steps)

    def __call__(self, index: int) -> list[Outcome]:
        return [outcome_of(self.trial(arm, index), design.model) for arm, design in self.arms.items()]


def outcome_of(trial: Trial, model: TeacherModel) -> Outcome:
    """What a trial with a known task came to, and how a robot with `model` believed along the way."""
    path = belief_path(trial, model)
    truth = trial.world.tasks.index(trial.task)
    return Outcome(
        steps=trial.num_steps,
        correct=bool(trial.correct),
        timeout=trial.reason == "timeout",
        presses=int(trial.presses.sum()),
        entropy=path.entropy,
        highest=path.highest,
        right=np.asarray(path.marginal.argmax(axis=1) == truth),
    )


def run_closed_loop(
    world: World,
    arms: Mapping[str, TeacherModel | Design],
    truth: TeacherModel | Sequence[TeacherModel],
    trials: int,
    *,
    horizon: int = 3,
    seed: int = 0,
    jobs: int = 2,
    threshold: float = 0.98,
    max_steps: int = 600,
    progress: Callable[[int], None] | None = None,
) -> ClosedLoop:
    """Run every arm's robot on the same `trials` teaching trials with simulated teachers.

    An arm is a teacher model, whose robot looks `horizon` steps ahead, or a `Design`, which says that
    itself. Trial n has one task and one stream of uniforms, whatever the arm (common random numbers), and a
    teacher with the model `truth`, or the n-th of several, in turn. The result does not depend on
    `jobs`, the number of processes, but for arms with a deadline. Raises ValueError for no arms, no truth
    or no trials, ModelError for models with different dt.
    """
    truths = (truth,) if isinstance(truth, TeacherModel) else tuple(truth)
    if not arms or not truths or trials < 1:
        raise ValueError(
            f"closed loop: {len(arms)} arms, {len(truths)} truths, {trials} trials; all need one"
        )
    designs = {name: arm if isinstance(arm, Design) else Design(arm, horizon) for name, arm in arms.items()}
    runner = Runner(world, designs, truths, seed, threshold, max_steps)
    if jobs > 1:
        runner.warm_up()
    results = map_in_order(runner, range(trials), jobs, progress)
    settings = {
        "trials": trials,
        "horizon": horizon,
        "seed": seed,
        "threshold": threshold,
        "max_steps": max_steps,
        "arms": {name: design.model.sha256 for name, design in designs.items()},
        "horizons": {name: design.horizon for name, design in designs.items()},
        "deadlines": {name: design.deadline for name, design in designs.items()},
        "truths": [model.sha256 for model in truths],
    }
    outcomes = {name: tuple(result[place] for result in results) for place, name in enumerate(designs)}
    return ClosedLoop(outcomes, tuple(map(runner.group, range(trials))), runner.dt, settings)
