"""What people do, in real browsers at the real server: whole trials, and whatever cuts them."""

from pathlib import Path

from playwright.sync_api import Browser, expect
from web.houses import served
from web.pages.people import answer_forms, control, read_card, seen, teach
from web.pages.stage import picture, visit

from taskcomm.commands.study_export import run as export
from taskcomm.logs import read_trials, validate
from taskcomm.web.study.folder import StudyFolder
from taskcomm.web.study.structure import HUMAN, Condition, Consent, Design, Operators, Timing

STEP = 0.2
ONE = Design(
    name="one",
    teachers=1,
    conditions=(Condition(name="pomdp", controller="planner", horizon=2, threshold=0.9),),
    timing=Timing(step=STEP, limit=60, countdown=1, grace=0.6, away=20),
)
TWO = Design(
    name="two",
    teachers=1,
    operators=Operators(pool=("O1", "O2"), draw=1),
    conditions=(HUMAN,),
    questionnaire=(),
    instructions=False,
    consent=Consent(ask=False),
    timing=Timing(step=0.5, limit=60, countdown=1, grace=1.0, away=20),
)


def test_a_participant_goes_through_a_study_and_teaches_the_planner(browser: Browser, tmp_path: Path) -> None:
    folder = StudyFolder.new(tmp_path / "study", ONE)
    with served(folder) as study, visit(browser, study.link("teacher", "P01")) as page:
        picture(page, tmp_path, "consent")
        page.get_by_role("button", name="I agree").click()
        answer_forms(page, "About you")
        picture(page, tmp_path, "instructions")
        page.get_by_role("button", name="Continue").click()
        task = read_card(page)
        picture(page, tmp_path, "card")
        page.get_by_role("button", name="Begin").click()
        presses = teach(page, task, pause=3 * STEP)
        answer_forms(page, "What did you think of this trial?")
        expect(page.get_by_role("heading", name="Thank you")).to_be_visible()
    log = folder.trials_dir / "P01-1.jsonl"
    assert validate(log).problems == ()
    (trial,) = read_trials(log)
    assert (trial.task, trial.reason, trial.source) == (task, "final", "human")
    assert sum(bool(step.pressed) for step in trial.steps) == presses
    assert {rating["item"] for rating in trial.ratings} == {"intelligence", "right"}
    assert export(folder.path, tmp_path / "data set", json=False) == 0
    (table,) = (tmp_path / "data set" / "data").glob("*steps_data.csv")
    assert len(table.read_text().splitlines()) == 1 + len(trial.steps)


def test_an_operator_with_a_mouse_and_a_teacher_at_another_screen(browser: Browser, tmp_path: Path) -> None:
    folder = StudyFolder.new(tmp_path / "study", TWO)
    with (
        served(folder) as study,
        visit(browser, study.link("teacher", "P01")) as teacher,
        visit(browser, study.link("operator", folder.participants[0].operator or "")) as operator,
    ):
        task = read_card(teacher)
        operator.get_by_role("button", name="I am ready").click()
        teacher.get_by_role("button", name="Begin").click()
        expect(operator.locator(".status")).to_have_text("The robot is yours.")
        control(operator, [(f'[data-ball="{task.mov}"]', "right")])
        expect(teacher.locator(".told")).to_have_text(f"The robot lights ball {task.mov}.")
        teacher.keyboard.press("Space")
        expect(operator.locator("svg.pressed")).to_have_count(1)
        marks = [
            f'.mark[data-reference="{task.wrt}"][data-distance="{k}"]' for k in range(4, task.dist - 1, -1)
        ]
        control(operator, [(f'[data-ball="{task.mov}"]', "left"), *((mark, "left") for mark in marks)])
        picture(teacher, tmp_path, "two-screens-teacher")
        picture(operator, tmp_path, "two-screens-operator")
        teacher.keyboard.press("Space")
        operator.locator("[data-robot]").click()
        expect(teacher.locator(".said")).to_have_text("Final")
        answer_forms(teacher, "What did you think of this trial?")
        expect(teacher.get_by_role("heading", name="Thank you")).to_be_visible()
        expect(operator.locator(".status")).to_have_text("No teacher is here yet. Please wait.")
    log = folder.trials_dir / "P01-1.jsonl"
    assert validate(log).problems == ()
    (trial,) = read_trials(log)
    done = [str(step.action) for step in trial.steps if str(step.action) != "noa"]
    slides = [f"slide({task.mov}, {k}, {task.wrt})" for k in range(4, task.dist - 1, -1)]
    assert done == [f"light_on({task.mov})", f"pick_up({task.mov})", *slides]
    assert (trial.reason, trial.correct, sum(bool(step.pressed) for step in trial.steps)) == (
        "final",
        True,
        2,
    )


def test_a_trial_goes_on_after_a_reload_a_second_tab_and_a_lost_connection(
    browser: Browser, tmp_path: Path
) -> None:
    folder = StudyFolder.new(tmp_path / "study", TWO)
    with (
        served(folder) as study,
        visit(browser, study.link("operator", folder.participants[0].operator or "")) as operator,
        visit(browser, study.link("teacher", "P01")) as first,
    ):
        task = read_card(first)
        operator.get_by_role("button", name="I am ready").click()
        first.get_by_role("button", name="Begin").click()
        control(operator, [(f'[data-ball="{task.mov}"]', "right")])
        first.reload()
        expect(first.locator(".ball.lit")).to_have_count(1)
        expect(first.locator(".card .sentence")).to_be_visible()
        first.keyboard.press("Space")
        with visit(browser, study.link("teacher", "P01")) as second:
            expect(first.get_by_text("opened in another window")).to_be_visible()
            expect(second.locator(".ball.lit")).to_have_count(1)
            control(operator, [(f'[data-ball="{task.mov}"]', "left")])
            expect(second.locator(".told")).to_have_text(f"The robot picks up ball {task.mov}.")
            assert seen(second).held == task.mov
            cut = study.house.rooms["P01"].client
            assert cut is not None
            study.loop.call_soon_threadsafe(cut.drop, 1012, "")
            expect(second.locator(".banner")).to_contain_text("Connection lost")
            expect(second.locator(".banner")).to_have_text("")
            first_mark = f'.mark[data-reference="{task.wrt}"][data-distance="4"]'
            control(operator, [(first_mark, "left")])
            second.keyboard.press("Space")
            operator.locator("[data-robot]").click()
            expect(second.locator(".said")).to_have_text("Final")
            answer_forms(second, "What did you think of this trial?")
            expect(second.get_by_role("heading", name="Thank you")).to_be_visible()
    log = folder.trials_dir / "P01-1.jsonl"
    assert validate(log).problems == ()
    (trial,) = read_trials(log)
    assert (trial.reason, sum(bool(step.pressed) for step in trial.steps)) == ("final", 2)
    kinds = {event["kind"] for event in trial.events}
    assert {"away", "back"} <= kinds
