"""The server over real WebSockets: who may say what, who sees what, how a participant goes on."""

from collections.abc import Iterator
from contextlib import suppress
from http.client import HTTPConnection
from pathlib import Path

import msgspec
import pytest
from web.houses import Served, receive, send, served
from websockets import Origin
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from taskcomm.logs import read_trials, validate
from taskcomm.web.app import HEADERS
from taskcomm.web.protocol import FRAME_BYTES, LONGEST, Role
from taskcomm.web.study.folder import StudyFolder
from taskcomm.web.study.structure import HUMAN, Consent, Design, Operators, Timing

QUICK = Design(
    name="quick",
    teachers=3,
    simulated=True,
    operators=Operators(pool=("O1", "O2"), draw=2),
    conditions=(HUMAN,),
    questionnaire=(),
    instructions=False,
    consent=Consent(ask=False),
    timing=Timing(step=0.05, limit=2, countdown=0, grace=0.1, away=1),
)


@pytest.fixture
def study(tmp_path: Path) -> Iterator[Served]:
    with served(StudyFolder.new(tmp_path / "study", QUICK)) as running:
        yield running


def exhausted(client: ClientConnection) -> None:
    while True:
        client.recv(timeout=5)


def closed(client: ClientConnection) -> tuple[int, str]:
    """The code and reason with which the server closed."""
    with pytest.raises(ConnectionClosed) as ended:
        exhausted(client)
    said = ended.value.rcvd
    assert said is not None
    return said.code, said.reason


def begun(study: Served, person: str = "P01") -> tuple[ClientConnection, ClientConnection]:
    """Teacher and operator of a trial that runs."""
    operator_id = study.house.folder.participant(person).operator
    assert operator_id is not None
    teacher, operator = study.hello("teacher", person), study.hello("operator", operator_id)
    page = receive(teacher, "page")
    assert page["kind"] == "card"
    send(operator, type="ready")
    send(teacher, type="answer", index=page["index"], values={})
    while receive(teacher, "page")["kind"] != "trial":
        pass
    return teacher, operator


def chosen(operator: ClientConnection, action: str) -> None:
    """Choose an action as soon as it is valid."""
    choices = receive(operator, "choices")
    while choices["chosen"] != action:
        if action in choices["actions"] and not choices["chosen"]:
            send(operator, type="act", t=choices["t"], action=action)
        choices = receive(operator, "choices")


def test_every_answer_carries_the_strict_headers(study: Served) -> None:
    for path in ("/", "/main.js", "/nothing", "/../private/links.json", "/%2e%2e/study.toml", "//etc/passwd"):
        asked = HTTPConnection(study.address.removeprefix("http://"), timeout=5)
        asked.request("GET", path)
        answer = asked.getresponse()
        assert {name: answer.headers[name] for name in HEADERS} == HEADERS
        assert answer.status == (200 if path in ("/", "/main.js") else 404)
        assert "server" not in answer.headers
        content = answer.read().decode()
        asked.close()
        for token in (study.token("admin"), study.token("teacher", "P01")):
            assert token not in content


@pytest.mark.parametrize("origin", [None, "http://evil.example", "http://127.0.0.1", "null"])
def test_a_socket_of_another_origin_is_refused(study: Served, origin: str | None) -> None:
    with pytest.raises(InvalidStatus) as refused:
        connect(study.socket, origin=None if origin is None else Origin(origin)).__enter__()
    assert refused.value.response.status_code == 403


def test_there_are_no_more_connections_than_may_be(study: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("taskcomm.web.app.CONNECTIONS", 3)
    silent = [study.connect() for _ in range(3)]
    with pytest.raises(InvalidStatus):
        study.connect()
    for client in silent:
        client.close()
    assert receive(study.hello("teacher", "P01"), "page")["kind"] == "card"


@pytest.mark.parametrize(
    "first",
    [
        '{"type":"hello","token":"guess"}',
        '{"type":"press","n":1,"at":0}',
        "garbage",
        "[]",
        '{"type":"hello"}',
        '{"type":"hello","token":"guess","more":1}',
    ],
)
def test_without_a_hello_that_is_known_the_door_is_shut(study: Served, first: str) -> None:
    client = study.connect()
    client.send(first)
    assert closed(client)[0] == 4003


def test_each_role_may_say_its_own_things_alone(study: Served) -> None:
    said: dict[Role, dict[str, object]] = {
        "teacher": {"type": "press", "n": 1, "at": 0},
        "operator": {"type": "ready"},
        "admin": {"type": "watch", "participant": None},
        "annotator": {"type": "list"},
    }
    names: dict[Role, str] = {"teacher": "P03", "operator": "O2", "admin": "", "annotator": "annotator-1"}
    for role, name in names.items():
        for other, message in said.items():
            if other != role and not (role == "admin" and other == "annotator"):
                client = study.hello(role, name)
                send(client, **message)
                assert closed(client) == (4003, "not yours to send")


def test_what_is_too_long_or_too_fast_ends_the_connection(study: Served) -> None:
    client = study.hello("teacher", "P01")
    client.send("x" * (LONGEST + 1))
    assert closed(client)[0] == 1009
    client = study.hello("teacher", "P01")
    with suppress(ConnectionClosed):
        for number in range(500):
            send(client, type="focus", on=True, at=number)
    assert closed(client) == (4003, "too much")


def test_the_newest_page_of_a_participant_counts_and_the_old_one_says_so(study: Served) -> None:
    old = study.hello("teacher", "P01")
    new = study.hello("teacher", "P01")
    assert receive(old, "page")["kind"] == "card"
    assert receive(old, "page")["kind"] == "gone"
    assert closed(old) == (4000, "opened elsewhere")
    assert receive(new, "page")["kind"] == "card"


def test_a_trial_begins_when_the_teacher_has_read_and_the_operator_is_ready(study: Served) -> None:
    operator_id = study.house.folder.participant("P01").operator or ""
    operator = study.hello("operator", operator_id)
    assert receive(operator, "seat")["state"] == "idle"
    teacher = study.hello("teacher", "P01")
    assert receive(operator, "seat")["state"] == "ask"
    send(teacher, type="answer", index=receive(teacher, "page")["index"], values={})
    assert receive(teacher, "ack") == {"type": "ack", "what": "answer", "n": 0}
    assert receive(teacher, "page")["kind"] == "wait"
    send(operator, type="ready")
    assert receive(teacher, "page")["kind"] == "trial"
    assert receive(teacher, "frame")["t"] == 0
    while receive(operator, "seat")["state"] != "control":
        pass


def test_a_whole_trial_by_hand_ends_in_final_rating_and_a_log_that_validates(study: Served) -> None:
    teacher, operator = begun(study)
    script = ["light_on(2)", "light_off(2)", "pick_up(2)", "slide(2, 4, 1)", "final"]
    for presses, action in enumerate(script, 1):
        chosen(operator, action)
        send(teacher, type="press", n=presses, at=1.5)
    last = receive(teacher, "frame")
    while last["state"] != "over":
        last = receive(teacher, "frame")
    assert last["final"] == [2, 1, 4]
    rating = receive(teacher, "page")
    assert (rating["kind"], [item["item"] for item in rating["content"]["items"]]) == (
        "form",
        ["intelligence", "right"],
    )
    send(teacher, type="answer", index=rating["index"], values={"intelligence": 11, "right": "yes"})
    assert receive(teacher, "problem")["text"]
    send(teacher, type="answer", index=rating["index"], values={"intelligence": 9, "right": "yes"})
    assert receive(teacher, "page")["kind"] == "thanks"
    path = study.house.folder.trials_dir / "P01-1.jsonl"
    assert validate(path).ok
    [trial] = read_trials(path)
    assert (trial.reason, trial.source, trial.operator_id) == (
        "final",
        "simulated",
        study.house.folder.participant("P01").operator,
    )
    assert [(line["item"], line["value"]) for line in trial.ratings] == [
        ("intelligence", 9),
        ("right", "yes"),
    ]
    assert sum(event["kind"] == "press" for event in trial.events) == presses
    assert [str(step.action) for step in trial.steps if step.action_source == "operator"] == [
        "light_on(2)",
        "light_off(2)",
        "pick_up(2)",
        "slide(2, 4, 1)",
    ]


def test_an_action_that_is_not_valid_or_not_in_time_changes_nothing(study: Served) -> None:
    _, operator = begun(study)
    for action in ("slide(1, 4, 2)", "final", "light_on(9)", "import os"):
        send(operator, type="act", t=receive(operator, "choices")["t"], action=action)
    send(operator, type="act", t=receive(operator, "choices")["t"] + 20, action="noa")
    while receive(operator, "frame")["state"] != "over":
        pass
    [trial] = read_trials(study.house.folder.trials_dir)
    assert {(str(step.action), step.action_source) for step in trial.steps} == {("noa", "default")}
    acts = [event for event in trial.events if event["kind"] == "act"]
    assert [event["valid"] for event in acts] == [False] * 5


def test_a_press_that_is_sent_again_is_dropped_with_its_sender_and_counts_once(study: Served) -> None:
    teacher, _ = begun(study)
    send(teacher, type="press", n=1, at=1)
    assert receive(teacher, "ack") == {"type": "ack", "what": "press", "n": 1}
    send(teacher, type="press", n=1, at=1)
    assert closed(teacher) == (4003, "this press was sent before")
    text = (study.house.folder.trials_dir / "P01-1.jsonl").read_text()
    assert text.count('"kind":"press"') == 1


def test_what_is_acknowledged_is_on_disk(study: Served) -> None:
    teacher, _ = begun(study)
    path = study.house.folder.trials_dir / "P01-1.jsonl"
    for number in range(1, 11):
        send(teacher, type="press", n=number, at=number)
        assert receive(teacher, "ack")["n"] == number
        lines = [msgspec.json.decode(line) for line in path.read_bytes().splitlines()]
        assert [line["n"] for line in lines if line.get("kind") == "press"] == list(range(1, number + 1))


def test_frames_have_one_size_and_no_field_that_tells_who_controls_the_robot(study: Served) -> None:
    teacher, _ = begun(study)
    for _ in range(5):
        text = ""
        while '"type":"frame"' not in text:
            text = str(teacher.recv(timeout=5))
        assert len(text) == FRAME_BYTES
        assert set(msgspec.json.decode(text)) == {
            *("type", "t", "balls", "distances", "lit", "held", "placements", "slid", "final"),
            *("count", "state", "action"),
        }


def test_a_reload_in_mid_trial_goes_on_with_it(study: Served) -> None:
    teacher, _ = begun(study)
    before = receive(teacher, "frame")["t"]
    teacher.close()
    again = study.hello("teacher", "P01")
    assert receive(again, "page")["kind"] == "trial"
    assert receive(again, "frame")["t"] >= before
    send(again, type="press", n=1, at=0)
    assert receive(again, "ack")["what"] == "press"


def test_an_admin_watches_pauses_and_aborts_and_the_study_goes_on(study: Served) -> None:
    teacher, _ = begun(study)
    admin = study.hello("admin")
    send(admin, type="watch", participant="P01")
    assert receive(admin, "frame")["state"] == "run"
    send(admin, type="order", participant="P01", what="pause")
    while receive(admin, "frame")["state"] != "pause":
        pass
    send(admin, type="order", participant="P01", what="abort")
    while receive(teacher, "page")["kind"] != "form":
        pass
    [trial] = read_trials(study.house.folder.trials_dir)
    assert trial.reason == "aborted"
    send(admin, type="order", participant="P02", what="pause")
    assert "no trial" in receive(admin, "problem")["text"]


def test_a_study_goes_on_where_it_was_when_its_server_comes_back(tmp_path: Path) -> None:
    folder = StudyFolder.new(tmp_path / "study", QUICK)
    with served(folder) as study:
        teacher, _ = begun(study)
        send(teacher, type="press", n=1, at=1)
        receive(teacher, "ack")
        steps = receive(teacher, "frame")["t"]
    path = folder.trials_dir / "P01-1.jsonl"
    assert b"trial_end" not in path.read_bytes()
    path.write_bytes(path.read_bytes() + b'{"type":"step","torn')
    with served(StudyFolder(tmp_path / "study")) as study:
        operator_id = study.house.folder.participant("P01").operator or ""
        teacher, operator = study.hello("teacher", "P01"), study.hello("operator", operator_id)
        assert receive(teacher, "page")["kind"] == "wait"
        send(operator, type="ready")
        assert receive(teacher, "page")["kind"] == "trial"
        assert receive(teacher, "frame")["t"] >= steps - 1
        while receive(teacher, "frame")["state"] != "over":
            pass
    assert validate(path).ok
    [trial] = read_trials(path)
    assert trial.reason == "timeout"
    assert trial.num_steps == 40
    resumed = next(event for event in trial.events if event.get("type") == "resume")
    assert resumed["steps"] >= steps - 1
    assert b'"kind":"torn"' in folder.server_log.read_bytes()
