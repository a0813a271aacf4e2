"""What a teacher's, an operator's or a stranger's browser might send: the trial of others goes on."""

import asyncio
import json
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from web.loading import undecided
from web.rehearsing import OPERATOR, study
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.typing import Origin

from taskcomm.logs import read_trials, validate
from taskcomm.web.bots import Line, OperatorBot, TeacherBot
from taskcomm.web.protocol import LONGEST
from taskcomm.web.serverprocess import ServerProcess
from taskcomm.web.study.folder import StudyFolder
from taskcomm.web.study.structure import CERTAIN, Condition, Timing

REFUSED, TOO_BIG = 4003, 1009
ENDED = "hello was said"  # the reason of being dropped after everything before was borne


@dataclass
class Scene:
    """A trial of P01 in real time, and what others may use: their own tokens."""

    folder: StudyFolder
    server: ServerProcess
    victim: TeacherBot
    other: str
    other_operator: str

    def token(self, role: Any) -> str:
        """Of somebody who has nothing to do with the trial that runs."""
        names = {"teacher": self.other, "operator": self.other_operator, "annotator": "simulated"}
        return self.folder.tokens[role][names.get(role, "admin")]

    def attack(self, role: str | None, messages: Sequence[str | bytes]) -> tuple[int, str, list[Any]]:
        """Say hello with a role's token, then all this, then hello again: close code, reason, what came."""
        return asyncio.run(_attack(self.server.address, self.token(role) if role else None, messages))


async def _attack(
    address: str, token: str | None, messages: Sequence[str | bytes]
) -> tuple[int, str, list[Any]]:
    came: list[Any] = []
    url = address.replace("http", "ws") + "/ws"
    async with connect(url, origin=Origin(address), compression=None, proxy=None) as socket:
        try:
            for message in ([_hello(token)] if token else []) + list(messages) + [_hello("again")]:
                await socket.send(message)
            while True:
                came.append(json.loads(await asyncio.wait_for(socket.recv(), 8)))
        except ConnectionClosed:
            pass
    assert socket.close_code is not None
    return socket.close_code, socket.close_reason or "", came


def _hello(token: str) -> str:
    return json.dumps({"type": "hello", "token": token})


def said(kind: str, **fields: Any) -> str:
    """A message as a browser sends it."""
    return json.dumps({"type": kind} | fields)


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Scene]:
    endless = Condition(name="pomdp", controller="planner", horizon=2, threshold=CERTAIN)
    folder = study(
        tmp_path_factory.mktemp("abuse") / "study",
        2,
        conditions=(endless, OPERATOR),
        order="fixed",
        operators=2,
        timing=Timing(limit=600.0, countdown=0.0),
    )
    server = ServerProcess(folder.path, folder.path / "server.err", lockstep=False)
    server.start()
    first, second = folder.participants
    victim = TeacherBot(Line(server.address, folder.tokens["teacher"][first.id]), undecided(0.5), [1])
    operator = OperatorBot(Line(server.address, folder.tokens["operator"][str(first.operator)]), 0.5, [1])
    stop = _in_background(victim, operator)
    _until(lambda: bool(victim.lessons) and len(victim.lessons[0].moments) > 1, 10)
    yield Scene(folder, server, victim, second.id, str(second.operator))
    stop()
    server.kill()


def _in_background(victim: TeacherBot, operator: OperatorBot) -> Any:
    loop = asyncio.new_event_loop()
    both = [loop.create_task(victim.run()), loop.create_task(operator.run())]
    all_done = asyncio.gather(*both, return_exceptions=True)
    thread = threading.Thread(target=lambda: loop.run_until_complete(all_done), daemon=True)
    thread.start()

    def stop() -> None:
        for task in both:
            loop.call_soon_threadsafe(task.cancel)
        thread.join()
        loop.close()

    return stop


def _until(true: Any, seconds: float) -> None:
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, "it did not come about"
        time.sleep(0.02)


FEW = settings(max_examples=settings().max_examples // 3)
roles = st.sampled_from(["teacher", "operator", "annotator", "admin"])
numbers = st.integers(0, 10**6)
names = st.sampled_from(["P01", "P02", "P01-1", "P02-1", "../private/links", "a" * 200]) | st.text(
    max_size=20
)
values = st.none() | st.booleans() | st.integers(-(2**60), 2**60) | st.text(max_size=30)
fields: dict[str, dict[str, st.SearchStrategy[Any]]] = {
    "press": {"n": numbers, "at": numbers},
    "focus": {"on": st.booleans(), "at": numbers},
    "answer": {"index": st.integers(0, 9), "values": st.dictionaries(names.filter(bool), values, max_size=3)},
    "act": {"t": st.integers(0, 99), "action": st.sampled_from(["noa", "light_on(1)", "final", "fly"])},
    "ready": {"on": st.booleans()},
    "done": {"t": st.integers(-5, 99)},
    "watch": {"participant": st.none() | names.filter(bool)},
    "open": {"trial": names.filter(bool), "model": st.none() | names.filter(bool)},
    "label": {"trial": names.filter(bool), "press_seq": numbers, "mental_state": names.filter(bool)},
    "list": {},
    "pong": {"n": numbers, "at": numbers},
}
OWN = {
    "teacher": {"press", "focus", "answer", "done"},
    "operator": {"act", "ready", "done"},
    "annotator": {"open", "label", "list"},
    "admin": {"watch", "open", "list"},
}
messages = st.sampled_from(sorted(fields)).flatmap(
    lambda kind: st.fixed_dictionaries({"type": st.just(kind)} | fields[kind])
)


@FEW
@given(
    roles, st.text(max_size=200) | st.binary(max_size=200) | st.dictionaries(names, values).map(json.dumps)
)
def test_whoever_sends_what_is_no_message_is_dropped(scene: Scene, role: str, garbage: str | bytes) -> None:
    code, reason, _ = scene.attack(role, [garbage])
    assert (code, reason) == (REFUSED, "not a message")


@FEW
@given(roles, messages)
def test_whoever_sends_what_another_role_may_is_dropped(
    scene: Scene, role: str, message: dict[str, Any]
) -> None:
    if message["type"] in OWN[role]:
        return
    code, reason, _ = scene.attack(role, [json.dumps(message)])
    assert (code, reason) in ((REFUSED, "not yours to send"), (REFUSED, "no such ping"))


@FEW
@given(roles, st.lists(messages, max_size=12))
def test_messages_in_any_order_are_borne_or_refused(
    scene: Scene, role: str, many: list[dict[str, Any]]
) -> None:
    own = [json.dumps(message) for message in many if message["type"] in OWN[role]]
    code, reason, came = scene.attack(role, own)
    assert code == REFUSED
    assert reason in (ENDED, "this press was sent before", "not yours to control")
    for message in came:
        for token in (token for by_name in scene.folder.tokens.values() for token in by_name.values()):
            assert token not in json.dumps(message)


@FEW
@given(st.integers(LONGEST + 1, 4 * LONGEST), st.booleans())
def test_a_message_too_long_ends_the_line(scene: Scene, length: int, known: bool) -> None:
    code, _, _ = scene.attack("teacher" if known else None, ["x" * length])
    assert code in (TOO_BIG, REFUSED)


def test_a_flood_ends_the_line(scene: Scene) -> None:
    code, reason, _ = scene.attack("teacher", [said("focus", on=True, at=1)] * 300)
    assert (code, reason) == (REFUSED, "too much")


@FEW
@given(numbers, numbers)
def test_a_press_sent_again_or_out_of_order_is_refused(scene: Scene, first: int, second: int) -> None:
    low, high = sorted((first + 1, second + 1))
    code, reason, _ = scene.attack("teacher", [said("press", n=high, at=1), said("press", n=low, at=1)])
    assert (code, reason) == (REFUSED, "this press was sent before")


@FEW
@given(messages | st.text(max_size=40))
def test_without_a_token_of_this_study_nothing_is_said(scene: Scene, first: Any) -> None:
    text = first if isinstance(first, str) else json.dumps(first)
    code, reason, came = scene.attack(None, [text])
    assert (code, came) == (REFUSED, [])
    assert reason in ("no hello", "unknown link")


@FEW
@given(st.sampled_from(["http://elsewhere.example", "null", "http://127.0.0.1", "file://"]))
def test_pages_of_another_origin_get_no_line(scene: Scene, origin: str) -> None:
    async def knock() -> None:
        url = scene.server.address.replace("http", "ws") + "/ws"
        async with connect(url, origin=Origin(origin), proxy=None):
            pass

    with pytest.raises(InvalidStatus, match="403"):
        asyncio.run(knock())


@pytest.mark.parametrize("role", ["teacher", "operator", "annotator"])
def test_no_token_opens_the_view_of_another_role(scene: Scene, role: str) -> None:
    _, _, came = scene.attack(role, [])
    assert came[0]["role"] == role
    own = {
        "teacher": {"welcome", "page", "ping"},
        "operator": {"welcome", "seat", "ping"},
        "annotator": {"welcome", "ping"},
    }
    assert {message["type"] for message in came} <= own[role]


def onslaught(scene: Scene) -> None:
    """Something of everything above, whichever of it this process has run."""
    for role in ("teacher", "operator", "annotator", "admin"):
        scene.attack(role, ["garbage"])
        scene.attack(role, [said("press", n=1, at=1)])
        scene.attack(role, [said("list")] * 300)
        scene.attack(role, ["x" * 2 * LONGEST])
    scene.attack(None, ["garbage"])


def test_after_all_this_the_trial_of_others_has_missed_nothing(scene: Scene) -> None:
    onslaught(scene)
    lesson = scene.victim.lessons[0]
    lived = len(lesson.moments)
    _until(lambda: len(lesson.moments) > lived + 1, 3)
    assert scene.victim.line.connections == 1
    folder = scene.folder
    report = validate([folder.trials_dir])
    assert report.ok, report.problems[:3]
    [trial] = read_trials([folder.trials_dir])
    assert trial.trial_id == "P01-1"
    assert [m.pressed for m in lesson.moments[: trial.num_steps]] == list(trial.presses)
    assert bool(trial.recorded.all())
    assert max(float((step.timing or {})["late_ms"]) for step in trial.steps) < 250
    assert {step.action_source for step in trial.steps} == {"planner"}


def test_after_all_this_nothing_is_on_disk_that_should_not_be(scene: Scene) -> None:
    onslaught(scene)
    folder = scene.folder
    assert (folder.path / "server.err").read_text() == ""
    files = {str(file.relative_to(folder.path)) for file in folder.path.rglob("*") if file.is_file()}
    expected = {"study.toml", "participants.json", "private/links.json", "server.jsonl", "server.err"}
    expected |= {"texts/en.toml", "texts/de.toml", "trials/P01-1.jsonl", "sessions/P01.jsonl"}
    assert files <= expected | {"sessions/P02.jsonl"}
    for path in (folder.server_log, *folder.sessions_dir.glob("*.jsonl")):
        for line in path.read_bytes().splitlines():
            assert isinstance(msgspec.json.decode(line), dict)
    everything = b"".join(path.read_bytes() for path in folder.path.rglob("*.jsonl"))
    for by_name in folder.tokens.values():
        for token in by_name.values():
            assert token.encode() not in everything
