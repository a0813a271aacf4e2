"""Beams and what a later label needs; starts and the length of a step; signals where there is no press."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from taught import WORLD, by_hand
from watched import FACE, GAZE, PUPIL, seeing, watched

from learn import FitError, fit
from learn.coordinates import Bounds, Coordinates
from learn.estep import Evidence
from learn.exposure import expose
from learn.path import starting_points
from learn.timescale import settings_at
from taskcomm.lattice import Floats
from taskcomm.teacher import TableTop, TeacherModel
from taskcomm.trials import Trial

LIKELY = TeacherModel(
    mistake=0.01,
    approvals={
        "that_mov": TableTop("mov_lit", 0.97, 0.5, 4.0),
        "that_wrt": TableTop("wrt_lit_while_mov_held", 0.005, 1.0, 1.0),
        "that_dist": TableTop("mov_at_dist", 0.005, 1.0, 1.0),
    },
)


def _needing(state: str) -> Trial:
    """The key of step 1, in which an approval is all but sure, is lost; a press once its level is 0 again has
    the reason `state` by label."""
    trial = by_hand(["light_on(1)", "noa", "light_off(1)", "noa"], [3])
    steps = [replace(step, pressed=None) if t == 1 else step for t, step in enumerate(trial.steps)]
    label = {"press_seq": trial.step_seqs[3], "mental_state": state, "annotator": "a"}
    return replace(trial, steps=tuple(steps), labels=(label,))


@pytest.mark.parametrize("mass", [1e-3, 0.05, 0.099])
def test_a_label_finds_the_memory_that_it_needs_however_wide_the_beam(mass: float) -> None:
    trial, parameters = _needing("that_mov"), LIKELY.parameters(WORLD.cue_names)
    exact, pruned = (expose([trial], WORLD, LIKELY, labels=True, dropped_mass=each) for each in (0.0, mass))
    whole = Evidence(exact).value(parameters)
    assert np.isfinite(whole)
    assert whole - pruned.dropped - 1e-9 <= Evidence(pruned).value(parameters) <= whole + 1e-9
    assert np.isfinite(pruned.dropped)


def test_what_no_memory_allows_is_the_label_s_fault_not_the_beam_s() -> None:
    trial = _needing("that_dist")
    with pytest.raises(FitError, match="what was observed in step 3 is impossible for all parameters"):
        fit([trial], WORLD, LIKELY, labels=True, dropped_mass=0.05)


@pytest.mark.parametrize(("dt", "steps"), [(0.5, 1.0), (5.0, 1.0), (0.05, 10.0)])
def test_starts_are_as_many_steps_where_steps_are_long_and_as_many_seconds_where_they_are_short(
    dt: float, steps: float
) -> None:
    def times(dt: float) -> list[Floats]:
        two = 4 * max(0.5, dt)
        slow = {state: replace(top, rise=two, fall=two) for state, top in LIKELY.approvals.items()}
        model = replace(LIKELY, approvals=slow, dt=dt)
        free = np.arange(19) < 16
        space = Coordinates(model, settings_at(dt).bounds, free)
        found = starting_points(model, space, 8, np.random.default_rng(0))
        return [space.vector(point)[4:13] / dt for name, point in found if not name.startswith("initial")]

    for reference, found in zip(times(0.5), times(dt), strict=True):
        moved = np.abs(reference - 1) > 1e-9  # a rise of one step stays one
        np.testing.assert_allclose(found[moved], steps * reference[moved], rtol=1e-9)


def test_signals_without_any_press_are_no_reason_to_call_a_fit_degenerate() -> None:
    deaf = [
        replace(trial, steps=tuple(replace(step, pressed=None) for step in trial.steps[:30]))
        for trial in watched(6)
    ]
    options: dict[str, Any] = {"starts": 1, "bounds": Bounds(rise=2.0, fall=2.0), "search": False}
    options["dropped_mass"] = 1e-4
    model = seeing(channels={"gaze": GAZE, "face": FACE, "pupil": PUPIL})
    found = fit(deaf, WORLD, model, **options)
    assert not any("no press" in reason for reason in found.certificate.reasons)
    silent = [replace(trial, steps=tuple(replace(s, signals=None) for s in trial.steps)) for trial in deaf]
    nothing = fit(silent, WORLD, model, **options)
    assert nothing.certificate.kind == "degenerate"
    assert "no press in any trial" in nothing.status
