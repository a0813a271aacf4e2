"""`taskcomm serve` and `taskcomm study serve`, as they are called."""

import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from web.houses import receive, send
from websockets import Origin
from websockets.sync.client import connect

from taskcomm.cli import main
from taskcomm.logs import read_trials
from taskcomm.web.study.folder import StudyFolder
from taskcomm.web.study.structure import Design


@contextmanager
def called(*arguments: str, folder: Path) -> Iterator["subprocess.Popen[str]"]:
    command = [sys.executable, "-m", "taskcomm.cli", *arguments]
    environment = os.environ | {"PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(
        command,
        cwd=folder,
        text=True,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def printed(process: "subprocess.Popen[str]", word: str) -> str:
    """The address in the line that holds `word`."""
    assert process.stdout is not None
    for line in process.stdout:
        if word in line:
            return next(part for part in line.split() if part.startswith("http"))
    raise AssertionError(process.stderr.read() if process.stderr else "")


def test_serve_runs_one_trial_and_ends_when_it_is_over(tmp_path: Path) -> None:
    arguments = ("serve", "--out", "one", "--port", "0", "--horizon", "1", "--limit", "1", "--task", "1,2,4")
    with called(*arguments, folder=tmp_path) as process:
        address, token = printed(process, "teach the robot").split("/#")
        uri = address.replace("http", "ws") + "/ws"
        with connect(uri, origin=Origin(address)) as teacher:
            send(teacher, type="hello", token=token)
            card = receive(teacher, "page")
            assert (card["kind"], card["content"]["mov"]) == ("card", 1)
            send(teacher, type="answer", index=card["index"], values={})
            while receive(teacher, "page", timeout=20)["kind"] != "thanks":
                pass
        said, _ = process.communicate(timeout=20)
    assert process.returncode == 0
    assert "P01-1.jsonl: the trial" in said
    [trial] = read_trials(tmp_path / "one" / "trials")
    assert (trial.source, trial.reason, trial.num_steps, tuple(trial.task or ())) == (
        "human",
        "timeout",
        2,
        (1, 2, 4),
    )


def test_interrupted_it_ends_in_good_order(tmp_path: Path) -> None:
    StudyFolder.new(tmp_path / "study", Design(name="small", teachers=1))
    with called("study", "serve", "study", "--port", "0", folder=tmp_path) as process:
        printed(process, "admin")
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=20)
    assert process.returncode in (0, 130)
    assert "Traceback" not in errors
    kinds = [
        json.loads(line)["kind"] for line in (tmp_path / "study" / "server.jsonl").read_text().splitlines()
    ]
    assert kinds == ["start", "stop"]


def test_a_port_that_is_taken_is_said_and_no_folder_is_made(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        assert main(["serve", "--out", str(tmp_path / "one"), "--port", port]) == 1
    assert f"cannot listen on 127.0.0.1:{port}" in capsys.readouterr().err
    assert not (tmp_path / "one").exists()


def test_without_the_packages_of_the_server_it_says_which_to_install(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("taskcomm.commands.serve.find_spec", lambda name: None)
    assert main(["serve"]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "starlette, uvicorn, websockets" in said
    assert "taskcomm[web]" in said


@pytest.mark.parametrize(
    ("task", "why"),
    [("1,2", "as in 1,2,4"), ("1,1,2", "two balls of 1 to 3"), ("a,b,c", "as in 1,2,4")],
)
def test_a_card_that_cannot_be_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], task: str, why: str
) -> None:
    assert main(["serve", "--out", str(tmp_path / "one"), "--port", "0", "--task", task]) in (2, 3)
    assert why in " ".join(capsys.readouterr().err.replace("│", " ").split())
    assert not (tmp_path / "one").exists()


def test_lockstep_is_for_simulated_studies(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    StudyFolder.new(tmp_path / "study", Design(name="small", teachers=1))
    assert main(["study", "serve", str(tmp_path / "study"), "--lockstep"]) == 2
    assert "simulated study" in " ".join(capsys.readouterr().err.split())
