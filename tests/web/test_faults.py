"""Disks that fail, crashes at awkward moments, lines gone silent: what is lost, and who is told."""

import gc
import logging
import os
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import pytest
from web.houses import Served, receive, send, served
from web.test_server import QUICK, begun, chosen, closed
from websockets.sync.client import ClientConnection

from taskcomm.logs import read_trials, validate
from taskcomm.web import house as house_module
from taskcomm.web.client import Client
from taskcomm.web.house import House
from taskcomm.web.protocol import Role
from taskcomm.web.serving import _allow_files, origins_of
from taskcomm.web.study.folder import StudyFolder
from taskcomm.web.study.reading import StudyError
from taskcomm.web.study.structure import Operators

TWO = msgspec.structs.replace(QUICK, teachers=2, operators=Operators(pool=("O1",), draw=1))


@pytest.fixture
def folder(tmp_path: Path) -> StudyFolder:
    return StudyFolder.new(tmp_path / "study", TWO)


@pytest.fixture
def study(folder: StudyFolder) -> Iterator[Served]:
    with served(folder) as running:
        yield running


def until_page(client: ClientConnection, kind: str) -> dict[str, object]:
    page = receive(client, "page")
    while page["kind"] != kind:
        page = receive(client, "page")
    return page


def on_loop(study: Served, act: Callable[[], None]) -> None:
    """Do something in one turn of the server's loop."""
    done = threading.Event()

    def both() -> None:
        act()
        done.set()

    study.loop.call_soon_threadsafe(both)
    assert done.wait(5)


class Disk:
    """Writes of what holds `marked` fail while it is full."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.full, self.marked, self._write = False, b"", os.write
        monkeypatch.setattr(os, "write", self.write)

    def write(self, file: int, content: bytes) -> int:
        if self.full and self.marked in bytes(content):
            raise OSError(28, "No space left on device")
        return self._write(file, content)


def test_a_full_disk_stops_a_trial_which_a_reload_goes_on_with(
    study: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    teacher, operator = begun(study)
    receive(teacher, "frame")
    disk = Disk(monkeypatch)
    disk.marked, disk.full = b'"type":"step"', True
    assert "could not be saved" in receive(teacher, "problem")["text"]
    on_loop(study, lambda: None)
    assert "No space left" in study.house.rooms["P01"].trouble
    send(operator, type="ready")
    disk.full = False
    again = study.hello("teacher", "P01")
    assert until_page(again, "wait")
    send(operator, type="ready")
    while receive(again, "frame")["state"] != "over":
        pass
    assert until_page(again, "form")
    report = validate(study.house.folder.trials_dir / "P01-1.jsonl")
    assert report.ok, report.problems
    [trial] = read_trials(study.house.folder.trials_dir)
    assert [event["type"] for event in trial.events if "type" in event] == ["resume"]


def test_a_press_that_is_not_on_disk_is_not_acknowledged(
    study: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    teacher, _ = begun(study)
    disk = Disk(monkeypatch)
    disk.marked, disk.full = b'"kind":"press"', True
    send(teacher, type="press", n=1, at=1)
    assert receive(teacher, "ack", "problem")["type"] == "problem"
    assert b'"kind":"press"' not in (study.house.folder.trials_dir / "P01-1.jsonl").read_bytes()


def test_an_answer_that_cannot_be_written_is_told_and_may_be_given_again(
    study: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = Disk(monkeypatch)
    disk.marked, disk.full = b'"type":"page"', True
    teacher = study.hello("teacher", "P01")
    send(teacher, type="answer", index=0, values={})
    assert receive(teacher, "ack", "problem")["type"] == "problem"
    assert not study.house.folder.session_of("P01").read_bytes()
    disk.full = False
    send(teacher, type="answer", index=0, values={})
    assert receive(teacher, "ack", "problem") == {"type": "ack", "what": "answer", "n": 0}
    assert study.house.rooms["P01"].trouble == ""


def test_an_operator_is_not_held_by_a_trial_that_cannot_go_on(folder: StudyFolder) -> None:
    (folder.trials_dir / "P01-1.jsonl").write_text('{"no":"log"}\n')
    with served(folder) as study:
        operator = study.hello("operator", "O1")
        for person in ("P01", "P02"):
            teacher = study.hello("teacher", person)
            send(teacher, type="answer", index=0, values={})
            assert until_page(teacher, "wait")
            while (seat := receive(operator, "seat"))["participant"] != person or seat["state"] != "ask":
                pass
            send(operator, type="ready")
            if person == "P01":
                assert receive(teacher, "problem")["text"]
        assert until_page(teacher, "trial")


def test_a_crash_after_the_end_of_a_trial_needs_no_operator_to_go_on(folder: StudyFolder) -> None:
    with served(folder) as study:
        teacher, _ = begun(study)
        assert until_page(teacher, "form")
    session = folder.session_of("P01")
    whole = session.read_bytes()
    session.write_bytes(b"".join(whole.splitlines(keepends=True)[:-1]))
    with served(folder) as study:
        teacher = study.hello("teacher", "P01")
        assert until_page(teacher, "form")
    [_, line] = map(msgspec.json.decode, session.read_bytes().splitlines())
    assert line["values"] == {"trial_id": "P01-1", "reason": "timeout"}


def test_ratings_cut_from_the_session_are_given_again_and_the_last_count(folder: StudyFolder) -> None:
    with served(folder) as study:
        teacher, _ = begun(study)
        index = until_page(teacher, "form")["index"]
        send(teacher, type="answer", index=index, values={"intelligence": 3, "right": "yes"})
        assert until_page(teacher, "thanks")
    session = folder.session_of("P01")
    session.write_bytes(b"".join(session.read_bytes().splitlines(keepends=True)[:-1]) + b'{"torn')
    with served(folder) as study:
        teacher = study.hello("teacher", "P01")
        assert until_page(teacher, "form")
        send(teacher, type="answer", index=index, values={"intelligence": 8, "right": "yes"})
        assert until_page(teacher, "thanks")
    [trial] = read_trials(folder.trials_dir)
    rated = [(line["item"], line["value"]) for line in trial.ratings]
    assert rated == [("intelligence", 3), ("right", "yes"), ("intelligence", 8)]
    assert validate(folder.trials_dir).ok
    assert b'"intelligence":8' in session.read_bytes()


def test_a_silent_page_is_away_until_it_is_heard(study: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(house_module, "SILENCE", 0.3)
    monkeypatch.setattr(house_module, "STATUS_EVERY", 0.1)
    teacher, _ = begun(study)
    run = study.house.rooms["P01"].run
    assert run is not None
    while receive(teacher, "frame")["state"] != "pause":  # it answers no ping unless one comes meanwhile
        study.house.rooms["P01"].client.heard -= 1.0  # type: ignore[union-attr]
    monkeypatch.setattr(house_module, "SILENCE", 60.0)
    send(teacher, type="focus", on=True, at=1)
    while receive(teacher, "frame")["state"] != "over":
        pass
    assert until_page(teacher, "form")
    [trial] = read_trials(study.house.folder.trials_dir)
    [away] = [event for event in trial.events if event["kind"] == "away"]
    assert away["silent_ms"] >= 300
    assert not trial.recorded.all()
    assert trial.num_steps == 40


def test_who_leaves_in_the_moment_before_a_trial_does_not_miss_it(study: Served) -> None:
    room = study.house.rooms["P01"]
    operator, teacher = study.hello("operator", "O1"), study.hello("teacher", "P01")
    send(teacher, type="answer", index=0, values={})
    assert until_page(teacher, "wait")

    def ready_and_gone() -> None:
        study.house.desks["O1"].ready = True
        room.begin_if_ready()
        assert room.client is not None
        room.detach(room.client)

    on_loop(study, ready_and_gone)
    again = study.hello("teacher", "P01")
    assert until_page(again, "wait")
    assert not (study.house.folder.trials_dir / "P01-1.jsonl").exists()
    send(operator, type="ready")
    assert until_page(again, "trial")


def test_an_operator_goes_from_one_teacher_to_the_next_and_is_ready_anew_for_each(study: Served) -> None:
    first, operator = begun(study, "P01")
    second = study.hello("teacher", "P02")
    send(second, type="answer", index=0, values={})
    assert until_page(second, "wait")
    send(operator, type="ready")  # said while P01's trial runs: it is not for P02's
    assert until_page(first, "form")
    seats = [receive(operator, "seat")]
    while (seats[-1]["participant"], seats[-1]["state"]) != ("P02", "ask"):
        seats.append(receive(operator, "seat"))
    assert {seat["participant"] for seat in seats[:-1]} == {"P01"}
    assert study.house.rooms["P02"].run is None
    send(operator, type="ready")
    assert until_page(second, "trial")


def test_an_operator_who_comes_back_controls_the_trial_that_runs(study: Served) -> None:
    _, operator = begun(study)
    receive(operator, "choices")
    operator.close()
    again = study.hello("operator", "O1")
    chosen(again, "light_on(2)")
    while receive(again, "frame")["state"] != "over":
        pass
    [trial] = read_trials(study.house.folder.trials_dir)
    kinds = [event["kind"] for event in trial.events]
    assert kinds.index("operator_away") < kinds.index("operator_back") < kinds.index("act")
    assert "light_on(2)" in {str(step.action) for step in trial.steps if step.action_source == "operator"}


def test_what_an_operator_said_before_a_reload_does_not_begin_a_trial(study: Served) -> None:
    teacher, operator = study.hello("teacher", "P01"), study.hello("operator", "O1")
    send(operator, type="ready")
    while receive(operator, "seat")["state"] != "wait":
        pass
    operator.close()
    again = study.hello("operator", "O1")
    assert receive(again, "seat")["state"] == "ask"
    send(teacher, type="answer", index=0, values={})
    assert until_page(teacher, "wait")
    assert study.house.rooms["P01"].run is None
    send(again, type="ready")
    assert until_page(teacher, "trial")


@pytest.mark.parametrize("when", ["count", "pause", "away"])
def test_an_abort_is_obeyed_before_the_first_step_in_a_pause_and_with_nobody_there(
    tmp_path: Path, when: str
) -> None:
    counted = msgspec.structs.replace(QUICK.timing, countdown=1 if when == "count" else 0, away=60)
    folder = StudyFolder.new(tmp_path / "study", msgspec.structs.replace(TWO, timing=counted))
    with served(folder) as study:
        teacher, _ = begun(study)
        admin = study.hello("admin")
        send(admin, type="watch", participant="P01")
        if when == "pause":
            send(admin, type="order", participant="P01", what="pause")
        if when == "away":
            teacher.close()
        while receive(admin, "frame")["state"] != when.replace("away", "pause"):
            pass
        send(admin, type="order", participant="P01", what="abort")
        while receive(admin, "frame")["state"] != "over":
            pass
        teacher = teacher if when != "away" else study.hello("teacher", "P01")
        assert until_page(teacher, "form")
    [trial] = read_trials(folder.trials_dir)
    assert trial.reason == "aborted"
    assert (trial.num_steps == 0) == (when == "count")
    assert validate(folder.trials_dir).ok


def test_an_error_in_a_beat_of_the_server_is_logged_and_the_next_one_comes(
    study: Served, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def wrong(self: House) -> None:
        raise RuntimeError("this should not be")

    for every in ("STATUS_EVERY", "PING_EVERY", "LOG_CLOCK_EVERY"):
        monkeypatch.setattr(house_module, every, 0.1)
    monkeypatch.setattr(House, "_log_clocks", wrong)
    teacher = study.hello("teacher", "P01")
    pings = 0
    while pings < 3:
        pings += b'"ping"' in str(teacher.recv(timeout=5)).encode()
    assert "the beat of the server" in caplog.messages


def test_connections_that_are_gone_leave_nothing_behind(study: Served) -> None:
    def clients() -> int:
        gc.collect()
        return sum(isinstance(thing, Client) for thing in gc.get_objects())

    roles: tuple[tuple[Role, str], ...] = (("teacher", "P01"), ("operator", "O1"), ("admin", ""))
    for _ in range(5):
        for role, name in roles:
            study.hello(role, name).close()
    for _ in range(3):
        study.connect().close()
    end = time.monotonic() + 5
    while clients() and time.monotonic() < end:
        time.sleep(0.1)
    assert clients() == 0
    assert (study.house.clients, study.house.admins) == (set(), set())


def test_idle_connections_leave_files_for_the_logs() -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (512, hard))
        _allow_files(700)
        assert resource.getrlimit(resource.RLIMIT_NOFILE)[0] == 700
        _allow_files(600)
        assert resource.getrlimit(resource.RLIMIT_NOFILE)[0] == 700
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def test_a_message_nested_without_end_is_refused_like_any_other(
    study: Served, caplog: pytest.LogCaptureFixture
) -> None:
    for client, reason in ((study.hello("teacher", "P01"), "not a message"), (study.connect(), "no hello")):
        client.send('{"a":' + "[" * 15000)
        assert closed(client) == (4003, reason)
    assert [record for record in caplog.records if record.levelno >= logging.ERROR] == []


def test_an_answer_to_a_ping_of_long_ago_is_let_pass_and_one_given_twice_is_not(study: Served) -> None:
    teacher = study.hello("teacher", "P01")
    client = study.house.rooms["P01"].client
    assert client is not None

    def pinged() -> None:
        for _ in range(12):
            client.link.ping()

    on_loop(study, pinged)
    last = client.link._count
    for n in (1, last):
        send(teacher, type="pong", n=n, at=1)
    assert receive(teacher, "page")["kind"] == "card"
    send(teacher, type="pong", n=last, at=1)
    assert closed(teacher) == (4003, "no such ping")


def test_a_session_that_cannot_be_read_is_said_where_the_server_starts(folder: StudyFolder) -> None:
    folder.session_of("P02").write_text('{"page":0,"name":"card-P02-1","values":{}}\n{"page":"x"}\n')
    with pytest.raises(StudyError, match=r"P02\.jsonl:2: is no line of a session"):
        House.of(folder)


def test_a_trial_does_not_go_on_under_another_clock_than_it_began(folder: StudyFolder) -> None:
    with served(folder) as study:
        teacher, _ = begun(study)
        receive(teacher, "frame")
    path = folder.trials_dir / "P01-1.jsonl"
    before = path.read_bytes()
    design = folder.path / "study.toml"
    design.write_text(design.read_text().replace("step = 0.05", "step = 0.1"))
    with served(StudyFolder(folder.path)) as study:
        teacher, operator = study.hello("teacher", "P01"), study.hello("operator", "O1")
        assert until_page(teacher, "wait")
        send(operator, type="ready")
        assert receive(teacher, "problem")["text"]
        assert "dt 0.05, which is 0.1 now" in study.house.rooms["P01"].trouble
    assert path.read_bytes() == before


def test_a_server_that_is_terminated_writes_what_waits(folder: StudyFolder) -> None:
    command = [sys.executable, "-m", "taskcomm.cli", "study", "serve", str(folder.path), "--port", "0"]
    environment = os.environ | {"PYTHONUNBUFFERED": "1"}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, text=True, env=environment, **pipes) as process:  # type: ignore[call-overload]
        assert "admin" in next(line for line in process.stdout if "admin" in line)
        process.send_signal(signal.SIGTERM)
        _, errors = process.communicate(timeout=20)
    assert process.returncode == 130
    assert "Traceback" not in errors
    assert b'"kind":"stop"' in folder.server_log.read_bytes()


def test_a_study_is_served_by_one_server_at_a_time(study: Served) -> None:
    with pytest.raises(StudyError, match="another server has this study open"):
        House.of(StudyFolder(study.house.folder.path))


def test_no_study_of_people_runs_without_a_clock(tmp_path: Path) -> None:
    folder = StudyFolder.new(tmp_path / "people", msgspec.structs.replace(QUICK, simulated=False))
    with pytest.raises(StudyError, match="lockstep is for simulated studies"):
        House.of(folder, lockstep=True)


def test_pages_may_come_from_every_name_of_a_server_that_is_open_to_others() -> None:
    assert origins_of("::1", 8000) == {f"http://{n}:8000" for n in ("127.0.0.1", "localhost", "[::1]")}
    assert origins_of("192.0.2.7", 80) == {"http://192.0.2.7", "http://192.0.2.7:80"}
    for host in ("0.0.0.0", "::"):
        assert origins_of("::1", 8000) < origins_of(host, 8000)
