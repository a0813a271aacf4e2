"""What trials like those at hand would tell of a model's parameters if it were true."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from learn.coordinates import Coordinates, model_at, parameters_at, vector_of
from learn.estep import Evidence
from learn.exposure import FitError, expose
from learn.prior import Prior, Pull
from taskcomm.channels import ObservationModel
from taskcomm.simulate import SimulatedTeacher
from taskcomm.smoother import task_prior
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Step, Trial
from taskcomm.world import World

ASIDE = 1e-3


def pull_of(
    prior: Prior,
    trials: Sequence[Trial],
    world: World,
    initial: TeacherModel,
    space: Coordinates,
    weights: ArrayLike | None = None,
    tasks: ArrayLike | None = None,
) -> Pull:
    """A prior as a density over the coordinates of `space`, for a fit to `trials` from `initial`.

    The information of a trial is the mean of score times score, each score that of an imaginary trial.
    It is taken a little to either side of the model's rises and falls, which often lie at kinks, and
    averaged. The keys of imaginary trials never err. `weights` (trials,) are how often each trial counts,
    `tasks` the prior of unknown ones.
    Raises FitError where the prior's model has other approval states, cues, rest or dt than `initial`.
    """
    model = initial if prior.model is None else prior.model
    _check(model, initial)
    model = replace(model, observation=ObservationModel())
    centre = space.point(vector_of(model))
    mean = np.zeros((len(centre), len(centre)))
    chosen = imagined(prior, trials, world, model, weights, tasks)
    for aside in (-ASIDE, ASIDE):
        times = [kind in ("rise", "fall") for kind in space.kinds]
        vector = space.vector(np.clip(centre + np.where(times, aside, 0.0), space.least, space.most))
        near = model_at(vector, model)
        parameters = parameters_at(vector, model.parameters(world.cue_names))
        for trial in chosen:
            _, rates = Evidence(expose([trial], world, near, prior=tasks)).value_and_rates(parameters)
            score = space.rates(vector, rates)
            mean += np.outer(score, score) / (2 * len(chosen))
    return Pull(centre, prior.trials * mean)


def imagined(
    prior: Prior,
    trials: Sequence[Trial],
    world: World,
    model: TeacherModel,
    weights: ArrayLike | None = None,
    tasks: ArrayLike | None = None,
) -> list[Trial]:
    """`prior.draws` trials with the cues of `trials`, each in its turn, and presses drawn from `model`.

    A trial whose task is unknown stays so, its presses those of a task drawn from `tasks`; key states
    that were not recorded stay that. Signals of other channels are left out, labels too.
    """
    rng = np.random.default_rng(prior.seed)
    share = np.ones(len(trials)) if weights is None else np.asarray(weights, dtype=np.float64)
    places = np.cumsum(share) / share.sum()
    which = np.searchsorted(places, (np.arange(prior.draws) + 0.5) / prior.draws)
    weight = task_prior(world, tasks)
    found = []
    for number in which:
        trial = trials[min(int(number), len(trials) - 1)]
        task = world.tasks[int(rng.choice(len(weight), p=weight))] if trial.task is None else trial.task
        teacher = SimulatedTeacher(world, model, task)
        pressed = [teacher.observe(state, rng) for state in trial.states]
        steps = tuple(
            Step(step.action, None if step.pressed is None else press)
            for step, press in zip(trial.steps, pressed, strict=True)
        )
        found.append(replace(trial, steps=steps, labels=()))
    return found


def _check(model: TeacherModel, initial: TeacherModel) -> None:
    """Raise FitError where two models are not of the same things."""

    def described(of: TeacherModel) -> dict[str, object]:
        cues = {state: top.cue for state, top in of.approvals.items()}
        return {"dt": of.dt, "rest": of.rest, "approval states and their cues": cues}

    for name, value in described(initial).items():
        other = described(model)[name]
        if other != value:
            raise FitError(f"prior.model: {name}: {other}, but {value} in the initial model")
