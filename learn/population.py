"""Teachers around a common mean: what they have in common, and each of them given the others."""

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np

from learn.coordinates import Bounds, vector_of
from learn.draws import Posterior, posterior
from learn.exposure import FitError, trial_hash
from learn.laplace import laplace
from learn.normal import Normal
from learn.settings import Settings
from learn.teacher_space import TeacherSpace
from taskcomm.teacher import ModelError, TeacherModel
from taskcomm.trials import Trial
from taskcomm.wholefile import write_whole

SCHEMA = "taskcomm.population/1"
DRAWS = 1000
ALIKE = "may be alike"
KEPT = ("task_prior", "labels", "dropped_mass")  # settings that say how trials are read


@dataclass(frozen=True)
class Common:
    """What teachers have in common in one coordinate, and how they differ in it.

    `mean` and `spread` (standard deviation over teachers) are in units of the coordinate: log odds against
    waiting, log seconds, or, of delay and hold, seconds. `mean_error` is the standard error of the mean,
    `spread_error` that of log spread. `gain` is how many nats of log-likelihood are lost if the teachers are
    held to be alike in it; `mark` says "may be alike" where that is too little to tell (one-sided, 5%).
    """

    name: str
    mean: float
    mean_error: float
    spread: float
    spread_error: float
    gain: float
    mark: str


@dataclass(frozen=True)
class Teacher:
    """One teacher given the own trials and the population.

    `model` is at the mode of the posterior. `mean` and `spread` (n,) are its mean and standard deviation in
    the coordinates; `own_share` (n,) is 1 - posterior / prior variance: how much the own trials say in each,
    0 where they leave the teacher no better known (draws, or a posterior of two hills, may even widen it).
    `log_marginal` is the log-likelihood of the own trials averaged over the population, in nats.
    All but `model` rests on draws, worth `effective` equally weighed ones.
    """

    name: str
    model: TeacherModel
    mean: tuple[float, ...]
    spread: tuple[float, ...]
    own_share: tuple[float, ...]
    trials: int
    presses: int
    log_marginal: float
    effective: float


@dataclass(frozen=True)
class Population:
    """Teachers whose coordinates are normal about a mean.

    `model` is the teacher at the mean of the coordinates, `pooled` the model fitted to all trials as if they
    were of one teacher. `normal` is the distribution in the coordinates of `space`, `common` the same
    coordinate by coordinate with its uncertainty. `log_marginal` is the log-likelihood of all trials, each
    teacher's averaged over the population, and `pooled_log_likelihood` that under `pooled`, in nats.
    `path` holds the estimate of `log_marginal` in every round. `converged` is False, and `status` says why,
    where the rounds did not do. `provenance` says how it was made.
    """

    space: TeacherSpace
    model: TeacherModel
    pooled: TeacherModel
    normal: Normal
    common: tuple[Common, ...]
    teachers: tuple[Teacher, ...]
    log_marginal: float
    pooled_log_likelihood: float
    path: tuple[float, ...]
    converged: bool
    status: str
    provenance: Mapping[str, Any]

    def teacher(
        self, trials: Sequence[Trial], estimate: Literal["mode", "mean"] = "mode", seed: int = 0
    ) -> TeacherModel:
        """The model of a teacher met in `trials`, all of the one teacher; the mean teacher where none were.

        At the mode of the posterior, or at its mean, which rests on draws. Raises FitError for trials of two
        teachers, and for trials that the model cannot be applied to, see `expose`.
        """
        trials = tuple(trials)
        people = sorted({trial.participant_id for trial in trials if trial.participant_id is not None})
        if len(people) > 1:
            raise FitError(f"trials of {len(people)} teachers, {', '.join(people)}: one at a time is met")
        if not trials:
            return self.model
        own = self.space.own(trials)
        if estimate == "mode":
            point = laplace(own, self.normal).mean
        elif estimate == "mean":
            point = posterior(own, self.normal, DRAWS, np.random.default_rng(seed)).mean
        else:
            raise ValueError(f"estimate: must be 'mode' or 'mean', not {estimate!r}")
        return self.space.model_at(point, made_of("Population.teacher", trials))

    def middle(self, spreads: float = 1.96) -> dict[str, tuple[float, float, float]]:
        """Each coordinate's parameter, by name: of the mean teacher, and `spreads` below and above it.

        The default holds the middle 95% of teachers. In natural units, within the bounds.
        """
        values = {}
        for j, name in enumerate(self.space.names):
            aside = spreads * self.normal.spread * (np.arange(len(self.normal.mean)) == j)
            models = [self.space.model_at(self.normal.mean + way * aside, {}) for way in (0, -1, 1)]
            at, low, high = (self.parameter(model, name) for model in models)
            values[name] = (at, low, high)
        return values

    def parameter(self, model: TeacherModel, name: str) -> float:
        """The parameter of a model that the coordinate `name` is of, in natural units."""
        return float(vector_of(model)[self.space.coordinates.index[self.space.names.index(name)]])

    def log_predictive(self, trials: Sequence[Trial], given: Sequence[Trial] = (), seed: int = 0) -> float:
        """Log-likelihood of `trials` of a teacher met before in `given`, averaged over what is thought of
        that teacher, in nats. It rests on draws. Raises FitError, see `expose`."""
        together = self._posterior((*given, *trials), seed).log_marginal
        return together - (self._posterior(tuple(given), seed).log_marginal if given else 0.0)

    def _posterior(self, trials: Sequence[Trial], seed: int) -> Posterior:
        return posterior(self.space.own(trials), self.normal, DRAWS, np.random.default_rng(seed))

    def to_dict(self) -> dict[str, Any]:
        """What a population file holds, as plain values."""
        settings = self.space.settings
        return {
            "schema": SCHEMA,
            "model": self.model.to_dict(),
            "pooled": self.pooled.to_dict(),
            "mean": self.normal.mean.tolist(),
            "covariance": self.normal.covariance.tolist(),
            "common": [asdict(each) for each in self.common],
            "teachers": [
                {f.name: getattr(each, f.name) for f in fields(Teacher)} | {"model": each.model.to_dict()}
                for each in self.teachers
            ],
            "log_marginal": self.log_marginal,
            "pooled_log_likelihood": self.pooled_log_likelihood,
            "path": list(self.path),
            "converged": self.converged,
            "status": self.status,
            "space": {
                "model": self.space.model.to_dict(),
                "free": self.space.free.tolist(),
                "bounds": asdict(settings.bounds),
                "shared": list(settings.shared),
                **{name: getattr(settings, name) for name in KEPT},
            },
            "provenance": dict(self.provenance),
        }

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the population file, whole or not at all; OutputError (an OSError) names it."""
        text = json.dumps(self.to_dict(), indent=2, ensure_ascii=False) + "\n"
        write_whole(Path(path), text.encode())

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> Self:
        """The population of what a file holds; ModelError says what is wrong with it."""
        schema = document.get("schema") if isinstance(document, Mapping) else None
        if schema != SCHEMA:
            raise ModelError(f"schema: this version reads {SCHEMA!r}, not {schema!r}")
        try:
            return cls(**_read(document))
        except ModelError:
            raise
        except KeyError as error:
            raise ModelError(f"{error.args[0]}: missing") from None
        except (TypeError, ValueError, np.linalg.LinAlgError) as error:
            raise ModelError(f"not a population: {error}") from None

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Read a population file; ModelError names the file and what is wrong."""
        try:
            return cls.from_dict(json.loads(Path(path).read_bytes()))
        except ModelError as error:
            raise ModelError(f"{path}: {error}") from None
        except (ValueError, RecursionError) as error:
            raise ModelError(f"{path}: not JSON: {error}") from None


def made_of(by: str, trials: Sequence[Trial]) -> dict[str, Any]:
    """The provenance of one teacher's model."""
    hashes = sorted(trial_hash(trial) for trial in trials)
    return {"made_by": by, "trials": len(hashes), "trial_sha256": hashes}


def _read(document: Mapping[str, Any]) -> dict[str, Any]:
    where = document["space"]
    options: dict[str, Any] = {f"{name}s": "shared" for name in where["shared"]}
    options |= {name: where[name] for name in KEPT}
    settings = Settings(bounds=Bounds(**where["bounds"]), **options)
    model = TeacherModel.from_dict(where["model"])
    space = TeacherSpace(model, np.array(where["free"], dtype=np.bool_), settings)
    normal = Normal(np.array(document["mean"], dtype=float), np.array(document["covariance"], dtype=float))
    size = len(space.names)
    if normal.mean.shape != (size,) or normal.root.shape != (size, size):
        raise ModelError(f"mean, covariance: must be of {size} coordinates, as `space` has them")
    plain = ("log_marginal", "pooled_log_likelihood", "converged", "status", "provenance")
    return {
        "space": space,
        "model": TeacherModel.from_dict(document["model"]),
        "pooled": TeacherModel.from_dict(document["pooled"]),
        "normal": normal,
        "common": tuple(Common(**each) for each in document["common"]),
        "teachers": tuple(_teacher(each) for each in document["teachers"]),
        "path": tuple(document["path"]),
        **{name: document[name] for name in plain},
    }


def _teacher(document: Mapping[str, Any]) -> Teacher:
    lists = {name: tuple(document[name]) for name in ("mean", "spread", "own_share")}
    return Teacher(**{**document, **lists, "model": TeacherModel.from_dict(document["model"])})
