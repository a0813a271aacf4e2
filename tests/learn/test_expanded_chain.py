"""A cue always on, levels on a grid: the teacher is then a plain Markov chain, with the same E-step."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.estep.problem import MODEL, WORLD, by_loops, expanded, simulated

from learn.em import prepare
from learn.estep import Evidence
from learn.exposure import expose
from learn.settings import Settings
from taskcomm.teacher import TableTop, TeacherModel

STEEP = TeacherModel(mistake=0.03, approvals={"approves": TableTop("on", peak=0.6, rise=1.0, fall=1.0)})


def test_rows_of_the_chain_are_distributions_and_a_press_of_approval_resets_the_level() -> None:
    chain = expanded()
    assert len(chain.start) == 12
    np.testing.assert_allclose(chain.matrix.sum(axis=1), 1.0, atol=1e-15)
    np.testing.assert_allclose([chain.start.sum(), *chain.press.sum(axis=0)], 1.0, atol=1e-15)
    full = expanded().matrix[chain.mental != 2].reshape(4, 2, 12)
    np.testing.assert_array_equal(full[:, 0], full[:, 1])  # waiting and mistakes leave the level alone
    after = chain.matrix[chain.mental == 2]
    np.testing.assert_array_equal(after, np.tile(chain.start, (4, 1)))


@pytest.mark.parametrize("model", [MODEL, STEEP], ids=["rises in 2 s", "rises in 1 s"])
def test_the_e_step_is_forward_backward_of_the_expanded_chain(model: TeacherModel) -> None:
    trials, chain, parameters = simulated(6, 80, model), expanded(model), model.parameters(WORLD.cue_names)
    small, wide = Evidence(expose(trials, WORLD, model)), prepare(trials, WORLD, model, Settings()).evidence
    assert sum(int(trial.presses.sum()) for trial in trials) > 20
    for evidence in (small, wide):
        found = evidence.expect(parameters)
        for unit, trial in enumerate(trials):
            log_likelihood, at_presses = by_loops(chain, trial.presses)
            assert found.log_likelihood[unit] == pytest.approx(log_likelihood, abs=1e-11)
            np.testing.assert_allclose(evidence.chain.reasons(unit), at_presses, atol=1e-11)


def test_levels_off_the_grid_and_longer_memories_are_refused() -> None:
    top = MODEL.approvals["approves"]
    for other in (replace(top, rise=1.7), replace(top, delay=0.5), replace(top, decay=3.0)):
        with pytest.raises(ValueError, match="its levels are on no grid, or its memory is longer"):
            expanded(replace(MODEL, approvals={"approves": other}))
