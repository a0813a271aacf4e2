"""MODEL.md against the code: its reference values, and the sections that the code cites."""

import re
from pathlib import Path

import pytest

from taskcomm.belief import Belief
from taskcomm.planner import EntropyPlanner
from taskcomm.teacher import TeacherModel
from taskcomm.world import BallWorld

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "taskcomm" / "MODEL.md").read_text(encoding="utf-8")
COLUMNS = ("noa", "light_on", "pick_up")
NUMBERS = re.findall(r"^\| (\d+) \| ([\d.]+) \| ([\d.]+) \| ([\d.]+) \|$", TEXT, re.MULTILINE)
REFERENCE = {int(horizon): dict(zip(COLUMNS, map(float, row), strict=True)) for horizon, *row in NUMBERS}


def test_the_reference_table_goes_to_the_papers_horizon() -> None:
    assert list(REFERENCE) == [1, 2, 3, 4, 5]
    assert "| h | noa | light_on(any) | pick_up(any) |" in TEXT.splitlines()


@pytest.mark.parametrize("horizon", [1, 2, 3])
def test_the_reference_table_is_what_the_planner_computes(horizon: int) -> None:
    world, model = BallWorld(), TeacherModel.intuitive()
    planner = EntropyPlanner(world, model, horizon)
    decision = planner.plan(Belief.initial(world, model), world.start(), exact_values=True)
    assert {action.name for action in decision.values} == set(COLUMNS)
    for action, value in decision.values.items():
        assert value == pytest.approx(REFERENCE[horizon][action.name], rel=0.0, abs=1e-9)


def test_every_section_cited_is_there() -> None:
    sections = re.findall(r"^## (\d+)\. ", TEXT, re.MULTILINE)
    assert sections == list("12345678")
    cited = {
        number
        for folder in ("taskcomm", "learn", "tests")
        for file in (ROOT / folder).rglob("*.py")
        for numbers in re.findall(r"MODEL\.md,\s+sections? ([\d, and]+)", file.read_text(encoding="utf-8"))
        for number in re.findall(r"\d+", numbers)
    }
    assert cited
    assert cited <= set(sections)
