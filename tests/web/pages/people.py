"""What people do at the pages: answer, read the card, press the spacebar, use the mouse."""

import re
import time
from collections.abc import Sequence
from typing import NamedTuple

from playwright.sync_api import Page, expect

from taskcomm.tasks import Task

PATIENCE = 60.0  # seconds


class Sight(NamedTuple):
    """What a teacher sees of the world."""

    lit: frozenset[int]
    held: int
    placed: dict[int, tuple[int, int]]
    final: bool


def seen(page: Page) -> Sight:
    """The world by its text alternative."""
    text = page.locator("svg.world").get_attribute("aria-label") or ""
    balls = {int(number): said for number, said in re.findall(r"Ball (\d): ([^.]*)\.", text)}
    at = {ball: re.search(r"at distance (\d) from ball (\d)", said) for ball, said in balls.items()}
    return Sight(
        frozenset(ball for ball, said in balls.items() if re.search(r"\blit\b", said)),
        next((ball for ball, said in balls.items() if "held by the robot" in said), 0),
        {ball: (int(found[2]), int(found[1])) for ball, found in at.items() if found},
        page.locator(".said", has_text="Final").count() > 0,
    )


def approves(sight: Sight, task: Task) -> bool:
    """Whether somebody with this card is pleased by what is seen."""
    if sight.placed.get(task.mov) == (task.wrt, task.dist):
        return True
    if sight.held == task.mov:
        return sight.lit == {task.wrt}
    return not sight.held and sight.lit == {task.mov}


def read_card(page: Page) -> Task:
    """The card on the page that asks to begin."""
    text = page.locator(".card .sentence").inner_text()
    found = re.fullmatch(r"Put ball (\d) at distance (\d) from ball (\d)\.", text)
    assert found is not None, text
    return Task(mov=int(found[1]), wrt=int(found[3]), dist=int(found[2]))


def answer_forms(page: Page, heading: str, age: str = "22") -> None:
    """The form under this heading: the middle of every scale, the first of all choices."""
    expect(page.get_by_role("heading", name=heading)).to_be_visible(timeout=1000 * PATIENCE)
    for box in page.locator(".field input").all():
        box.fill(age)
    for group in page.locator("fieldset").all():
        options = group.get_by_role("radio").all()
        options[len(options) // 2 if len(options) > 2 else 0].check()
    page.get_by_role("button", name="Continue").click()


def teach(page: Page, task: Task, pause: float) -> int:
    """Press when pleased, not within `pause` seconds, seldom twice for one thing, until Final; how often."""
    presses, last, pressed_for = 0, 0.0, None
    end = time.monotonic() + PATIENCE
    while not (sight := seen(page)).final:
        assert time.monotonic() < end, f"no Final; {sight}"
        new = approves(sight, task) and (sight != pressed_for or time.monotonic() > last + 4 * pause)
        if new and time.monotonic() > last + pause:
            page.keyboard.press("Space")
            presses, last, pressed_for = presses + 1, time.monotonic(), sight
        page.wait_for_timeout(30)
    return presses


def control(page: Page, moves: Sequence[tuple[str, str]]) -> None:
    """Clicks at these parts of the picture with these buttons, each when the robot has done the last."""
    for target, button in moves:
        node, told = page.locator(target), page.locator(".told")
        expect(node).to_have_class(re.compile("responds"))
        before = told.text_content() or ""
        node.click(button="right" if button == "right" else "left")
        expect(told).not_to_have_text(before)
