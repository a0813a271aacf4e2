"""The picture of the world, and figure 1 of the paper, (a) to (f), as screenshots."""

from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Locator, Page, expect
from web.pages.stage import LAPTOP, LARGE, Stage, frame, opened, picture, served

from taskcomm.web.protocol import Frame
from taskcomm.web.protocol import Page as Shown

TASK = {"mov": 1, "wrt": 2, "dist": 4, "distances": 4, "title": "Your card"}
TRIAL = Shown(
    index=3, of=9, kind="trial", content={**TASK, "sentence": "Put ball 1 at distance 4 from ball 2."}
)
FIGURE: dict[str, Frame] = {
    "a-start": frame(-1, count=3, state="count", action=""),
    "b-lit": frame(1, lit=[1], action="light_on(1)"),
    "c-press": frame(2, lit=[1]),
    "d-held": frame(3, lit=[1], held=1, action="pick_up(1)"),
    "e-slid": frame(4, held=1, placements=[[1, 2, 4]], slid=[1, 2, 4], action="slide(1, 4, 2)"),
    "f-final": frame(5, held=1, placements=[[1, 2, 4]], final=[1, 2, 4], state="over", action="final"),
}
CROWD = [[1, 2, 3], [4, 1, 6], [6, 2, 1]]
SIX = frame(1, balls=6, distances=6, lit=[2, 5], held=3, placements=CROWD, action="light_on(2)")


def ball(page: Page, number: int) -> Locator:
    return page.locator(f'[data-ball="{number}"]')


def centre(node: Locator) -> tuple[float, float]:
    box = node.locator(".disc").bounding_box()
    assert box is not None
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def showing(stage: Stage, page: Page, shown: Frame) -> None:
    """Say the frame, and wait until it is drawn (balls do not glide in most tests)."""
    stage.say(shown)
    expect(page.locator("svg.world")).to_have_attribute("data-t", str(shown.t))


@pytest.mark.parametrize(
    "size", [LAPTOP, pytest.param(LARGE, marks=pytest.mark.verify)], ids=["laptop", "large"]
)
def test_figure_1_of_the_paper(browser: Browser, tmp_path: Path, size: dict[str, int]) -> None:
    with served(Stage("teacher", [TRIAL])) as stage, opened(browser, stage, size=size) as page:
        stage.until_connected(1)
        marks = page.locator(".mark")
        for name, shown in FIGURE.items():
            showing(stage, page, shown)
            if name == "c-press":
                page.keyboard.press("Space")
            expect(page.locator("svg.pressed")).to_have_count(1 if name == "c-press" else 0)
            picture(page, tmp_path, f"{name}-{size['width']}")
            expect(page.locator(".ball.lit")).to_have_count(len(shown.lit))
            expect(page.locator(".ball.held")).to_have_count(1 if shown.held else 0)
            expect(marks).to_have_count({"d-held": 8, "e-slid": 7, "f-final": 7}.get(name, 0))
            expect(page.locator(".robot .said")).to_have_text(
                {"a-start": ["3"], "f-final": ["Final"]}.get(name, [])
            )
        showing(stage, page, SIX)
        picture(page, tmp_path, f"six-balls-{size['width']}")
        assert marks.count() == 5 * 6


def test_everything_is_large_enough_to_read_on_a_laptop(browser: Browser) -> None:
    with served(Stage("teacher", [TRIAL])) as stage, opened(browser, stage) as page:
        stage.until_connected(1)
        for shown, disc, text in ((FIGURE["d-held"], 80, 20), (SIX, 40, 10)):
            showing(stage, page, shown)
            boxes = [one.bounding_box() for one in page.locator(".ball .disc").all()]
            assert min(box["width"] for box in boxes if box) > disc
            sizes: list[float] = page.eval_on_selector_all(
                ".mark text", "all => all.map(one => one.getBoundingClientRect().height)"
            )
            assert min(sizes) > text


def test_light_is_told_by_rays_and_hold_by_a_grip_not_by_colour_alone(browser: Browser) -> None:
    with served(Stage("teacher", [TRIAL])) as stage, opened(browser, stage) as page:
        stage.until_connected(1)
        showing(stage, page, FIGURE["d-held"])
        for part in (".beams", ".grip"):
            expect(ball(page, 1).locator(part)).to_have_css("visibility", "visible")
            expect(ball(page, 2).locator(part)).to_have_css("visibility", "hidden")


@pytest.mark.parametrize("motion", ["no-preference", "reduce"])
def test_a_ball_glides_unless_motion_is_not_wanted(browser: Browser, motion: Any) -> None:
    positions = """() => new Promise(done => {
      const disc = document.querySelector('[data-ball="1"]'), seen = new Set();
      const look = (left) => { seen.add(disc.getAttribute('transform'));
        left ? requestAnimationFrame(() => look(left - 1)) : done(seen.size); };
      look(40);
    })"""
    with (
        served(Stage("teacher", [TRIAL])) as stage,
        opened(browser, stage, reduced_motion=motion) as page,
    ):
        stage.until_connected(1)
        showing(stage, page, FIGURE["d-held"])
        page.evaluate(f"void (window.places = ({positions})())")
        start = centre(ball(page, 1))
        stage.say(FIGURE["e-slid"])
        places = page.evaluate("window.places")
        assert centre(ball(page, 1)) != start
        assert places == 2 if motion == "reduce" else places > 4


def test_what_the_robot_did_is_said_in_the_words_of_the_study(browser: Browser) -> None:
    texts = {"did_light_on": "Der Roboter beleuchtet Ball {ball}.", "state_lit": "beleuchtet"}
    with served(Stage("teacher", [TRIAL], texts)) as stage, opened(browser, stage) as page:
        stage.until_connected(1)
        told = page.locator(".told")
        expect(told).to_have_attribute("aria-live", "polite")
        stage.say(FIGURE["b-lit"])
        expect(told).to_have_text("Der Roboter beleuchtet Ball 1.")
        expect(page.locator("svg.world")).to_have_attribute(
            "aria-label",
            "Ball 1: beleuchtet, at its place. "
            "Ball 2: at its place. Ball 3: at its place. The robot holds no ball.",
        )
        stage.say(FIGURE["c-press"])
        stage.say(FIGURE["e-slid"])
        expect(told).to_have_text("The robot slides ball 1 to distance 4 from ball 2.")
        stage.say(FIGURE["f-final"])
        expect(told).to_have_text("The robot shows Final: ball 1 is at distance 4 from ball 2.")
