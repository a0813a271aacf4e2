"""Trials at once in real time: every step at its moment, and memory that does not grow."""

from pathlib import Path

import numpy as np
import pytest
from web.loading import Load, loaded


def check(load: Load, trials: int, steps: int) -> None:
    print(load)
    assert len(load.reasons) == trials
    whole = [number for number, reason in zip(load.steps, load.reasons, strict=True) if reason == "timeout"]
    assert whole == [steps] * len(whole)
    assert len(whole) >= 0.9 * trials  # a few may end in Final, by chance
    assert load.missed == 0


def test_a_few_trials_at_once_miss_no_step_and_keep_time(tmp_path: Path) -> None:
    load = loaded(tmp_path, 4, 6.0, horizon=3, processes=1)
    check(load, 4, 12)
    for late in (load.late_ms, load.seen_late_ms):
        assert np.median(late) <= 50.0


@pytest.mark.verify
def test_fifty_trials_at_once_keep_time_and_memory_stays_flat(tmp_path: Path) -> None:
    load = loaded(tmp_path, 50, 120.0, horizon=5, processes=2)
    check(load, 50, 240)
    assert np.mean(np.array(load.late_ms) <= 50.0) >= 0.99
    assert np.median(load.seen_late_ms) <= 50.0
    middle, end = (np.mean(part) for part in np.array_split(load.memory, 4)[-2:])
    assert end <= 1.03 * middle
