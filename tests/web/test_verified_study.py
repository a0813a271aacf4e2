"""Trials that ran at a server, run again from their logs."""

from pathlib import Path

import pytest
from web.rehearsing import run_through, study

from taskcomm.logs import read_trials
from taskcomm.verification import verify


@pytest.mark.verify
def test_what_planner_and_operator_did_at_the_server_is_found_as_logged(tmp_path: Path) -> None:
    folder = study(tmp_path / "study", 3)
    run_through(folder, seed=3)
    found = [verify(trial) for trial in read_trials(folder.trials_dir)]
    assert sorted(each.controller for each in found) == ["operator"] * 3 + ["planner"] * 3
    assert [each.difference for each in found] == [None] * 6
    assert all(each.decisions > 5 for each in found)
