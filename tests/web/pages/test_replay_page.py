"""Replays in the browser: what an admin and an annotator see of a logged trial, and do with it."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import pytest
from playwright.sync_api import Browser, Locator, Page, expect
from web.pages.stage import LAPTOP, LARGE, Stage, opened, picture, served

from taskcomm.logs import read_trials, write_trials
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial
from taskcomm.web import replaying
from taskcomm.web.client import REPLACED
from taskcomm.web.protocol import Acknowledged, Problem, Replay, Status

STUDY = Path(__file__).parents[3] / "datasets" / "simulated-study" / "trials.jsonl"
NAME = "study-010-1"


@pytest.fixture(scope="module")
def trial() -> Trial:
    return next(trial for trial in read_trials(STUDY) if trial.trial_id == NAME)


@pytest.fixture(scope="module")
def folder(trial: Trial, tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """One trial, two models."""
    path = tmp_path_factory.mktemp("study")
    made = SimpleNamespace(trials_dir=path / "trials", models_dir=path / "models")
    made.trials_dir.mkdir()
    made.models_dir.mkdir()
    write_trials([trial], made.trials_dir / f"{NAME}.jsonl")
    TeacherModel.intuitive().save(made.models_dir / "learned.json")
    return made


@contextmanager
def annotating(browser: Browser, folder: SimpleNamespace) -> Iterator[tuple[Stage, Page, Replay]]:
    """The annotator's page with the trial open."""
    replay = replaying.opened(folder, NAME, annotator="P01")
    with (
        served(Stage("annotator", [replaying.trials(folder, "P01")])) as stage,
        opened(browser, stage) as page,
    ):
        page.get_by_role("button", name=NAME).click()
        assert stage.until("open") == [{"type": "open", "trial": NAME, "model": None}]
        stage.say(replay)
        expect(line(page)).to_be_visible()
        yield stage, page, replay


@contextmanager
def looking(browser: Browser, folder: SimpleNamespace) -> Iterator[tuple[Stage, Page, Replay]]:
    """The admin's page with the trial open."""
    replay = replaying.opened(folder, NAME)
    says = [Status(participants=[], server=SERVER), replaying.trials(folder)]
    with served(Stage("admin", says)) as stage, opened(browser, stage) as page:
        page.get_by_role("button", name="Trials", exact=True).click()
        page.get_by_role("button", name=NAME).click()
        stage.until("open")
        stage.say(replay)
        expect(line(page)).to_be_visible()
        yield stage, page, replay


SERVER = {"trials": 0, "clients": 1, "late_ms": 0.0, "missed": 0, "simulated": True}


def line(page: Page) -> Locator:
    """What is said of the present state."""
    return page.locator("p.now:visible")


def slider(page: Page) -> Locator:
    return page.get_by_role("slider", name="Time")


def test_the_time_bar_goes_through_the_trial_by_key_and_mouse(
    browser: Browser, folder: SimpleNamespace, trial: Trial, tmp_path: Path
) -> None:
    with looking(browser, folder) as (_, page, replay):
        expect(page.locator("h1 .badge:visible")).to_have_text(["simulated", "simulated"])
        expect(line(page)).to_contain_text("Before the first step.")
        page.keyboard.press("End")
        final = trial.displayed
        assert final is not None
        expect(line(page)).to_contain_text(f"Final: ball {final.mov} is at distance {final.dist}")
        expect(line(page)).to_contain_text(f"{trial.duration:.1f} s.")
        page.keyboard.press("Home")
        page.keyboard.press("ArrowRight")
        expect(line(page)).to_contain_text("0.5 s. The robot lights ball")
        page.keyboard.press("n")
        first = replay.presses[0]["t"]
        expect(line(page)).to_contain_text(f"{(first + 1) * trial.dt:.1f} s.")
        expect(line(page)).to_contain_text("The teacher presses.")
        assert slider(page).input_value() == str(first + 1)
        assert "The teacher presses." in (slider(page).get_attribute("aria-valuetext") or "")
        slider(page).fill("40")
        expect(line(page)).to_contain_text("20.0 s.")
        page.get_by_role("button", name="The press before (p)").click()
        expect(line(page)).to_contain_text("18.5 s.")
        charts = page.locator(".charts")
        box = charts.bounding_box()
        assert box is not None
        charts.click(position={"x": box["width"] * 0.5, "y": box["height"] * 0.5})
        assert 40 < int(slider(page).input_value()) < 60
        picture(page, tmp_path, "replay")
        page.set_viewport_size(LARGE)  # type: ignore[arg-type]
        picture(page, tmp_path, "replay-large")


def test_a_replay_plays_at_the_speed_chosen_to_its_end(browser: Browser, folder: SimpleNamespace) -> None:
    with looking(browser, folder) as (_, page, replay):
        page.get_by_label("Speed").select_option("8")
        slider(page).fill(str(len(replay.frames) - 4))
        page.get_by_role("button", name="Play (space)").click()
        expect(page.get_by_role("button", name="Pause (space)")).to_be_visible()
        expect(line(page)).to_contain_text("shows Final")
        expect(page.get_by_role("button", name="Play (space)")).to_be_visible()
        page.keyboard.press("p")
        before = int(slider(page).input_value())
        page.keyboard.press("b")
        expect(page.get_by_role("button", name="Pause (space)")).to_be_visible()
        assert int(slider(page).input_value()) < before
        expect(page.get_by_role("button", name="Play (space)")).to_be_visible()
        assert int(slider(page).input_value()) == before


def test_the_cursor_stands_at_the_belief_that_is_told(browser: Browser, folder: SimpleNamespace) -> None:
    with looking(browser, folder) as (_, page, replay):
        assert replay.belief is not None
        for at in (0, 17, 102):
            slider(page).fill(str(at))
            expect(line(page)).to_contain_text(f"entropy {replay.belief['entropy'][at]:.2f} nats")
            mov, wrt, dist = replay.belief["likeliest"][at]
            expect(line(page)).to_contain_text(f"Likeliest: ball {mov} at distance {dist} from ball {wrt}")
        cursor = page.locator(".charts .cursor line").bounding_box()
        last = page.locator(".charts .presses line").last.bounding_box()
        assert cursor is not None
        assert last is not None
        assert abs(cursor["x"] - last["x"]) < 2  # the last press falls in the last step


def test_a_moment_looks_the_same_whichever_way_it_is_come_to(
    browser: Browser, folder: SimpleNamespace
) -> None:
    with looking(browser, folder) as (_, page, replay):
        drawn = page.locator(".view .world .ball, .view .world .marks, .view .world .links")
        look = "nodes => nodes.map((n) => n.matches('.ball') ? n.getAttribute('transform') : n.outerHTML)"
        walked = []
        for _step in range(60):
            page.keyboard.press("ArrowRight")
            walked.append(drawn.evaluate_all(look))
        for at in (60, 3, 41, 40, 12, 55):
            slider(page).fill(str(len(replay.frames) - 1))
            slider(page).fill(str(at))
            now = drawn.evaluate_all(look)
            assert now == walked[at - 1]


def test_reasons_of_presses_are_those_of_the_model_chosen(browser: Browser, folder: SimpleNamespace) -> None:
    with looking(browser, folder) as (stage, page, replay):
        rows = page.locator(".reasons tbody tr")
        expect(rows).to_have_count(len(replay.presses))
        assert replay.reasons is not None
        numbers = [f"{share:.2f}" for share in replay.reasons[0]["at_end"].values()]
        expect(rows.first.locator(".number")).to_have_text(numbers)
        expect(rows.first.locator("td").last).to_have_text("Mistake")
        rows.nth(3).get_by_role("button").click()
        expect(line(page)).to_contain_text(f"{replay.reasons[3]['time']:.1f} s.")
        expect(page.locator(".reasons tr.now th")).to_have_text(f"{replay.reasons[3]['time']:.1f} s")
        page.get_by_label("Belief under the model").select_option("learned")
        assert stage.until("open", 2)[-1] == {"type": "open", "trial": NAME, "model": "learned"}
        stage.say(replaying.opened(folder, NAME, "learned"))
        expect(page.get_by_label("Belief under the model")).to_have_value("learned")
        expect(line(page)).to_contain_text(f"{replay.reasons[3]['time']:.1f} s.")


def test_an_annotator_labels_presses_by_mouse_and_key_and_again(
    browser: Browser, folder: SimpleNamespace, tmp_path: Path
) -> None:
    with annotating(browser, folder) as (stage, page, replay):
        expect(page.locator(".charts")).to_have_count(0)
        expect(page.locator("h1 .badge:visible")).to_have_text("simulated")
        first, second = (press["seq"] for press in replay.presses[:2])
        rows = page.locator(".labelling tr")
        rows.first.get_by_label("That Mov").check()
        sent = {"type": "label", "trial": NAME, "press_seq": first, "mental_state": "that_mov"}
        assert stage.until("label") == [sent]
        expect(rows.first.locator(".saved")).to_have_text("…")
        stage.say(Acknowledged(what="label", n=first))
        expect(rows.first.locator(".saved")).to_have_text("saved")
        expect(page.get_by_text("7 of 8 presses have no label yet.")).to_be_visible()
        page.keyboard.press("n")
        page.keyboard.press("n")
        page.keyboard.press("1")
        page.keyboard.press("3")
        said = [(one["press_seq"], one["mental_state"]) for one in stage.until("label", 3)]
        assert said[1:] == [(second, "mistake"), (second, "that_wrt")]
        expect(rows.nth(1).get_by_label("That WRT")).to_be_checked()
        picture(page, tmp_path, "labels")


def test_a_label_that_is_refused_or_not_sent_does_not_stay(browser: Browser, folder: SimpleNamespace) -> None:
    with annotating(browser, folder) as (stage, page, _):
        row = page.locator(".labelling tr").first
        row.get_by_label("Mistake").check()
        stage.until("label")
        stage.say(Problem(text="this trial is not over yet"))
        expect(page.get_by_role("alert")).to_have_text("this trial is not over yet")
        expect(row.locator(".saved")).to_have_text("not saved")
        expect(row.get_by_label("Mistake")).not_to_be_checked()
        stage.drop(REPLACED)
        page.wait_for_timeout(200)
        row.get_by_label("That Dist").click()
        expect(page.get_by_role("alert")).to_contain_text("this label was not saved")
        expect(row.get_by_label("That Dist")).not_to_be_checked()


def test_keys_of_a_control_stay_with_it(browser: Browser, folder: SimpleNamespace) -> None:
    with annotating(browser, folder) as (stage, page, _):
        page.keyboard.press("n")
        at = slider(page).input_value()
        row = page.locator(".labelling tr").first
        row.get_by_label("Mistake").focus()
        page.keyboard.press("ArrowRight")
        expect(row.get_by_label("That Mov")).to_be_checked()
        assert slider(page).input_value() == at
        assert stage.until("label")[0]["mental_state"] == "that_mov"
        page.get_by_label("Speed").focus()
        page.keyboard.press("4")
        assert len(stage.of("label")) == 1


def test_the_list_is_narrowed_down_and_says_what_cannot_be_read(
    browser: Browser, folder: SimpleNamespace, tmp_path: Path
) -> None:
    listed = replaying.trials(folder)
    listed.trials += [{"trial": "P09-1", "problem": "line 3: not JSON"}]
    with served(Stage("admin", [listed])) as stage, opened(browser, stage, size=LAPTOP) as page:
        page.get_by_role("button", name="Trials", exact=True).click()
        expect(page.locator(".trials tbody tr")).to_have_count(2)
        expect(page.locator(".unread")).to_contain_text("cannot be read: line 3: not JSON")
        picture(page, tmp_path, "trials")
        page.get_by_label("Show those with").fill("pomdp")
        expect(page.locator(".trials tbody tr")).to_have_count(1)
        expect(page.get_by_text("1 of 2 trials")).to_be_visible()
