"""The teacher's trial: the spacebar is the only control, and nothing takes it away."""

import time

import pytest
from playwright.sync_api import Browser, Page, expect
from web.pages.stage import Stage, frame, opened, served
from web.pages.test_world import FIGURE, TRIAL, showing

from taskcomm.web.protocol import Page as Shown
from taskcomm.web.protocol import Ping

RATING = Shown(index=4, of=9, kind="text", content={"title": "Rating", "body": ["How was it?"]})
CARD = Shown(index=2, of=9, kind="card", content={**TRIAL.content, "button": "Begin"})
FLASH = 500


def flash(page: Page) -> str:
    visibility: str = page.eval_on_selector(".flash", "one => getComputedStyle(one).visibility")
    return visibility


def running(stage: Stage, page: Page) -> None:
    stage.until_connected(1)
    stage.say(frame(0))
    expect(page.locator(".banner")).to_have_text("")
    expect(page.locator(".ball")).to_have_count(3)


def test_a_held_key_is_one_press_and_the_next_is_another(browser: Browser) -> None:
    with served(Stage("teacher", [TRIAL])) as stage, opened(browser, stage) as page:
        running(stage, page)
        for _ in range(5):
            page.keyboard.down("Space")  # the second to fifth repeat
        page.keyboard.up("Space")
        page.keyboard.press("Space")
        page.keyboard.press("Enter")
        page.keyboard.press("a")
        sent = stage.until("press", 2)
        page.wait_for_timeout(100)
        assert [press["n"] for press in stage.of("press")] == [1, 2]
        assert [abs(press["at"] - 1000 * time.time()) < 10_000 for press in sent] == [True, True]
        assert sent[0]["at"] < sent[1]["at"]


def test_a_press_is_drawn_at_once_for_half_a_second(browser: Browser) -> None:
    with served(Stage("teacher", [TRIAL])) as stage, opened(browser, stage) as page:
        running(stage, page)
        assert flash(page) == "hidden"
        shown: float = page.evaluate("""() => new Promise(done => {
          const rect = document.querySelector('.flash'), seen = () => getComputedStyle(rect).visibility;
          window.dispatchEvent(new KeyboardEvent('keydown', {code: 'Space', key: ' '}));
          if (seen() !== 'visible') done(-1);
          const start = performance.now();
          const look = () => seen() === 'visible' ? setTimeout(look, 5) : done(performance.now() - start);
          look();
        })""")
        assert FLASH - 30 < shown < FLASH + 150


def test_a_press_is_drawn_before_anything_is_answered_and_not_while_the_clock_stands(
    browser: Browser,
) -> None:
    with served(Stage("teacher", [TRIAL])) as stage, opened(browser, stage) as page:
        running(stage, page)
        stage.say(frame(1, state="pause"))
        expect(page.locator(".banner")).to_have_text("Paused. Please wait; it goes on by itself.")
        page.keyboard.press("Space")
        stage.until("press", 1)
        assert flash(page) == "hidden"


def test_nothing_but_the_trial_takes_the_focus_and_nothing_scrolls(browser: Browser) -> None:
    with served(Stage("teacher", [CARD])) as stage, opened(browser, stage) as page:
        page.get_by_role("button", name="Begin").click()
        stage.until("answer")
        stage.say(TRIAL, frame(0))
        expect(page.locator("section.trial")).to_be_focused()
        assert page.locator("button, input, a[href], select, textarea").count() == 0
        for key in ("Tab", "Tab", "Shift+Tab", "PageDown", "ArrowDown", "End", "/", "'"):
            page.keyboard.press(key)
        page.mouse.click(700, 400)
        page.keyboard.press("Space")
        assert stage.until("press")[0]["n"] == 1
        assert page.evaluate("[scrollX, scrollY, document.hasFocus()]") == [0, 0, True]
        expect(page.locator(".card .sentence")).to_have_text("Put ball 1 at distance 4 from ball 2.")


def test_the_key_that_began_the_trial_is_no_press_while_it_is_held(browser: Browser) -> None:
    with served(Stage("teacher", [CARD])) as stage, opened(browser, stage) as page:
        page.get_by_role("button", name="Begin").focus()
        page.keyboard.down("Enter")
        stage.until("answer")
        page.keyboard.down("Space")
        stage.say(TRIAL, frame(0))
        expect(page.locator("section.trial")).to_be_visible()
        page.keyboard.down("Space")
        page.keyboard.up("Space")
        page.keyboard.press("Space")
        assert [press["n"] for press in stage.until("press")] == [1]


def test_the_keyboard_lost_and_back_is_told(browser: Browser) -> None:
    with served(Stage("teacher", [TRIAL])) as stage, opened(browser, stage) as page:
        running(stage, page)
        page.evaluate("window.dispatchEvent(new Event('blur'))")
        assert stage.until("focus")[0]["on"] is False
        expect(page.locator(".banner")).to_have_text(
            "The keyboard is elsewhere. Click anywhere on this page."
        )
        page.evaluate("window.dispatchEvent(new Event('focus'))")
        assert stage.until("focus", 2)[1]["on"] is True
        expect(page.locator(".banner")).to_have_text("")


def test_presses_during_a_lost_connection_are_never_sent(browser: Browser) -> None:
    with served(Stage("teacher", [TRIAL, frame(7)])) as stage, opened(browser, stage) as page:
        running(stage, page)
        page.keyboard.press("Space")
        stage.until("press", 1)
        expect(page.locator("svg.pressed")).to_have_count(0)
        page.context.set_offline(True)
        stage.drop()
        expect(page.locator(".banner")).to_contain_text("Connection lost")
        page.keyboard.press("Space")
        assert flash(page) == "hidden"
        page.context.set_offline(False)
        stage.until_connected(2)
        expect(page.locator(".banner")).to_have_text("")
        page.keyboard.press("Space")
        sent = stage.until("press", 2)
        page.wait_for_timeout(200)
        assert [press["n"] for press in stage.of("press")] == [1, 2]
        assert sent[1]["at"] > sent[0]["at"]
        assert len(stage.of("hello")) == 2


def test_a_ping_is_answered_by_the_same_number(browser: Browser) -> None:
    with served(Stage("teacher", [Ping(n=41)])) as stage, opened(browser, stage):
        assert stage.until("pong")[0]["n"] == 41


@pytest.mark.verify
def test_a_connection_over_which_nothing_comes_is_given_up(browser: Browser) -> None:
    with served(Stage("teacher", [TRIAL, frame(7)])) as stage, opened(browser, stage) as page:
        stage.until_connected(1)
        page.wait_for_timeout(6000)  # a server that never pinged may be silent
        assert stage.connections == 1
        stage.say(Ping(n=1))
        stage.until_connected(2)
        expect(page.locator(".banner")).to_have_text("")


def test_final_stays_in_view_before_the_next_page(browser: Browser) -> None:
    with served(Stage("teacher", [TRIAL])) as stage, opened(browser, stage) as page:
        running(stage, page)
        stage.say(FIGURE["f-final"], RATING)
        page.wait_for_timeout(1500)
        expect(page.locator(".said")).to_have_text("Final")
        expect(page.get_by_role("heading", name="Rating")).to_be_visible(timeout=3000)
        page.keyboard.press("Space")
        page.wait_for_timeout(100)
        assert stage.of("press") == []


def test_a_replaced_tab_says_so_and_stays_away(browser: Browser) -> None:
    with served(Stage("teacher", [TRIAL])) as stage, opened(browser, stage) as page:
        running(stage, page)
        stage.say(Shown(index=3, of=9, kind="gone"))
        stage.drop(4000)
        expect(page.get_by_text("opened in another window")).to_be_visible()
        page.keyboard.press("Space")
        page.wait_for_timeout(800)
        assert (stage.connections, stage.of("press")) == (1, [])


def test_a_frame_draws_the_same_whoever_acts(browser: Browser) -> None:
    """The page reads nothing but the frame: what is not part of it changes nothing that is drawn."""
    pictures = []
    for extra in ({}, {"controller": "operator", "condition": "wizard"}):
        shown = Shown(index=3, of=9, kind="trial", content={**TRIAL.content, **extra})
        with served(Stage("teacher", [shown])) as stage, opened(browser, stage) as page:
            running(stage, page)
            showing(stage, page, FIGURE["d-held"])
            pictures.append(page.locator("#root").inner_html())
    assert pictures[0] == pictures[1]
