"""The files around the code agree with it and with one another."""

import importlib.metadata
import os
import re
import tomllib
from pathlib import Path

import taskcomm

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
PINS = dict(
    line.split("==")
    for line in (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    if line and not line.startswith("#")
)


def plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def test_every_dependency_has_one_exact_pin_within_its_range() -> None:
    from packaging.requirements import Requirement

    pins = {plain(name): version for name, version in PINS.items()}
    extras = PROJECT["optional-dependencies"]
    for text in [*PROJECT["dependencies"], *extras["learn"], *extras["dev"]]:
        requirement = Requirement(text)
        assert requirement.specifier.contains(pins[plain(requirement.name)]), text
    assert "taskcomm" not in pins


def test_the_citation_states_this_version_and_the_paper() -> None:
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.search(rf"^version: {re.escape(taskcomm.__version__)}$", citation, re.MULTILINE)
    assert "Framing Human-Robot Task Communication as a POMDP" in citation


def test_the_command_is_installed_and_the_packages_say_they_are_typed() -> None:
    (command,) = importlib.metadata.entry_points(group="console_scripts", name="taskcomm")
    assert command.value == "taskcomm.cli:main"
    assert importlib.metadata.version("taskcomm") == taskcomm.__version__
    for package in ("taskcomm", "learn"):
        assert (ROOT / package / "py.typed").is_file()


def test_ci_runs_what_anyone_can_run() -> None:
    script = ROOT / ".ci" / "run"
    assert os.access(script, os.X_OK)
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    asked = re.findall(r"^make ([a-z ]+)", script.read_text(encoding="utf-8"), re.MULTILINE)
    assert {name for line in asked for name in line.split()} <= targets
    assert {"setup", "demo", "test", "check", "verify", "bench", "clean"} <= targets
