"""The planner works without a folder for compiled code, in several threads, and starts quickly."""

import shutil
import threading
from pathlib import Path

import pytest
from newprocess import run

import taskcomm
from taskcomm.belief import Belief
from taskcomm.decision import Decision
from taskcomm.planner import EntropyPlanner
from taskcomm.teacher import TeacherModel
from taskcomm.world import BallWorld

PACKAGE = Path(taskcomm.__file__).parent
START_UP = 2.0  # seconds of processor time

FIRST_PLAN = """
import sys, time
from pathlib import Path
import taskcomm
from taskcomm import BallWorld, Belief, EntropyPlanner, TeacherModel
world, model = BallWorld(), TeacherModel.intuitive()
decision = EntropyPlanner(world, model).plan(Belief.initial(world, model), world.start())
print(Path(taskcomm.__file__).parent, decision.action, round(decision.value, 6), time.process_time())
"""


@pytest.mark.verify
def test_without_a_folder_for_compiled_code_the_planner_compiles_in_memory(tmp_path: Path) -> None:
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(PACKAGE, tmp_path / "taskcomm", ignore=ignored)
    for folder in tmp_path.glob("taskcomm/**/"):
        (folder / "__pycache__").write_text("")  # a file: no folder can be made here, by root neither
    (tmp_path / "home").write_text("")
    nowhere = str(tmp_path / "home" / "me")
    folders = {"HOME": nowhere, "XDG_CACHE_HOME": nowhere, "NUMBA_CACHE_DIR": nowhere}
    done = run(FIRST_PLAN, tmp_path, **folders)
    assert done.returncode == 0, done.stderr[-4000:]
    assert done.stdout.split()[:3] == [str(tmp_path / "taskcomm"), "light_on(1)", "15.661811"]
    said = done.stderr.splitlines()
    assert sum("compiling the planner's search" in line for line in said) == 1
    assert all("compiling" in line and "in every process" in line for line in said)
    assert "NUMBA_CACHE_DIR" in said[0]


TOGETHER = """
import threading
from collections import Counter
from numba.core import event
from taskcomm import BallWorld, Belief, EntropyPlanner, TeacherModel

class Counted(event.Listener):
    def __init__(self):
        self.times = Counter()
    def on_start(self, event):
        compiled = event.data["dispatcher"].py_func
        if compiled.__module__.startswith("taskcomm."):
            self.times[f"{compiled.__module__}.{compiled.__name__}{event.data['args']}"] += 1
    def on_end(self, event):
        pass

counted = Counted()
event.register("numba:compile", counted)
together, decided = threading.Barrier(4), []

def robot(balls):
    world, model = BallWorld(balls, 3), TeacherModel.intuitive()
    planner = EntropyPlanner(world, model, 3)
    together.wait()
    decided.append(str(planner.plan(Belief.initial(world, model), world.start()).action))

robots = [threading.Thread(target=robot, args=(balls,)) for balls in (2, 3, 3, 4)]
for thread in robots:
    thread.start()
for thread in robots:
    thread.join()
searches = [name for name in counted.times if name.startswith("taskcomm._search.search(")]
print(len(decided), set(decided), len(searches), max(counted.times.values(), default=0))
"""


@pytest.mark.verify
def test_robots_that_start_together_compile_once_and_the_next_process_not_at_all(tmp_path: Path) -> None:
    first = run(TOGETHER, NUMBA_CACHE_DIR=str(tmp_path))
    assert first.returncode == 0, first.stderr[-4000:]
    assert first.stdout.strip() == "4 {'light_on(1)'} 1 1"
    said = first.stderr.splitlines()
    assert sum("compiling the planner's search" in line for line in said) == 1
    assert all(line.startswith("compiling") and "once per machine" in line for line in said)
    second = run(TOGETHER, NUMBA_CACHE_DIR=str(tmp_path))
    assert (second.stdout.strip(), second.stderr) == ("4 {'light_on(1)'} 0 0", "")


def test_the_first_plan_of_a_process_takes_less_than_two_seconds_once_compiled() -> None:
    world, model = BallWorld(), TeacherModel.intuitive()
    EntropyPlanner(world, model).warm_up()
    spent = []
    for _ in range(2):  # in case another process was still writing what it had compiled
        done = run(FIRST_PLAN)
        assert done.returncode == 0, done.stderr[-4000:]
        assert done.stdout.split()[1] == "light_on(1)"
        spent.append(float(done.stdout.split()[3]))
        if done.stderr == "" and spent[-1] < START_UP:
            break
    assert done.stderr == ""
    assert spent[-1] < START_UP, spent


def trial(balls: int, horizon: int) -> list[Decision]:
    """The decisions of a robot whose teacher presses in every fourth step."""
    world, model = BallWorld(balls, 3), TeacherModel.intuitive()
    planner = EntropyPlanner(world, model, horizon)
    belief, state, decisions = Belief.initial(world, model), world.start(), []
    for step in range(12):
        decisions.append(planner.plan(belief, state))
        state = world.step(state, decisions[-1].action)
        belief = belief.update(state, step % 4 == 3)
    return decisions


def test_robots_that_plan_at_the_same_time_decide_as_they_would_alone() -> None:
    robots = [(2, 4), (3, 3), (3, 4), (4, 2)] * 2
    alone = [trial(*robot) for robot in robots]
    found: dict[int, list[Decision]] = {}
    together = threading.Barrier(len(robots))

    def work(number: int) -> None:
        together.wait()
        found[number] = trial(*robots[number])

    threads = [threading.Thread(target=work, args=(number,)) for number in range(len(robots))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [found[number] for number in range(len(robots))] == alone

    from taskcomm import _search

    assert len(_search.search.signatures) == 1
