"""What the README shows runs as it stands there."""

import re
from pathlib import Path

import pytest

from taskcomm.cli import main
from taskcomm.logs import read_trials, write_trials

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_library_lines_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    (code,) = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    names: dict[str, object] = {}
    exec(code, names)
    assert str(names["action"]) == "light_on(1)"


def test_files_and_pictures_exist() -> None:
    named = re.findall(r'(?:src="|\]\()([\w./-]+)', README)
    named += re.findall(r"`((?:taskcomm|learn|tests|notebooks|datasets)/[\w./-]+)`", README)
    for row in re.findall(r"^\| (`[^|]+) \|", README, flags=re.MULTILINE):
        first, *others = re.findall(r"`([^`]+)`", row)
        named += [first, *(f"{first.rpartition('/')[0]}/{name}" for name in others if "/" not in name)]
    assert len(named) > 40
    for name in named:
        assert (ROOT / name).exists(), name


def test_commands_and_their_options_exist(capsys: pytest.CaptureFixture[str]) -> None:
    lines = re.findall(r"^    taskcomm (study \w+|\w+)(.*)$", README, flags=re.MULTILINE)
    named = {*("validate", "fit", "compare", "replay", "simulate", "structure", "population", "recover")}
    of_study = [f"study {name}" for name in ("new", "rehearse", "serve", "status", "export")]
    assert {command for command, _ in lines} == named | {"serve", "figures", *of_study}
    for command, rest in lines:
        assert main([*command.split(), "--help"]) == 0
        shown = capsys.readouterr().out
        for option in re.findall(r"--[a-z-]+", rest):
            assert option in shown, (command, option)


def test_fit_and_replay_run_as_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    logs = ROOT / "datasets" / "simulated-study" / "trials.jsonl"
    trial = read_trials(logs)[0]
    write_trials([trial], tmp_path / "log.jsonl")
    monkeypatch.chdir(tmp_path)
    names = {"LOGS": "log.jsonl", "LOG": "log.jsonl", "ID": trial.trial_id}
    for command in ("validate", "fit", "replay"):
        lines = re.findall(rf"^    taskcomm ({command} LOGS?\b[^#\n]*)", README, flags=re.MULTILINE)
        assert lines
        for line in lines:
            assert main([names.get(word, word) for word in line.split()]) == 0, line
