"""Settings of a fit for steps of any length; their defaults are set for half-second steps."""

import math
from dataclasses import fields, replace

from learn.coordinates import Bounds
from learn.exposure import FitError
from learn.mstep import MistakePrior
from learn.settings import Settings

STEP = 0.5


def settings_at(dt: float, settings: Settings | None = None) -> Settings:
    """`settings` (for steps of 0.5 s; the defaults if None) for steps of `dt` seconds.

    The prior on mistake keeps its rate in time, and weighs as many seconds as before. Bounds stay, in
    seconds, or, where steps are longer than 0.5 s, stay in steps: no rise is forced to be shorter
    than 20 of them.

    >>> settings_at(5.0).bounds.rise, settings_at(0.05).bounds.rise, settings_at(0.05).mistake_prior.steps
    (100.0, 10.0, 1500.0)
    """
    settings = Settings() if settings is None else settings
    ratio, prior = dt / STEP, settings.mistake_prior
    if prior is not None:
        mean = -math.expm1(ratio * math.log1p(-prior.mean))
        prior = MistakePrior(mean=mean, steps=prior.steps / ratio)
    longer = {name.name: getattr(settings.bounds, name.name) * max(1.0, ratio) for name in fields(Bounds)}
    return replace(settings, mistake_prior=prior, bounds=Bounds(**longer))


def within(settings: Settings, longest: float | None) -> Settings:
    """`settings` with rise and fall of at most `longest` seconds, if given."""
    if longest is None:
        return settings
    if not (math.isfinite(longest) and longest > 0):
        raise FitError(f"longest: must be a positive number of seconds, not {longest!r}")
    return replace(settings, bounds=replace(settings.bounds, rise=longest, fall=longest))
