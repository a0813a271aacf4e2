"""The admin's page: who is where, a look at a running trial, and orders that cannot slip."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser, Locator, Page, expect
from web.pages.stage import Stage, frame, opened, picture, served

from taskcomm.web.protocol import Pressed, Problem, Status

SERVER = {"trials": 1, "clients": 4, "late_ms": 1.234, "missed": 0, "simulated": False}


def person(name: str, **changed: Any) -> dict[str, Any]:
    """A line of the status; of somebody whose trial runs, unless it is changed."""
    where = {
        "participant": name,
        "page": 4,
        "of": 13,
        "kind": "trial",
        "trial": f"{name}-1",
        "operator": "O1",
    }
    how = {"condition": "pomdp", "connected": True, "state": "run", "t": 31, "lost": 0, "defaults": 2}
    plain = {**where, **how, "late_ms": 0.41, "rtt_ms": 23.4}
    return plain | changed


WAITING = {
    "t": None,
    "state": "",
    "late_ms": None,
    "trial": None,
    "condition": None,
    "kind": "consent",
    "page": 0,
}
STATUS = Status(
    participants=[
        person("P01"),
        person("P02", state="pause", connected=False, lost=4, rtt_ms=None, late_ms=61.0),
        person("P03", **WAITING, connected=False, rtt_ms=None),
    ],
    server=SERVER,
)


@contextmanager
def administered(browser: Browser) -> Iterator[tuple[Stage, Page]]:
    with served(Stage("admin", [STATUS])) as stage, opened(browser, stage) as page:
        expect(page.locator(".people tbody tr")).to_have_count(3)
        yield stage, page


def row(page: Page, name: str) -> Locator:
    return page.locator(".people tbody tr").filter(has=page.get_by_role("rowheader", name=name))


def test_the_table_says_who_is_where_and_what_was_lost(browser: Browser, tmp_path: Path) -> None:
    with administered(browser) as (stage, page):
        said = row(page, "P01").locator("td").all_inner_texts()[:11]
        texts = [
            "yes",
            "5 of 13: trial",
            "P01-1",
            "pomdp",
            "O1",
            "running",
            "31",
            "0.4 ms",
            "23 ms",
            "0",
            "2",
        ]
        assert said == texts
        assert row(page, "P01").locator(".odd").count() == 0
        expect(row(page, "P02").locator(".odd")).to_have_text(["no", "61 ms", "4"])
        expect(row(page, "P03").get_by_role("button", name="Watch")).to_be_disabled()
        expect(page.locator(".server")).to_have_text(
            "1 trial runs · 4 pages connected · latest tick 1.2 ms late · 0 steps missed"
        )
        picture(page, tmp_path, "admin")
        row(page, "P01").get_by_role("button", name="Pause").focus()
        stage.say(Status(participants=[person("P01", t=32)], server=SERVER | {"simulated": True}))
        expect(row(page, "P01").locator("td").nth(6)).to_have_text("32")
        expect(row(page, "P01").get_by_role("button", name="Pause")).to_be_focused()
        expect(page.locator("h1 .badge")).to_have_text("simulated")


def test_a_trial_is_watched_as_it_runs_also_after_a_break(browser: Browser, tmp_path: Path) -> None:
    with administered(browser) as (stage, page):
        row(page, "P01").get_by_role("button", name="Watch").click()
        assert stage.until("watch") == [{"type": "watch", "participant": "P01"}]
        stage.say(frame(31, lit=[2], action="light_on(2)"), Pressed(t=31), STATUS)
        live = page.locator(".live")
        expect(live.locator(".now")).to_have_text("Step 31, running. The robot lights ball 2.")
        expect(live.locator(".facts")).to_contain_text("1 press seen here")
        expect(live.locator('[data-ball="2"]')).to_have_class("ball lit")
        live.scroll_into_view_if_needed()
        picture(page, tmp_path, "watching")
        stage.drop()
        stage.until_connected(2)
        assert stage.until("watch", 2)[1] == {"type": "watch", "participant": "P01"}
        page.get_by_role("button", name="Stop watching").click()
        assert stage.until("watch", 3)[2] == {"type": "watch", "participant": None}
        expect(live).to_be_hidden()


def test_pause_and_go_on_are_one_click_and_abort_is_asked_twice(browser: Browser, tmp_path: Path) -> None:
    with administered(browser) as (stage, page):
        row(page, "P01").get_by_role("button", name="Pause").click()
        row(page, "P02").get_by_role("button", name="Go on").click()
        orders = [(one["participant"], one["what"]) for one in stage.until("order", 2)]
        assert orders == [("P01", "pause"), ("P02", "go_on")]
        row(page, "P02").get_by_role("button", name="Abort").click()
        dialog = page.get_by_role("dialog")
        expect(dialog).to_contain_text("Abort the running trial of P02?")
        expect(dialog.get_by_role("button", name="Leave it running")).to_be_focused()
        picture(page, tmp_path, "abort")
        page.keyboard.press("Escape")
        row(page, "P02").get_by_role("button", name="Abort").click()
        dialog.get_by_role("button", name="Leave it running").click()
        assert len(stage.of("order")) == 2
        row(page, "P02").get_by_role("button", name="Abort").click()
        dialog.get_by_role("button", name="Abort the trial").click()
        assert stage.until("order", 3)[2] == {"type": "order", "participant": "P02", "what": "abort"}
        stage.say(Problem(text="no trial is running there"))
        expect(page.get_by_role("alert").filter(visible=True)).to_have_text("no trial is running there")


def test_the_replays_of_a_participant_are_a_click_away(browser: Browser) -> None:
    with administered(browser) as (stage, page):
        row(page, "P03").get_by_role("button", name="Replays").click()
        expect(page.get_by_label("Show those with")).to_have_value("P03")
        stage.until("list")
        page.get_by_role("button", name="Participants").click()
        expect(row(page, "P01")).to_be_visible()
