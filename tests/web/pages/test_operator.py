"""The operator's page: the mouse chooses among what is valid, and nothing else responds."""

from pathlib import Path

from playwright.sync_api import Browser, Page, expect
from web.pages.stage import Stage, frame, opened, picture, served
from web.pages.test_world import ball, showing

from taskcomm.tasks import Task
from taskcomm.web.frames import frame as framed
from taskcomm.web.protocol import Choices, Frame, Pressed, Seat
from taskcomm.world import Action, BallState, BallWorld

WORLD = BallWorld()
CONTROL = Seat(state="control", participant="P01")


def in_control(t: int, state: BallState) -> list[Frame | Choices]:
    """The frame of `state` and its choices, Final among them where a ball is placed."""
    final = ["final"] if any(state.placements) else []
    actions = [str(action) for action in WORLD.actions(state)] + final
    return [framed(WORLD, state, t), Choices(t=t, actions=actions, chosen="")]


def after(*actions: str) -> BallState:
    state = WORLD.start()
    for action in actions:
        state = WORLD.step(state, Action.parse(action))
    return state


def mark(page: Page, reference: int, distance: int) -> str:
    return f'.mark[data-reference="{reference}"][data-distance="{distance}"]'


def test_every_click_means_its_action(browser: Browser, tmp_path: Path) -> None:
    held = after("light_on(2)", "pick_up(1)")
    placed = after("light_on(2)", "pick_up(1)", "slide(1, 4, 2)")
    said = [CONTROL, *in_control(0, WORLD.start())]
    with served(Stage("operator", said)) as stage, opened(browser, stage) as page:
        stage.until_connected(1)
        expect(ball(page, 3)).to_have_class("ball responds")
        ball(page, 3).click(button="right")
        ball(page, 1).click()
        expect(page.locator(".next")).to_have_text("Next: pick up ball 1")
        expect(ball(page, 1)).to_have_class("ball responds chosen")
        stage.say(*in_control(1, held))
        expect(page.locator(".next")).to_have_text("Next: nothing")
        picture(page, tmp_path, "operator-held")
        ball(page, 2).click(button="right")
        page.locator(mark(page, 2, 4)).click()
        stage.say(*in_control(2, placed))
        expect(page.locator("svg.world")).to_have_attribute("data-t", "2")
        page.locator(mark(page, 2, 3)).click()
        picture(page, tmp_path, "operator-chosen")
        page.locator(mark(page, 3, 4)).click()
        page.locator(".robot").click()
        ball(page, 1).click()
        acts = [(act["t"], act["action"]) for act in stage.until("act", 8)]
        assert acts == [
            (0, "light_on(3)"),
            (0, "pick_up(1)"),
            (1, "light_off(2)"),
            (1, "slide(1, 4, 2)"),
            (2, "slide(1, 3, 2)"),
            (2, "slide(1, 4, 3)"),
            (2, "final"),
            (2, "release(1)"),
        ]


def test_what_is_not_valid_does_not_respond(browser: Browser) -> None:
    held = after("pick_up(1)")
    with (
        served(Stage("operator", [CONTROL, *in_control(0, held)])) as stage,
        opened(browser, stage) as page,
    ):
        stage.until_connected(1)
        showing(stage, page, framed(WORLD, held, 0))
        ball(page, 2).click()  # another is held
        page.locator(".robot").click()  # nothing is placed
        page.locator(mark(page, 2, 3)).click()  # two steps away
        page.locator(mark(page, 2, 4)).click(button="right")
        page.locator(".stage").click(position={"x": 20, "y": 500})
        for node in (page.locator(".robot"), page.locator(mark(page, 2, 3))):
            assert "responds" not in (node.get_attribute("class") or "")
            expect(node).not_to_have_css("cursor", "pointer")
        expect(page.locator(mark(page, 2, 4))).to_have_css("cursor", "pointer")
        page.wait_for_timeout(100)
        assert stage.of("act") == []


def test_the_world_looked_on_does_not_respond_and_shows_presses(browser: Browser) -> None:
    said = [Seat(state="watch", participant="P01"), frame(3, lit=[1])]
    with served(Stage("operator", said)) as stage, opened(browser, stage) as page:
        stage.until_connected(1)
        expect(ball(page, 1)).to_have_class("ball lit")
        ball(page, 1).click()
        ball(page, 1).click(button="right")
        stage.say(Pressed(t=3))
        expect(page.locator(".flash")).to_have_css("visibility", "visible")
        assert stage.of("act") == []
        expect(page.locator(".card")).to_have_count(0)


def test_ready_is_said_and_taken_back(browser: Browser, tmp_path: Path) -> None:
    with (
        served(Stage("operator", [Seat(state="ask", participant="P01")])) as stage,
        opened(browser, stage) as page,
    ):
        stage.until_connected(1)
        page.get_by_role("button", name="I am ready").click()
        assert stage.until("ready")[0]["on"] is True
        stage.say(Seat(state="wait", participant="P01"))
        picture(page, tmp_path, "operator-wait")
        page.get_by_role("button", name="Not ready after all").click()
        assert stage.until("ready", 2)[1]["on"] is False


def test_a_card_is_shown_only_where_the_study_says_so(browser: Browser) -> None:
    seat = Seat(state="control", participant="P01", card=list(Task(1, 2, 4)))
    with served(Stage("operator", [seat, frame(0)])) as stage, opened(browser, stage) as page:
        expect(page.locator(".card .sentence")).to_have_text("Ball 1 at distance 4 from ball 2")


def test_choices_of_a_step_that_is_over_do_not_respond(browser: Browser) -> None:
    with (
        served(Stage("operator", [CONTROL, *in_control(0, WORLD.start())])) as stage,
        opened(browser, stage) as page,
    ):
        stage.until_connected(1)
        expect(ball(page, 1)).to_have_class("ball responds")
        stage.say(frame(1))
        expect(ball(page, 1)).to_have_class("ball")
        ball(page, 1).click()
        page.wait_for_timeout(100)
        assert stage.of("act") == []
