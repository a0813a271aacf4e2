"""Admin and annotator at a study that is served: they see, order and label what is on disk."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect
from web.houses import Served, receive, send, served
from websockets.sync.client import ClientConnection

from taskcomm.logs import read_trials, validate, write_trials
from taskcomm.verification import verify
from taskcomm.web.study.folder import StudyFolder
from taskcomm.web.study.structure import HUMAN, Consent, Design, Operators, Timing

STUDY = Path(__file__).parents[2] / "datasets" / "simulated-study" / "trials.jsonl"
DESIGN = Design(
    name="looked-at",
    teachers=1,
    simulated=True,
    operators=Operators(pool=("O1",), draw=1),
    conditions=(HUMAN,),
    questionnaire=(),
    ratings=(),
    instructions=False,
    consent=Consent(ask=False),
    timing=Timing(step=0.1, limit=60, countdown=0, grace=0.1, away=1),
)


@pytest.fixture
def study(tmp_path: Path) -> Iterator[Served]:
    with served(StudyFolder.new(tmp_path / "study", DESIGN)) as running:
        yield running


def begun(study: Served) -> tuple[ClientConnection, ClientConnection]:
    """Teacher and operator of a trial that runs."""
    teacher, operator = study.hello("teacher", "P01"), study.hello("operator", "O1")
    page = receive(teacher, "page")
    send(operator, type="ready")
    send(teacher, type="answer", index=page["index"], values={})
    while receive(teacher, "frame")["state"] != "run":
        pass
    return teacher, operator


def at(browser: Browser, link: str) -> Page:
    page = browser.new_page()
    page.goto(link)
    return page


def test_a_trial_is_watched_paused_and_aborted_then_labelled_and_replayed(
    study: Served, browser: Browser
) -> None:
    teacher, _ = begun(study)
    send(teacher, type="press", n=1, at=0)
    receive(teacher, "ack")
    admin = at(browser, study.link("admin"))
    row = admin.locator(".people tbody tr")
    expect(row).to_contain_text("running")
    row.get_by_role("button", name="Watch").click()
    expect(admin.locator(".live .world")).to_be_visible()
    expect(admin.locator(".live .now")).to_contain_text("running")
    row.get_by_role("button", name="Pause").click()
    expect(row).to_contain_text("paused")
    row.get_by_role("button", name="Go on").click()
    expect(row).to_contain_text("running")
    row.get_by_role("button", name="Abort").click()
    admin.get_by_role("dialog").get_by_role("button", name="Abort the trial").click()
    while receive(teacher, "page")["kind"] == "trial":
        pass

    annotator = at(browser, study.link("annotator", "annotator-1"))
    annotator.get_by_role("button", name="P01-1").click()
    expect(annotator.locator(".labelling")).to_be_visible()
    annotator.keyboard.press("n")
    annotator.keyboard.press("2")
    expect(annotator.locator(".labelling .saved")).to_have_text("saved")
    (trial,) = read_trials(study.house.folder.trials_dir)
    assert trial.reason == "aborted"
    assert list(trial.reasons.values()) == ["that_mov"]
    report = validate(study.house.folder.trials_dir)
    assert report.ok
    assert not report.notices
    assert verify(trial).same

    row.get_by_role("button", name="Replays").click()
    admin.get_by_role("button", name="P01-1").click()
    expect(admin.locator(".reasons tbody tr")).to_contain_text("annotator-1: That Mov")
    expect(admin.locator(".charts")).to_be_visible()
    admin.context.close()
    annotator.context.close()


def test_a_trial_that_runs_takes_no_label(study: Served) -> None:
    teacher, _ = begun(study)
    annotator = study.hello("annotator", "annotator-1")
    send(annotator, type="list")
    assert receive(annotator, "trials")["trials"] == []
    send(teacher, type="press", n=1, at=0)
    receive(teacher, "ack")
    for message in ({"type": "open"}, {"type": "label", "press_seq": 1, "mental_state": "mistake"}):
        send(annotator, trial="P01-1", **message)
        assert "not over" in receive(annotator, "problem")["text"]
    assert receive(teacher, "frame")["state"] == "run"


def test_a_label_torn_by_a_crash_is_mended_and_given_again(tmp_path: Path) -> None:
    folder = StudyFolder.new(tmp_path / "study", DESIGN)
    chosen = [trial for trial in read_trials(STUDY) if trial.trial_id == "study-002-2"]
    path = folder.trials_dir / "study-002-2.jsonl"
    path.parent.mkdir(exist_ok=True)
    write_trials(chosen, path)
    press = chosen[0].step_seqs[int(chosen[0].presses.argmax())]
    with path.open("ab") as file:
        file.write(b'{"type":"label","trial_id":"study-0')
    with served(folder) as study:
        annotator = study.hello("annotator", "annotator-1")
        send(annotator, type="label", trial="study-002-2", press_seq=press, mental_state="mistake")
        assert receive(annotator, "ack", "problem")["type"] == "ack"
    assert '"kind":"torn","file":"study-002-2.jsonl","bytes":35' in folder.server_log.read_text()
    assert validate(folder.trials_dir).ok
    (trial,) = read_trials(folder.trials_dir)
    assert len(trial.labels) == 1
