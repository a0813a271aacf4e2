"""The picture of the world, and figure 1 of the paper, (a) to (f), as screenshots."""

from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect
from web.pages.stage import LAPTOP, LARGE, Stage, frame, opened, picture, served

from taskcomm.web.protocol import Frame
from taskcomm.web.protocol import Page as Shown

TASK = {"mov": 1, "wrt": 2, "dist": 4, "distances": 4, "title": "Your card"}
TRIAL = Shown(index=3, of=9, kind="trial", content={**TASK, "sentence": "Put ball 1 at distance 4 from ball 2."})
FIGURE: dict[str, Frame] = {
    "a-start": frame(-1, count=3, state="count", action=""),
    "b-lit": frame(1, lit=[1], action="light_on(1)"),
    "c-press": frame(2, lit=[1]),
    "d-held": frame(3, lit=[1], held=1, action="pick_up(1)"),
    "e-slid": frame(4, held=1, placements=[[1, 2, 4]], slid=[1, 2, 4], action="slide(1, 4, 2)"),
    "f-final": frame(5, held=1, placements=[[1, 2, 4]], final=[1, 2, 4], state="over", action="final"),
}


@pytest.mark.parametrize("size", [LAPTOP, LARGE], ids=["laptop", "large"])
def test_figure_1_of_the_paper(browser: Browser, tmp_path: Path, size: dict[str, int]) -> None:
    with served(Stage("teacher", [TRIAL])) as stage, opened(browser, stage, size=size) as page:
        expect(page.locator("section.trial")).to_be_visible()
        for name, shown in FIGURE.items():
            stage.say(shown)
            page.wait_for_timeout(450)
            if name == "c-press":
                page.keyboard.press("Space")
            picture(page, tmp_path, f"{name}-{size['width']}")
