"""The example of cue tables is what its card says, and what the card shows runs as it stands there."""

import json
import re
import shutil
from pathlib import Path

import pytest

from taskcomm.cli import main
from taskcomm.commands.cues import numbers_of
from taskcomm.cuestudies import TEACHER
from taskcomm.cuestudies import main as make
from taskcomm.cuetable import read_cue_tables, validate_cue_tables
from taskcomm.teacher import TeacherModel

FOLDER = Path(__file__).parents[1] / "datasets" / "cue-table-example"
CARD = (FOLDER / "README.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The example, with the cue table that the card's ten lines make of the reaction times."""
    folder = tmp_path_factory.mktemp("example") / "cue-table-example"
    shutil.copytree(FOLDER, folder)
    (code,) = re.findall(r"```python\n(.*?)```", CARD, flags=re.DOTALL)
    assert len([line for line in code.splitlines() if line]) <= 11  # ten, and the import
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        exec(code, {})
    return folder


def test_the_set_is_made_again_to_the_byte(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert make([str(tmp_path)]) == 0
    for name in ("reaction-times.csv", "lights.csv", "teacher.json"):
        assert (tmp_path / name).read_bytes() == (FOLDER / name).read_bytes()
    assert TeacherModel.load(FOLDER / "teacher.json") == TEACHER
    assert make([str(tmp_path / "none")]) == 1
    assert "there is no folder" in capsys.readouterr().err
    assert make([]) == 2


def test_the_lights_are_a_cue_table_without_a_problem() -> None:
    report = validate_cue_tables(FOLDER / "lights.csv")
    assert report.ok
    assert (report.trials, report.steps) == (20, 2000)
    trials = read_cue_tables(FOLDER / "lights.csv")
    assert {trial.source for trial in trials} == {"simulated"}
    assert {trial.dt for trial in trials} == {0.5}
    assert len({trial.participant_id for trial in trials}) == 10


def test_the_conversion_keeps_every_onset_and_every_press(folder: Path) -> None:
    trials = read_cue_tables(folder / "cues.csv", dt=0.05)
    rows = (FOLDER / "reaction-times.csv").read_text().splitlines()[1:]
    assert len(trials) == len(rows) == 240
    for trial, row in zip(trials, rows, strict=True):
        name, person, onset, press, end = row.split(",")
        assert (trial.trial_id, trial.participant_id) == (name, person)
        assert trial.duration == pytest.approx(float(end), abs=0.05)
        assert trial.presses[:-1].sum() == 0
        assert bool(trial.presses[-1]) == bool(press)
        lit = [t for t, state in enumerate(trial.states) if state]
        if lit:
            assert lit == list(range(lit[0], trial.num_steps))
            assert lit[0] * 0.05 == pytest.approx(float(onset), abs=0.025 + 1e-9)
        else:
            assert float(end) <= float(onset) + 0.05


@pytest.mark.verify
def test_the_fit_of_the_card_gives_the_table_of_the_card(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (command,) = re.findall(r"^    taskcomm (fit cues.csv.*)$", CARD, flags=re.MULTILINE)
    monkeypatch.chdir(folder)
    assert main([*command.split(), "--jobs", "1", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["comparison"]["held_out_by"] == "person"
    shown = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in CARD.splitlines()
        if re.match(r"\| [a-z -]+ \| \d+ \| -", line)
    ]
    accounts = document["comparison"]["accounts"]
    assert [row["account"] for row in accounts] == [name for name, *_ in shown]
    for row, (_, parameters, value, bic, held_out, gain) in zip(accounts, shown, strict=True):
        assert row["parameters"] == int(parameters)
        assert row["log_likelihood"] == pytest.approx(float(value), abs=0.06)
        assert row["bic"] == pytest.approx(float(bic), abs=0.1)
        assert row["held_out_per_trial"]["estimate"] == pytest.approx(float(held_out), abs=2e-3)
        minus = row["minus_constant_probability"]
        for number, name in zip(re.findall(r"-?\d\.\d+", gain), ("estimate", "low", "high"), strict=False):
            assert minus[name] == pytest.approx(float(number), abs=5e-3)
    model = TeacherModel.load(folder / "model.json")
    assert 0.22 < model.approvals["that_light"].delay < 0.4
    assert model.dt == 0.05
    drawn = folder / "waits.png"
    assert drawn.read_bytes().startswith(b"\x89PNG")
    assert len(numbers_of(drawn).read_text().splitlines()) > 100
