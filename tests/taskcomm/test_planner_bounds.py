"""The compiled search stays within its arrays, over random worlds and models, cut off anywhere."""

from pathlib import Path

import pytest
from newprocess import run

pytestmark = pytest.mark.verify

CHECKED = """
from collections import Counter
import numpy as np
from decisions import Family, compare, group
from teachers import large_world, paper_world, small_world, tiny_world, wide_world
from taskcomm.compiling import kernel
from taskcomm.planner import EntropyPlanner

@kernel(__name__, "a check", error_model="numpy")
def at(array, index):
    return array[index]

def refused(call):
    try:
        call()
    except IndexError:
        return True
    return False

assert refused(lambda: at(np.zeros(3), 3)), "boundaries are not checked"

families = (
    Family(1, large_world, groups=60, beliefs=3, rows=5000),
    Family(1, wide_world, groups=30, beliefs=3, rows=4000),
    Family(2, large_world, groups=60, beliefs=3, rows=400),
    Family(2, large_world, groups=20, beliefs=3, rows=600, presses=12),
    Family(2, wide_world, groups=20, beliefs=3, rows=200),
    Family(3, small_world, groups=60, beliefs=3, rows=100),
    Family(3, large_world, groups=10, beliefs=3, rows=80),
    Family(3, small_world, groups=20, beliefs=3, rows=300, presses=10),
    Family(4, tiny_world, groups=60, beliefs=3, rows=40),
    Family(5, tiny_world, groups=10, beliefs=3, rows=20),
)
total, groups = Counter(), 0
for family in families:
    for seed in range(1 << 30, (1 << 30) + family.groups):  # seeds of their own
        total += compare(family, seed)
        groups += 1
rng = np.random.default_rng(3)
for seed in range(40):  # cut off anywhere, in little memory, at horizons that are not reached
    of = group(Family(12, large_world, groups=40, beliefs=6, rows=2000), seed)
    planner = EntropyPlanner(of.world, of.model, 12, gamma=of.gamma, memory=1 << 22)
    for _, belief, state in of.situations:
        planner.plan(belief, state, deadline=float(rng.uniform(0.001, 0.1)))
        total["cut off"] += 1

of = group(Family(3, small_world, groups=1, beliefs=1, rows=100), 0)
[(_, belief, state)] = of.situations
planner = EntropyPlanner(of.world, of.model, 3)
planner.plan(belief, state)
planner._graph.successor = planner._graph.successor[:1].copy()
assert refused(lambda: planner.plan(belief, state)), "the search is not checked"
print(groups, total["decisions"], total["cut off"])
"""


def test_no_kernel_leaves_its_arrays_over_hundreds_of_worlds_and_models(tmp_path: Path) -> None:
    done = run(CHECKED, NUMBA_BOUNDSCHECK="1", NUMBA_CACHE_DIR=str(tmp_path))
    assert done.returncode == 0, done.stderr[-4000:]
    assert done.stdout.split() == ["350", "1050", "240"]


INTERPRETED = """
import linecache, sys
import numpy as np
from decisions import Family, group
from teachers import large_world, small_world, tiny_world, wide_world
from taskcomm import BallWorld, Belief, EntropyPlanner, TeacherModel, _outlook, _search

looked, seen = 0, set()

def check(key):
    global looked
    looked += 1
    for part in key if isinstance(key, tuple) else (key,):
        ends = (part.start, part.stop) if isinstance(part, slice) else (part,)
        if any(end is not None and np.min(end, initial=0) < 0 for end in ends):
            at = sys._getframe(2)
            if "[-1" not in linecache.getline(at.f_code.co_filename, at.f_lineno):  # not written so
                raise IndexError(f"{key} counts from the end: {at.f_code.co_filename}, line {at.f_lineno}")

class Guarded(np.ndarray):
    def __getitem__(self, key):
        check(key)
        return super().__getitem__(key)

    def __setitem__(self, key, value):
        check(key)
        super().__setitem__(key, value)

def guard(argument):
    if isinstance(argument, tuple):  # the search takes its arrays by what they are about
        return type(argument)(*map(guard, argument))
    return argument.view(Guarded) if isinstance(argument, np.ndarray) else argument

def guarded(kernel):
    def call(*arguments):
        before = looked
        result = kernel(*map(guard, arguments))
        if looked > before:
            seen.add(kernel.__name__)
        return result
    return call

kernels = 0
for module in (_search, _outlook):
    for name, kernel in list(vars(module).items()):
        if callable(kernel) and kernel.__module__ == module.__name__ and not name.startswith("_"):
            setattr(module, name, guarded(kernel))
            kernels += 1

index = -1
try:
    np.zeros(3).view(Guarded)[index]
    sys.exit("nothing is checked")
except IndexError:
    pass

np.seterr(all="ignore")
plans = 0
for family in (
    Family(1, large_world, groups=6, beliefs=1, rows=400),
    Family(1, wide_world, groups=4, beliefs=1, rows=400),
    Family(2, small_world, groups=20, beliefs=1, rows=100),
    Family(2, wide_world, groups=4, beliefs=1, rows=50),
    Family(3, tiny_world, groups=20, beliefs=1, rows=40),
    Family(3, small_world, groups=10, beliefs=1, rows=30),
    Family(4, tiny_world, groups=6, beliefs=1, rows=20),
):
    for seed in range(family.groups):
        of = group(family, seed)
        [(_, belief, state)] = of.situations
        EntropyPlanner(of.world, of.model, family.horizon, gamma=of.gamma).plan(belief, state)
        plans += 1
world, model = BallWorld(3, 2), TeacherModel.intuitive()
planner, belief = EntropyPlanner(world, model, 2, memory=40_000), Belief.initial(world, model)
state = world.start()
for step in range(12):  # further and further from where it began, so that what is known has to be dropped
    planner.plan(belief, state)
    state = world.step(state, world.actions(state)[-1 - step % 2])
    belief = belief.update(state, False)
print(*sorted(seen), kernels - len(seen), plans, looked > 500_000)
"""


def test_no_kernel_counts_from_the_end_of_an_array_unasked() -> None:
    """Boundary checks let pass an index below 0, so the kernels run uncompiled on arrays that do not."""
    done = run(INTERPRETED, NUMBA_DISABLE_JIT="1")
    assert done.returncode == 0, done.stderr[-4000:]
    assert done.stdout.split() == ["compare", "cut", "fill", "lay", "search", "spread", "0", "70", "True"]
