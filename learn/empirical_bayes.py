"""Fitting a population: Monte Carlo EM over teachers.

Round by round, each teacher's posterior under the population as it stands is drawn from, EM climbs on those
draws, and the population moves there: all the way in the first rounds, then by less and less, so that
the noise of the draws averages out (stochastic approximation; Delyon, Lavielle and Moulines 1999).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from learn.draws import Draws, Weighed, draw, weigh
from learn.em import fit
from learn.exposure import FitError, trial_hash, trials_given
from learn.held_out import person_of
from learn.in_common import in_common
from learn.laplace import Own, laplace
from learn.normal import Normal
from learn.population import Population, Teacher, made_of
from learn.result import FitResult
from learn.spread import Aim, PopulationPrior, climb_spread, stacked
from learn.teacher_space import TeacherSpace
from taskcomm.lattice import Floats
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial
from taskcomm.world import World

FAST_ROUNDS = 6
TOLERANCE = 0.02  # of a standard deviation, in one round
LAST = 5  # times as many draws for what is reported


def fit_population(
    trials: Sequence[Trial],
    world: World | None = None,
    initial: TeacherModel | None = None,
    *,
    pooled: FitResult | None = None,
    prior: PopulationPrior = PopulationPrior(),  # noqa: B008 (frozen)
    full: bool = False,
    draws: int = 400,
    most_rounds: int = 60,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
    **options: Any,
) -> Population:
    """Teachers' parameters around a common mean, each teacher's own given the others'.

    The free coordinates of each teacher (participant_id; a trial without one is a teacher of its own) are
    draws of one normal distribution: log odds of mistake and peaks against waiting, log rises, log falls, and
    what else `options` of `fit` free. Its mean and its variances (with `full`, covariances too) are
    where the likelihood, each teacher's averaged over that distribution, times the weak `prior` is greatest
    (empirical Bayes). Which parameters are free, where the search starts and what stays fixed comes from
    `pooled`, the fit to all trials as those of one teacher, made with `options` where it is not given.

    `draws` are made for each teacher and round, at most `most_rounds` rounds. Deterministic for a seed; the
    order of trials and teachers does not matter. Raises FitError for trials that cannot be fitted, fewer than
    two teachers, or with `full` fewer than coordinates.

    Source: MODEL.md, section 7; empirical Bayes as in Carlin and Louis, Bayesian Methods for Data Analysis.
    """
    trials = trials_given(trials, "a population")
    people = by_teacher(trials)
    if len(people) < 2:
        raise FitError(
            f"a population needs trials of at least two teachers (participant_id), these are all of"
            f" {next(iter(people))}"
        )
    world = trials[0].world if world is None else world
    tell = progress or (lambda done, total: None)
    if pooled is None:
        pooled = fit([trial for own in people.values() for trial in own], world, initial, **options)
    space = TeacherSpace(pooled.model, pooled.free, pooled.settings)
    if full and len(people) < len(space.names):
        raise FitError(
            f"{len(people)} teachers are too few for the full covariance of {len(space.names)} coordinates"
        )
    ends = space.coordinates
    aim = Aim(prior, space.point(pooled.initial), ends.least, ends.most, full)
    search = _Search([space.own(own) for own in people.values()], aim, seed)
    normal = Normal(space.point(pooled.model), prior.spread**2 * np.eye(len(space.names)))
    status, path = f"not converged: still moving after {most_rounds} rounds", []
    for number in range(most_rounds):
        normal, moved, value = search.round(number, normal, draws)
        path.append(value)
        tell(number + 1, most_rounds)
        if number >= FAST_ROUNDS and moved < TOLERANCE:
            status = "converged"
            tell(most_rounds, most_rounds)
            break
    settings = {
        "prior": asdict(prior),
        "full": full,
        "draws": draws,
        "most_rounds": most_rounds,
        "seed": seed,
    }
    provenance = {
        "made_by": "learn.fit_population",
        "versions": pooled.model.provenance["versions"],
        "settings": settings | {"pooled": pooled.settings.to_dict()},
        "trials": len(trials),
        "trial_sha256": sorted(pooled.trial_hashes),
    }
    search.modes = []  # the teachers of the result are found from the mean, as any teacher met later is
    points, log_ratio = stacked(search.draws(most_rounds, normal, LAST * draws))
    weighed = weigh(points, log_ratio, normal)
    return Population(
        space=space,
        model=space.model_at(normal.mean, provenance | {"status": status}),
        pooled=pooled.model,
        normal=normal,
        common=in_common(space.names, normal, aim, points, log_ratio),
        teachers=_teachers(space, people, normal, search.modes, weighed),
        log_marginal=float(weighed.log_marginal.sum()),
        pooled_log_likelihood=pooled.log_likelihood,
        path=tuple(path),
        converged=status == "converged",
        status=status,
        provenance=provenance,
    )


def by_teacher(trials: Sequence[Trial]) -> dict[str, tuple[Trial, ...]]:
    """The trials of each teacher, teachers by name and trials by what they hold: no order matters."""
    people: dict[str, list[Trial]] = {}
    for trial in trials:
        people.setdefault(person_of(trial), []).append(trial)
    return {name: tuple(sorted(people[name], key=trial_hash)) for name in sorted(people)}


def _teachers(
    space: TeacherSpace,
    people: Mapping[str, tuple[Trial, ...]],
    normal: Normal,
    modes: Sequence[Floats],
    weighed: Weighed,
) -> tuple[Teacher, ...]:
    variances = np.diagonal(weighed.covariance, axis1=1, axis2=2)
    return tuple(
        Teacher(
            name=name,
            model=space.model_at(modes[i], made_of("learn.fit_population", trials) | {"teacher": name}),
            mean=tuple(weighed.mean[i].tolist()),
            spread=tuple(np.sqrt(variances[i]).tolist()),
            own_share=tuple(np.clip(1 - variances[i] / normal.spread**2, 0.0, 1.0).tolist()),
            trials=len(trials),
            presses=int(sum(trial.presses.sum() for trial in trials)),
            log_marginal=float(weighed.log_marginal[i]),
            effective=float(weighed.effective[i]),
        )
        for i, (name, trials) in enumerate(people.items())
    )


class _Search:
    """The teachers of one fit, and their draws: those of teacher i in round r come from (seed, r, i)."""

    def __init__(self, owns: Sequence[Own], aim: Aim, seed: int) -> None:
        self.owns, self.aim, self.seed = owns, aim, seed
        self.modes: list[Floats] = []

    def draws(self, number: int, normal: Normal, count: int) -> list[Draws]:
        """Draws of every teacher, made about the posterior under `normal`, whose modes are kept."""
        starts = [[mode] for mode in self.modes] or [[normal.mean] for _ in self.owns]
        about = [laplace(own, normal, start) for own, start in zip(self.owns, starts, strict=True)]
        self.modes = [each.mean for each in about]
        return [
            draw(own, normal, each, count, np.random.default_rng([self.seed, number, i]))
            for i, (own, each) in enumerate(zip(self.owns, about, strict=True))
        ]

    def round(self, number: int, normal: Normal, count: int) -> tuple[Normal, float, float]:
        """The population after one more round, how far it moved (in spreads), and the log-marginal."""
        climbed = climb_spread(self.draws(number, normal, count), normal, self.aim)
        share = 1.0 / max(1, number + 1 - FAST_ROUNDS)
        mean = normal.mean + share * (climbed.normal.mean - normal.mean)
        covariance = normal.covariance + share * (climbed.normal.covariance - normal.covariance)
        after = Normal(mean, covariance)
        return after, after.away_from(normal), float(climbed.weighed.log_marginal.sum())
