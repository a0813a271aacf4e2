"""Robots that differ in their teacher model only, each teaching trial run with all of them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from learn.bootstrap import Interval, ratio_interval
from taskcomm.parallel import map_in_order
from taskcomm.replay import belief_path
from taskcomm.teacher import ModelError, TeacherModel
from taskcomm.trials import Trial
from taskcomm.world import World

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class Outcome:
    """One trial of one arm: `steps` observations, then Final (right or wrong) or a timeout.

    `entropy` (nats), `highest` (probability of the likeliest task) and `right` (whether that is the
    teacher's) are (steps + 1,), before the first step and after each.
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
class _Runner:
    """Runs trial n with every arm; robots are made on first use, so that each process has its own."""

    world: World
    arms: Mapping[str, TeacherModel]
    truths: tuple[TeacherModel, ...]
    horizon: int
    seed: int
    threshold: float
    max_steps: int
    robots: dict[str, Any] = field(default_factory=dict)

    def _robot(self, arm: str) -> Any:
        from taskcomm.planner import EntropyPlanner
        from taskcomm.robot import Robot

        if arm not in self.robots:
            model = self.arms[arm]
            planner = EntropyPlanner(self.world, model, horizon=self.horizon)
            self.robots[arm] = Robot(self.world, model, planner=planner, threshold=self.threshold)
        return self.robots[arm]

    def warm_up(self) -> None:
        """Compile the search here, once, and not in every process."""
        from taskcomm.planner import EntropyPlanner

        EntropyPlanner(self.world, next(iter(self.arms.values()))).warm_up()

    def __call__(self, index: int) -> list[Outcome]:
        from taskcomm.simulate import SimulatedTeacher, run_trial

        task_draws = np.random.default_rng([self.seed, index, 1])
        task = self.world.tasks[int(task_draws.integers(len(self.world.tasks)))]
        truth = self.truths[index % len(self.truths)]
        outcomes = []
        for arm, model in self.arms.items():
            teacher = SimulatedTeacher(self.world, truth, task)
            rng = np.random.default_rng([self.seed, index, 2])  # the same luck for every arm
            trial = run_trial(self._robot(arm), teacher, rng, max_steps=self.max_steps)
            outcomes.append(outcome_of(trial, model))
        return outcomes


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
    arms: Mapping[str, TeacherModel],
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

    Trial n has one task and one stream of uniforms, whatever the arm (common random numbers), and a
    teacher with the model `truth`, or the n-th of several, in turn. The result does not depend on
    `jobs`, the number of processes. Raises ValueError for no arms, no truth or no trials, ModelError for
    models with different dt.
    """
    truths = (truth,) if isinstance(truth, TeacherModel) else tuple(truth)
    if not arms or not truths or trials < 1:
        raise ValueError(
            f"closed loop: {len(arms)} arms, {len(truths)} truths, {trials} trials; all need one"
        )
    steps = {model.dt for model in (*arms.values(), *truths)}
    if len(steps) > 1:
        raise ModelError(
            f"dt: the closed loop has models with {', '.join(f'{dt:g} s' for dt in sorted(steps))}"
        )
    runner = _Runner(world, dict(arms), truths, horizon, seed, threshold, max_steps)
    if jobs > 1:
        runner.warm_up()
    results = map_in_order(runner, range(trials), jobs, progress)
    settings = {
        "trials": trials,
        "horizon": horizon,
        "seed": seed,
        "threshold": threshold,
        "max_steps": max_steps,
        "arms": {arm: model.sha256 for arm, model in arms.items()},
        "truths": [model.sha256 for model in truths],
    }
    groups = tuple(n % len(truths) if len(truths) > 1 else n for n in range(trials))
    outcomes = {arm: tuple(result[place] for result in results) for place, arm in enumerate(arms)}
    return ClosedLoop(outcomes, groups, steps.pop(), settings)
