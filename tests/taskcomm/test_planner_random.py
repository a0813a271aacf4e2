"""The planner decides as the whole tree does: values to 1e-9, the same action, over seeded random decisions.

Each comparison is `trees.assert_decides_as`: all values, only those needed, and before a deadline. The
families below say how many decisions there are of each horizon and size of world; what they hold (delays,
decay, rest, discounts, peaked and degenerate beliefs, hundreds of rows) is counted in the last test.
"""

from collections import Counter

import pytest
from decisions import KINDS, Family, compare, counted, group
from teachers import large_world, paper_world, small_world, tiny_world, wide_world

QUICK = (
    Family(1, large_world, groups=8, beliefs=8, rows=5000),
    Family(1, wide_world, groups=4, beliefs=8, rows=2000),
    Family(2, large_world, groups=6, beliefs=8, rows=400),
    Family(2, large_world, groups=4, beliefs=8, rows=600, presses=12),
    Family(3, small_world, groups=16, beliefs=8, rows=100),
    Family(3, tiny_world, groups=6, beliefs=8, rows=300, presses=10),
    Family(4, tiny_world, groups=10, beliefs=8, rows=40),
    Family(5, tiny_world, groups=2, beliefs=8, rows=20),
)
LONG = (
    Family(1, large_world, groups=100, beliefs=16, rows=5000),
    Family(1, large_world, groups=40, beliefs=16, rows=5000, presses=15),
    Family(1, wide_world, groups=40, beliefs=16, rows=4000),
    Family(2, large_world, groups=120, beliefs=16, rows=400),
    Family(2, large_world, groups=60, beliefs=16, rows=1500, presses=12),
    Family(2, wide_world, groups=40, beliefs=16, rows=400),
    Family(3, small_world, groups=160, beliefs=16, rows=150),
    Family(3, large_world, groups=40, beliefs=8, rows=80),
    Family(3, small_world, groups=60, beliefs=16, rows=600, presses=10),
    Family(3, paper_world, groups=20, beliefs=16, rows=100),
    Family(3, paper_world, groups=10, beliefs=8, rows=400, presses=8),
    Family(4, tiny_world, groups=120, beliefs=16, rows=60),
    Family(4, tiny_world, groups=20, beliefs=8, rows=120, presses=10),
    Family(4, small_world, groups=30, beliefs=8, rows=40),
    Family(4, paper_world, groups=8, beliefs=8, rows=48),
    Family(5, tiny_world, groups=30, beliefs=8, rows=30),
    Family(5, small_world, groups=6, beliefs=4, rows=20),
    Family(5, paper_world, groups=2, beliefs=4, rows=24),
)
FRESH = 1 << 20  # the seeds of the long families begin here, so that they repeat none of the quick ones
PART = 10  # groups to a test


def compared(family: Family, seeds: range) -> None:
    total: Counter[str] = Counter()
    for seed in seeds:
        total += compare(family, seed)
    assert total["decisions"] == len(seeds) * family.beliefs
    assert total["one action"] >= 0.99 * total["decisions"]


@pytest.mark.parametrize("family", QUICK, ids=lambda family: family.name)
def test_decides_as_the_whole_tree(family: Family) -> None:
    compared(family, range(family.groups))


@pytest.mark.verify
@pytest.mark.parametrize(
    ("family", "first"),
    [
        pytest.param(family, first, id=f"{family.name}, from {first}")
        for family in LONG
        for first in range(0, family.groups, PART)
    ],
)
def test_decides_as_the_whole_tree_in_thousands_of_situations(family: Family, first: int) -> None:
    compared(family, range(FRESH + first, FRESH + min(first + PART, family.groups)))


def test_there_are_hundreds_of_quick_comparisons() -> None:
    assert sum(family.groups * family.beliefs for family in QUICK) >= 400


@pytest.mark.verify
def test_the_thousands_hold_what_they_promise() -> None:
    total: Counter[str] = Counter()
    for family in LONG:
        total[f"horizon {family.horizon}"] += family.groups * family.beliefs
        for seed in range(FRESH, FRESH + family.groups):
            total += counted(group(family, seed))
    print(dict(total))
    assert sum(total[f"horizon {horizon}"] for horizon in (1, 2, 3, 4)) >= 10_000
    assert total["horizon 4"] >= 2_000
    assert total["horizon 5"] >= 200
    for structure in ("delay", "delay of part of a step", "decay", "rest", "discount"):
        assert total[structure] >= 1_000, structure
    for kind in KINDS:
        assert total[kind.__name__] >= 1_000, kind
    assert total["resting now"] >= 500
    assert total["things alike"] >= 1_000
    assert total["over 100 rows"] >= 500
    assert total["over 300 rows"] >= 200
    for size in ("GraphWorld", "Menu", "2 balls", "3 balls", "4 balls"):
        assert total[size] >= 200, size
    for distances in range(1, 6):
        assert total[f"{distances} distances"] >= 200, distances
    assert total["16 states"] >= 20
