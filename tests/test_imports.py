"""What importing loads: the packages stay light, and whatever is heavy waits for its first use."""

import pkgutil
import subprocess
import sys

import pytest

HEAVY = (
    "torch",
    "pomegranate",
    "sklearn",
    "pandas",
    "matplotlib",
    "numba",
    "starlette",
    "uvicorn",
    "IPython",
)
LEARNING = ("torch", "pomegranate", "sklearn", "pandas", "matplotlib")


def run(code: str) -> str:
    """What a fresh interpreter prints."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.parametrize(
    ("statement", "heavy"),
    [
        ("import taskcomm", HEAVY),
        ("from taskcomm import *", HEAVY),
        ("import learn", LEARNING),
        ("from learn import fit, log_likelihood, responsibilities", LEARNING),
    ],
)
def test_an_import_loads_nothing_heavy(statement: str, heavy: tuple[str, ...]) -> None:
    loaded = run(f"{statement}\nimport sys\nprint(*sys.modules)").split()
    assert set(heavy).isdisjoint(loaded)


def test_no_module_of_the_packages_loads_torch() -> None:
    """So neither does reading the doctests of them all."""
    code = """
import importlib, pkgutil, sys, taskcomm, learn
for package in (taskcomm, learn):
    for found in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        importlib.import_module(found.name)
        assert not {"torch", "pomegranate", "sklearn"} & set(sys.modules), found.name
"""
    run(code)


def test_importing_taskcomm_takes_at_most_three_times_as_long_as_numpy() -> None:
    times: dict[str, list[float]] = {"numpy": [], "taskcomm": []}
    for _ in range(7):  # in turns, so that a busy machine slows both
        for name, measured in times.items():
            code = f"from time import perf_counter as now; start = now(); import {name}; print(now() - start)"
            measured.append(float(run(code)))
    assert min(times["taskcomm"]) <= 3 * min(times["numpy"])


def test_every_public_name_is_there_and_documented() -> None:
    import learn
    import taskcomm

    for package in (taskcomm, learn):
        for name in package.__all__:
            assert getattr(package, name).__doc__, name
        assert set(package.__all__) <= set(dir(package))
    with pytest.raises(AttributeError, match="no attribute 'BallWorlds'"):
        _ = taskcomm.BallWorlds
    with pytest.raises(AttributeError, match="no attribute 'fitt'"):
        _ = learn.fitt


def test_no_public_name_of_learn_is_also_a_modules() -> None:
    """Else what `from learn import name` gives would depend on what was imported before."""
    import learn

    modules = {found.name for found in pkgutil.iter_modules(learn.__path__)}
    assert modules.isdisjoint(learn.__all__)
