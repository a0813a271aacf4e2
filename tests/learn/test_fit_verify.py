"""A fit takes seconds: all starts, on the data sets that are shipped."""

import time
from pathlib import Path

import pytest

from learn import fit
from taskcomm.logs import read_trials
from taskcomm.teacher import TeacherModel

DATA = Path(__file__).parents[2] / "datasets"


@pytest.mark.verify
@pytest.mark.parametrize(
    ("name", "trials", "seconds"), [("simulated-study", 44, 30), ("simulated-large", 200, 60)]
)
def test_the_shipped_trials_are_fitted_in_seconds(name: str, trials: int, seconds: float) -> None:
    logged = read_trials(DATA / name)
    assert len(logged) == trials
    started = time.perf_counter()
    result = fit(logged, initial=TeacherModel.intuitive())
    assert time.perf_counter() - started < seconds
    assert result.converged
