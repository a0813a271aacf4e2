"""Would a fit find the truth? Studies of simulated teachers with a known model, fitted and kept by row."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from learn.compare import Stage, quiet
from learn.kept_rows import KeptRows
from learn.teaching import Teaching, intuitive_for
from taskcomm.parallel import map_in_order
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial
from taskcomm.world import World

if TYPE_CHECKING:
    from learn.result import FitResult
    from learn.settings import Settings

SOURCES = ("operator", "planner", "both")
LOOP = "loop"
REFERENCES = ("true", "intuitive")
STUDIES, HELD_OUT = 0, 1  # streams of draws
Key = tuple[str, int]  # who moves the robot, and the trial's index


@dataclass(frozen=True)
class Plan:
    """What is simulated and fitted, for every truth.

    For each of the `sources` there is a pool of `pool` trials: moved by the scripted operator, by the
    planner with the intuitive model, or by `both` in turn. Study k of n trials takes trials k n to
    (k + 1) n - 1, so studies of one size share none; there are `repeats` of them, or as many as the pool
    holds, but one at least. `loops` studies more are logged in a closed loop: of `loop_trials` trials,
    about `batch` at a time, by the planner with the model learned from all the trials before (at first with
    the intuitive one). Every learned model is scored on `held_out` fresh trials.
    With `intervals`, each fit gets its likelihood intervals, which takes several times as long.
    `options` go to `learn.fit`. Raises ValueError for what cannot be.
    """

    sizes: tuple[int, ...] = (22, 44, 200)
    sources: tuple[str, ...] = SOURCES
    repeats: int = 20
    pool: int = 1000
    loops: int = 0
    loop_trials: int = 200
    batch: int = 22
    held_out: int = 400
    horizon: int = 3
    threshold: float = 0.98
    max_steps: int = 600
    seed: int = 0
    intervals: bool = False
    options: Mapping[str, Any] = field(default_factory=lambda: {"starts": 3})

    def __post_init__(self) -> None:
        for name in ("repeats", "pool", "loop_trials", "batch", "held_out", "horizon", "max_steps"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name}: at least 1, not {getattr(self, name)}")
        if self.loops < 0:
            raise ValueError(f"loops: at least 0, not {self.loops}")
        if not self.sizes or min(self.sizes) < 1 or len(set(self.sizes)) < len(self.sizes):
            raise ValueError(f"sizes: must be different numbers of trials, from 1, not {self.sizes}")
        unknown = set(self.sources) - set(SOURCES)
        if unknown or not self.sources:
            raise ValueError(
                f"sources: some of {', '.join(SOURCES)}, not {', '.join(self.sources) or 'none'}"
            )

    @property
    def studies(self) -> list["Study"]:
        """All studies but those of the closed loop, the smaller first."""
        return [
            Study(source, size, repeat)
            for size in sorted(self.sizes)
            for source in self.sources
            for repeat in range(min(self.repeats, max(1, self.pool // size)))
        ]

    @property
    def fresh(self) -> "Study":
        """What learned models are scored on: moved by both, or, where no operator is, by the planner."""
        return Study("planner" if set(self.sources) == {"planner"} else "both", self.held_out, 0)

    @property
    def rounds(self) -> list[int]:
        """After how many trials the closed loop learns anew, the last time after all of them.

        >>> Plan(loop_trials=200, batch=22).rounds
        [22, 44, 67, 89, 111, 133, 156, 178, 200]
        """
        count = max(1, round(self.loop_trials / self.batch))
        return [round(self.loop_trials * (n + 1) / count) for n in range(count)]

    def teaching(self, world: World, truth: TeacherModel, stream: int = STUDIES) -> Teaching:
        """The trials of one truth."""
        return Teaching(world, truth, self.seed, stream, self.horizon, self.threshold, self.max_steps)


@dataclass(frozen=True)
class Study:
    """One simulated study: its source, its number of trials, and which of its size it is."""

    source: str
    size: int
    repeat: int

    @property
    def keys(self) -> list[Key]:
        """The trials that it takes."""
        indices = range(self.repeat * self.size, (self.repeat + 1) * self.size)
        if self.source == "both":
            return [(SOURCES[index % 2], index) for index in indices]
        return [(self.source, index) for index in indices]


@dataclass
class _Simulating:
    """Runs the trials of some keys."""

    teaching: Teaching
    robot: TeacherModel

    def __call__(self, keys: Sequence[Key]) -> list[Trial]:
        return [
            self.teaching.by_operator(n) if source == "operator" else self.teaching.by_planner(n, self.robot)
            for source, n in keys
        ]


@dataclass
class _Fitting:
    """Fits one study, or the studies of one closed loop, and keeps what came out."""

    truth: str
    teaching: Teaching
    plan: Plan
    trials: Mapping[Key, Trial]
    fresh: Sequence[Trial]
    kept: KeptRows
    _evidence: Any = field(default=None, repr=False)

    def __call__(self, study: Study) -> None:
        if study.source == LOOP:
            self._loop(study)
        else:
            self._learn(study, [self.trials[key] for key in study.keys])

    def _learn(self, study: Study, trials: Sequence[Trial]) -> TeacherModel:
        from learn import fit

        world, truth = self.teaching.world, self.teaching.truth
        result = fit(trials, world=world, initial=intuitive_for(truth), **self.plan.options)
        row: dict[str, Any] = {"truth": self.truth, **asdict(study)}
        row |= {"converged": result.converged, "model": plain(result.model), "marks": dict(result.marks)}
        row |= exposure_at(trials, world, truth, result.settings)
        row |= {"steps_in_all": sum(trial.num_steps for trial in trials)}
        row |= {"presses_in_all": sum(int(trial.presses.sum()) for trial in trials)}
        if self.plan.intervals:
            row |= {"intervals": intervals_of(result, trials)}
        self.kept.append(row | {"scores": self._scores(result)})
        return result.model

    def _scores(self, result: "FitResult") -> list[float]:
        """As `scores`, from one lattice of the fresh trials, good for all models within the fits' bounds."""
        from learn.em import prepare

        world = self.teaching.world
        if self._evidence is None:
            self._evidence = prepare(self.fresh, world, result.initial, result.settings).evidence
        return rounded(self._evidence.log_likelihoods(result.model.parameters(world.cue_names)))

    def _loop(self, study: Study) -> None:
        """Plan with the current model, log, refit on all, plan again."""
        model, trials = intuitive_for(self.teaching.truth), list[Trial]()
        first = study.repeat * self.plan.loop_trials
        for size in self.plan.rounds:
            trials += [self.teaching.by_planner(first + n, model) for n in range(len(trials), size)]
            model = self._learn(Study(LOOP, size, study.repeat), trials)


def plain(model: TeacherModel) -> dict[str, Any]:
    """A model's parameters as a model file has them, without where it came from."""
    return model.to_dict() | {"provenance": {}}


def scores(trials: Sequence[Trial], world: World, model: TeacherModel) -> list[float]:
    """Log-likelihood of each trial in nats, to a ten-thousandth."""
    from learn import log_likelihoods

    return rounded(log_likelihoods(trials, world, model))


def rounded(values: Iterable[float]) -> list[float]:
    """To a ten-thousandth, as rows hold them."""
    return [round(float(value), 4) for value in values]


def exposure_at(
    trials: Sequence[Trial], world: World, truth: TeacherModel, settings: "Settings"
) -> dict[str, dict[str, float]]:
    """Expected steps and presses that bear on each parameter, at its true value."""
    from learn.coordinates import names_of, vector_of
    from learn.em import prepare
    from learn.statistics import informed

    objective = prepare(trials, world, truth, settings)
    vector = vector_of(truth)
    seen = informed(objective, vector, objective.expect(objective.space.point(vector)))
    names = names_of(list(truth.approvals))
    return {
        what: {name: round(float(value), 3) for name, value in zip(names, values, strict=True)}
        for what, values in (("steps", seen.steps), ("presses", seen.presses))
    }


def intervals_of(
    result: "FitResult", trials: Sequence[Trial]
) -> dict[str, tuple[float | None, float | None]]:
    """The likelihood interval of each parameter that has one; None for an open end."""
    from learn.certainty import uncertainty

    return {
        one.parameter: (None if one.open_low else one.low, None if one.open_high else one.high)
        for one in uncertainty(result, trials).intervals
        if one.low is not None and one.high is not None
    }


def recover(
    folder: Path,
    world: World,
    truths: Mapping[str, TeacherModel],
    plan: Plan,
    *,
    jobs: int = 1,
    stage: Stage = quiet,
) -> list[dict[str, Any]]:
    """Simulate, fit and score the studies of `plan` for every truth; gives a row for each fit.

    Rows are kept in `folder` as they are done: the same call goes on where it was stopped, and more sizes,
    sources, repeats or loops may be asked of a folder later. A row holds the study, the learned `model`,
    its `marks`, whether the fit `converged`, the expected `steps` and `presses` that bore on each
    parameter at its true value, `intervals` where the plan has them, and the `scores` of the held-out
    trials. Two rows more, of sources "true" and "intuitive", hold the scores of those models. Nothing
    depends on `jobs`. Raises ValueError for a folder with another run or for truths of several dt,
    FitError for studies that cannot be fitted.
    """
    if len({model.dt for model in truths.values()}) != 1:
        raise ValueError(f"recovery: needs truths with one dt, not {len(truths)} with several or none")
    folder.mkdir(parents=True, exist_ok=True)
    kept = KeptRows(folder / "fits.jsonl")
    kept.begin(_about(world, truths, plan))
    for name, truth in truths.items():
        _recover_one(name, plan.teaching(world, truth), plan, kept, jobs, stage)
    rows = {(row["truth"], row["source"], row["size"], row["repeat"]): row for row in kept.rows()}
    loops = [Study(LOOP, size, repeat) for size in plan.rounds for repeat in range(plan.loops)]
    studies = [*(Study(source, 0, 0) for source in REFERENCES), *plan.studies, *loops]
    return [rows[(name, *_key(study))] for name in truths for study in studies]


def _key(study: Study) -> tuple[str, int, int]:
    return study.source, study.size, study.repeat


def _about(world: World, truths: Mapping[str, TeacherModel], plan: Plan) -> dict[str, Any]:
    fixed = (
        "batch",
        "held_out",
        "horizon",
        "intervals",
        "loop_trials",
        "max_steps",
        "options",
        "seed",
        "threshold",
    )
    settings = {name: value for name, value in asdict(plan).items() if name in fixed}
    return {
        "world": repr(world),
        "truths": {name: model.sha256 for name, model in truths.items()},
        **settings,
        "fresh": plan.fresh.source,
    }


def _recover_one(name: str, teaching: Teaching, plan: Plan, kept: KeptRows, jobs: int, stage: Stage) -> None:
    rows = [row for row in kept.rows() if row["truth"] == name]
    done = {(row["source"], row["size"], row["repeat"]) for row in rows}
    loops = [Study(LOOP, plan.rounds[-1], repeat) for repeat in range(plan.loops)]
    studies = [study for study in [*plan.studies, *loops] if _key(study) not in done]
    references = [source for source in REFERENCES if (source, 0, 0) not in done]
    if not studies and not references:
        return
    world, truth, intuitive = teaching.world, teaching.truth, intuitive_for(teaching.truth)
    fresh = plan.teaching(world, truth, HELD_OUT)
    held_out = _simulated(
        _Simulating(fresh, intuitive), plan.fresh.keys, f"{name}: fresh trials", jobs, stage
    )
    for source in references:
        model = truth if source == "true" else intuitive
        row = {"truth": name, **asdict(Study(source, 0, 0)), "model": plain(model)}
        kept.append(row | {"scores": scores(list(held_out.values()), world, model)})
    keys = [key for study in studies if study.source != LOOP for key in study.keys]
    trials = _simulated(_Simulating(teaching, intuitive), keys, f"{name}: simulating", jobs, stage)
    fitting = _Fitting(name, teaching, plan, trials, list(held_out.values()), kept)
    with stage(f"{name}: fitting", len(studies)) as progress:
        map_in_order(fitting, studies, jobs, progress)


def _simulated(
    work: Callable[[Sequence[Key]], list[Trial]], keys: Iterable[Key], text: str, jobs: int, stage: Stage
) -> dict[Key, Trial]:
    """The trials of the keys, in batches, which share what a robot remembers."""
    wanted = sorted(set(keys))
    size = max(1, math.ceil(len(wanted) / max(1, 8 * jobs)))
    batches = [wanted[at : at + size] for at in range(0, len(wanted), size)]
    with stage(text, len(wanted)) as progress:
        found = map_in_order(work, batches, jobs, lambda done: progress(min(done * size, len(wanted))))
    return dict(zip(wanted, (trial for batch in found for trial in batch), strict=True))
