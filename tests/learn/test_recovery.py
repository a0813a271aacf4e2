"""Recovery: studies of known teachers, what is kept of them, and what is made of it."""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tinyworld import menu

from learn import fit, log_likelihoods, recovery_study, run_closed_loop
from learn.bootstrap import ratio_interval
from learn.certainty import uncertainty
from learn.kept_rows import KeptRows
from learn.recovery import HELD_OUT, Plan, Study, recover
from learn.recovery_figure import WIDEST, error_figure, learning_curve, robot_figure
from learn.recovery_report import Recovery, recovery_of, report, robot_plan
from learn.recovery_robots import RobotPlan, learned, loop_of, robot_rows, run_robots
from learn.recovery_study import PARTS, TABLES, Part, read_tables, write_tables
from learn.recovery_summary import Crossing, cells, crossing, curve_rows, parameter_rows, scaled
from learn.teaching import TRUTHS, Teaching, intuitive_for
from taskcomm.cli import BAD_DATA, DONE, FAILED, USAGE, main
from taskcomm.teacher import TableTop, TeacherModel
from taskcomm.world import BallWorld

RESULTS = Path(__file__).parents[2] / "notebooks" / "results"
WORLD = BallWorld(2, 1)
TRUTH = TRUTHS["prompt"]
PLAN = Plan(
    sizes=(3, 6), repeats=2, pool=12, loops=1, loop_trials=6, batch=3, held_out=4, horizon=2, max_steps=40,
    options={"starts": 1},
)  # fmt: skip
ROBOTS = RobotPlan("both", sizes=(3, 6), trials=5, models=2, horizon=2, max_steps=40)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("recovery")


@pytest.fixture(scope="module")
def rows(folder: Path) -> list[dict[str, Any]]:
    return recover(folder, WORLD, {"prompt": TRUTH}, PLAN)


@pytest.fixture(scope="module")
def robots(folder: Path, rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return run_robots(folder, WORLD, {"prompt": TRUTH}, rows, ROBOTS)


@pytest.fixture(scope="module")
def found(rows: list[dict[str, Any]], robots: list[dict[str, Any]]) -> Recovery:
    return recovery_of(rows, robots, {"prompt": TRUTH}, PLAN)


def of(rows: Sequence[dict[str, Any]], source: str, size: int, repeat: int = 0) -> dict[str, Any]:
    wanted = (source, size, repeat)
    (row,) = (row for row in rows if (row["source"], row["size"], row["repeat"]) == wanted)
    return row


def test_studies_of_one_size_share_no_trials_and_both_take_turns() -> None:
    plan = Plan(sizes=(5, 2), repeats=3, pool=10)
    for source, size, count in (("operator", 2, 3), ("both", 2, 3), ("planner", 5, 2)):
        studies = [study for study in plan.studies if (study.source, study.size) == (source, size)]
        assert [study.repeat for study in studies] == list(range(count))
        taken = [key for study in studies for key in study.keys]
        assert len(set(taken)) == len(taken) == count * size
    assert Study("both", 3, 1).keys == [("planner", 3), ("operator", 4), ("planner", 5)]
    assert [study.size for study in Plan(sizes=(2000,), pool=10).studies] == [2000] * 3


@pytest.mark.parametrize("batch", [1, 7, 22, 100, 200])
def test_the_loop_ends_with_all_its_trials_and_learns_about_every_batch(batch: int) -> None:
    rounds = Plan(loop_trials=200, batch=batch).rounds
    assert rounds[-1] == 200
    assert max(abs(more - batch) for more in np.diff([0, *rounds])) <= 1
    assert Plan(loop_trials=200, batch=300).rounds == [200]


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"sizes": (3, 3)}, "sizes: must be different numbers"),
        ({"sizes": (0,)}, "sizes: must be different numbers"),
        ({"sources": ("loop",)}, "sources: some of operator, planner, both, not loop"),
        ({"sources": ()}, "sources: .* not none"),
        ({"pool": 0}, "pool: at least 1, not 0"),
        ({"loops": -1}, "loops: at least 0, not -1"),
    ],
)
def test_a_plan_that_cannot_be_is_refused(wrong: dict[str, Any], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        Plan(**wrong)


def test_tasks_and_luck_of_a_trial_are_the_same_whoever_moves_the_robot() -> None:
    teaching = Teaching(WORLD, TRUTH, seed=3, horizon=2, max_steps=30)
    for index in range(4):
        by_operator = teaching.by_operator(index)
        by_planner = teaching.by_planner(index, TRUTH)
        assert by_operator.task == by_planner.task
        assert by_operator == Teaching(WORLD, TRUTH, seed=3, horizon=2, max_steps=30).by_operator(index)
    assert teaching.by_operator(0) != Teaching(WORLD, TRUTH, seed=4, max_steps=30).by_operator(0)
    assert teaching.by_operator(0) != Teaching(WORLD, TRUTH, 3, HELD_OUT, max_steps=30).by_operator(0)


def test_the_intuitive_model_takes_the_structure_of_the_truth_and_none_of_its_numbers() -> None:
    tops = {f"that_{n}": TableTop("mov_lit", 0.2, 3.0, 4.0, delay=0.5, decay=2.0) for n in range(4)}
    model = intuitive_for(TeacherModel(0.02, tops, dt=0.25, rest=1.0))
    assert (list(model.approvals), model.dt, model.rest) == (list(tops), 0.25, 1.0)
    top = model.approvals["that_3"]
    assert (top.rise, top.fall, top.delay, top.decay) == (2.0, 2.0, 0.0, None)
    assert model.mistake + sum(top.peak for top in model.approvals.values()) < 0.3


def test_a_row_is_the_fit_to_the_trials_of_its_study(rows: list[dict[str, Any]]) -> None:
    teaching = PLAN.teaching(WORLD, TRUTH)
    trials = [
        teaching.by_operator(n) if n % 2 == 0 else teaching.by_planner(n, intuitive_for(TRUTH))
        for n in (3, 4, 5)
    ]
    row = of(rows, "both", 3, 1)
    model = fit(trials, world=WORLD, initial=intuitive_for(TRUTH), starts=1).model
    assert TeacherModel.from_dict(row["model"]) == model
    assert row["presses_in_all"] == sum(trial.presses.sum() for trial in trials)
    reasons = [row["presses"][name] for name in row["presses"] if name.endswith(("mistake", "peak"))]
    assert sum(reasons) == pytest.approx(row["presses_in_all"], abs=0.01)  # every press has one of them
    assert row["steps"]["mistake"] < row["steps_in_all"]


def test_scores_are_those_of_fresh_trials_under_the_learned_model(rows: list[dict[str, Any]]) -> None:
    teaching, intuitive = PLAN.teaching(WORLD, TRUTH, HELD_OUT), intuitive_for(TRUTH)
    fresh = [teaching.by_operator(n) if n % 2 == 0 else teaching.by_planner(n, intuitive) for n in range(4)]
    for source, size in (("operator", 6), ("loop", 3), ("true", 0), ("intuitive", 0)):
        row = of(rows, source, size)
        expected = log_likelihoods(fresh, WORLD, TeacherModel.from_dict(row["model"]))
        # in the order in which they were simulated: the operator's first
        assert row["scores"] == pytest.approx([*expected[::2], *expected[1::2]], abs=1e-4)


def test_the_loop_plans_with_what_it_has_learned(rows: list[dict[str, Any]]) -> None:
    first, second = of(rows, "loop", 3), of(rows, "loop", 6)
    assert first["model"] == of(rows, "planner", 3)["model"]  # the intuitive model moves both
    teaching, model = PLAN.teaching(WORLD, TRUTH), TeacherModel.from_dict(first["model"])
    trials = [teaching.by_planner(n, intuitive_for(TRUTH)) for n in range(3)]
    trials += [teaching.by_planner(n, model) for n in range(3, 6)]
    again = fit(trials, world=WORLD, initial=intuitive_for(TRUTH), starts=1).model
    assert TeacherModel.from_dict(second["model"]) == again


def test_a_run_that_is_stopped_and_gone_on_with_comes_to_the_same(
    rows: list[dict[str, Any]], folder: Path, tmp_path: Path
) -> None:
    lines = (folder / "fits.jsonl").read_text(encoding="utf-8").splitlines(keepends=True)
    (tmp_path / "fits.jsonl").write_text("".join(lines[:9]) + lines[9][:40], encoding="utf-8")
    assert recover(tmp_path, WORLD, {"prompt": TRUTH}, PLAN) == rows
    kept = KeptRows(tmp_path / "fits.jsonl")
    assert kept.rows()[:8] == KeptRows(folder / "fits.jsonl").rows()[:8]
    assert len(kept.rows()) == len(rows)
    with pytest.raises(ValueError, match="kept of another run, seed 0, not 1"):
        recover(tmp_path, WORLD, {"prompt": TRUTH}, Plan(**{**vars(PLAN), "seed": 1}))


def test_any_world_can_be_recovered_by_the_planner(tmp_path: Path) -> None:
    world, truth = menu(2)
    plan = Plan(sizes=(2,), sources=("planner",), repeats=1, held_out=2, horizon=1, max_steps=20)
    rows = recover(tmp_path, world, {"guest": truth}, plan)
    assert [row["source"] for row in rows] == ["true", "intuitive", "planner"]
    told = report(recovery_of(rows, [], {"guest": truth}, plan))
    assert "the fresh trials were moved by the planner" in told
    assert "approves_served.rise" in told


def made(truth: TeacherModel, model: TeacherModel, source: str, size: int, repeat: int, score: float) -> Any:
    from learn.coordinates import names_of

    names = names_of(list(truth.approvals))
    marks = {
        name: "" if name.split(".")[-1] in ("mistake", "peak", "rise", "fall") else "fixed" for name in names
    }
    counted = dict.fromkeys(names, 2.0 * size)
    about = {"truth": "made", "source": source, "size": size, "repeat": repeat, "model": model.to_dict()}
    about |= {"marks": marks, "steps": counted, "presses": counted, "converged": True}
    return about | {
        "steps_in_all": 10 * size,
        "presses_in_all": size,
        "scores": [score - 1.0, score + 1.0] * 20,
    }


def with_mistake(mistake: float) -> TeacherModel:
    return TeacherModel(mistake, TRUTH.approvals)


def made_rows(gains: dict[int, float]) -> list[dict[str, Any]]:
    """Studies that gain so much by size; their mistakes are twice and half the true odds."""
    odds = TRUTH.mistake / (1 - TRUTH.mistake)
    models = [with_mistake(k * odds / (1 + k * odds)) for k in (2.0, 0.5)]
    rows = [made(TRUTH, TRUTH, "true", 0, 0, 3.0), made(TRUTH, TRUTH, "intuitive", 0, 0, 0.0)]
    for size, gain in gains.items():
        rows += [made(TRUTH, model, "both", size, k, gain) for k, model in enumerate(models)]
    return rows


def test_errors_are_on_the_scale_of_odds_and_leave_out_what_has_no_data() -> None:
    rows = made_rows({8: 1.0})
    rows[2]["marks"]["that_mov.fall"] = rows[3]["marks"]["that_mov.fall"] = "no data"
    rows[2]["marks"]["that_mov.rise"] = "at its bound"
    rows[2]["marks"]["that_wrt.rise"] = "no data"
    told = {row["parameter"]: row for row in parameter_rows(rows)}
    assert len(told) == 10  # what is fixed is not recovered
    mistake = told["mistake"]
    assert mistake["bias"] == pytest.approx(0.0, abs=1e-12)
    assert mistake["rmse"] == pytest.approx(math.log(2))
    assert (mistake["bias_low"], mistake["bias_high"]) == pytest.approx((-math.log(2), math.log(2)))
    assert (mistake["steps"], mistake["studies"], mistake["true"]) == (2.0, 2, 0.01)
    assert told["that_mov.rise"]["at_bound"] == told["that_wrt.rise"]["no_data"] == 0.5
    assert told["that_wrt.rise"]["rmse"] == 0.0
    assert told["that_mov.fall"]["no_data"] == 1.0
    assert math.isnan(told["that_mov.fall"]["rmse"])
    assert scaled("x.peak", 0.0) == -math.inf


def test_an_interval_covers_what_lies_between_its_ends_and_any_at_an_open_one() -> None:
    rows = made_rows({8: 1.0})
    true = TRUTH.mistake
    rows[2]["intervals"] = {"mistake": (true, 1.5 * true), "that_mov.rise": (1.5, None)}
    rows[3]["intervals"] = {"mistake": (None, 0.5 * true), "that_mov.rise": (None, 2.0)}
    told = {row["parameter"]: row for row in parameter_rows(rows)}
    assert (told["mistake"]["coverage"], told["mistake"]["intervals"]) == (0.5, 2)
    assert told["mistake"]["coverage_low"] == pytest.approx(0.0945, abs=1e-4)  # Wilson's for one of two
    assert told["that_mov.rise"]["coverage"] == 0.5
    assert told["that_mov.fall"]["intervals"] == 0
    assert math.isnan(told["that_mov.fall"]["coverage"])
    recovery = Recovery(PLAN, {"made": TRUTH}, parameter_rows(rows), curve_rows(rows), [], [])
    assert "| made | both | 8 | 50% of 2 |" in report(recovery)


def test_gain_and_what_is_left_sum_to_what_is_possible(rows: list[dict[str, Any]]) -> None:
    for row in curve_rows(rows):
        assert row["gain"] + row["short"] == pytest.approx(row["possible"], abs=1e-9)
        assert row["gain_low"] <= row["gain"] <= row["gain_high"]
    made_up = {row["size"]: row for row in curve_rows(made_rows({4: -1.0, 16: 1.0}))}
    assert (made_up[4]["gain"], made_up[4]["better"], made_up[16]["better"]) == (-1.0, 0.0, 1.0)
    ends = made_up[4]["gain_low"], made_up[4]["gain_high"]
    assert ends == pytest.approx((-1.0, -1.0))  # all fresh trials, and both studies, gain the same


def test_an_interval_of_the_curve_is_that_of_means_over_studies_where_fresh_trials_are_alike() -> None:
    rows = made_rows({4: 1.0})
    rows += [made(TRUTH, TRUTH, "both", 4, 2 + n, score) for n, score in enumerate((0.0, 2.0, 5.0, -1.0))]
    (row,) = curve_rows(rows)
    expected = ratio_interval([1.0, 1.0, 0.0, 2.0, 5.0, -1.0], np.ones(6))
    assert row["gain"] == pytest.approx(expected.estimate)
    assert (row["gain_low"], row["gain_high"]) == pytest.approx((expected.low, expected.high), abs=0.2)


@pytest.mark.parametrize(
    ("gains", "expected"),
    [
        ({4: -1.0, 16: 1.0, 64: 2.0}, "8 (8 to 8)"),
        ({4: 0.5, 16: 1.0}, "≤ 4 (≤ 4 to ≤ 4)"),
        ({4: 0.5, 16: -1.0}, "> 16 (> 16 to > 16)"),
        ({1: 1.0, 4: -1.0, 16: 3.0}, "6 (6 to 6)"),
    ],
)
def test_learning_pays_from_where_the_gain_rises_above_none_for_good(
    gains: dict[int, float], expected: str
) -> None:
    assert str(crossing(made_rows(gains), "made", "both")) == expected


def test_a_crossing_beyond_the_sizes_is_said_to_be_so() -> None:
    assert str(Crossing(math.inf, 0.0, math.inf, 2, 50)) == "> 50 (≤ 2 to > 50)"


def test_robots_are_those_of_the_closed_loop_and_studies_take_turns(
    rows: list[dict[str, Any]], robots: list[dict[str, Any]]
) -> None:
    models = [TeacherModel.from_dict(of(rows, "both", 3, k)["model"]) for k in (0, 1)]
    arms = {"true": TRUTH, "intuitive": intuitive_for(TRUTH), "0": models[0], "1": models[1]}
    loop = run_closed_loop(WORLD, arms, TRUTH, 5, horizon=2, seed=0, jobs=1, max_steps=40)
    ours = loop_of(robots, "prompt", learned(3), 0.5)
    assert ours.groups == (0, 1, 0, 1, 0)
    for arm in ("true", "intuitive"):
        assert ours.time(arm).tolist() == loop.time(arm).tolist()
        assert ours.correct(arm).tolist() == loop.correct(arm).tolist()
    for n in range(5):
        assert ours.outcomes[learned(3)][n].steps == loop.outcomes[str(n % 2)][n].steps
        assert ours.outcomes[learned(3)][n].highest == pytest.approx(
            loop.outcomes[str(n % 2)][n].highest, abs=1e-4
        )
    assert {(row["arm"], row["models"]) for row in robot_rows(robots, 0.5, 0.98)} == {
        ("intuitive", 1), ("true", 1), (learned(3), 2), (learned(6), 2)
    }  # fmt: skip


def test_intervals_of_robots_are_the_wider_of_studies_and_trials() -> None:
    def row(trial: int, arm: str, study: int, correct: bool) -> dict[str, Any]:
        about = {"truth": "made", "arm": arm, "trial": trial, "study": study, "steps": 10 + trial % 2}
        ended = {"correct": correct, "timeout": False, "presses": 1}
        return about | ended | {"highest": [0.5, 0.99], "right": "01" if correct else "00"}

    alike = [row(n, learned(3), n % 4, n >= 4) for n in range(40)]  # every study: nine of ten right
    apart = [row(n, learned(6), n % 4, n % 4 > 0) for n in range(40)]  # one study of four all wrong
    known = [row(n, arm, -1, True) for arm in ("intuitive", "true") for n in range(40)]
    told = {one["arm"]: one for one in robot_rows([*known, *alike, *apart], 0.5, 0.98)}
    by_trial = ratio_interval(np.arange(40) >= 4, np.ones(40))
    assert told[learned(3)]["correct_low"] == by_trial.low < 0.9
    assert told[learned(6)]["correct_low"] == told[learned(6)]["right_low"] < 0.5
    assert told["true"]["right"] == 1.0


def test_more_trials_of_robots_begin_with_the_same_ones(
    folder: Path, rows: list[dict[str, Any]], robots: list[dict[str, Any]]
) -> None:
    more = run_robots(folder, WORLD, {"prompt": TRUTH}, rows, RobotPlan(**{**vars(ROBOTS), "trials": 6}))
    assert [row for row in more if row["trial"] < 5] == robots
    with pytest.raises(ValueError, match="no study of 5 trials, both, was fitted for prompt"):
        run_robots(folder, WORLD, {"prompt": TRUTH}, rows, RobotPlan(**{**vars(ROBOTS), "sizes": (5,)}))


def test_the_report_says_that_it_is_simulated_and_shows_every_part(found: Recovery) -> None:
    told = report(found)
    assert "All of this is simulated" in told
    for part in ("When learning pays", "teachers prompt", "starve", "Learned models as robots"):
        assert part in told
    assert "RMSE: loop" in told
    assert {row["source"] for row in found.crossings} == {"operator", "planner", "both"}
    assert json.loads(json.dumps(found.to_json(), allow_nan=False))["crossings"]
    assert robot_plan(PLAN, 5) == ROBOTS


def test_figures_show_every_source_size_and_robot(found: Recovery) -> None:
    curve = learning_curve(found.curve)
    assert "Simulated" in str(curve.get_suptitle())
    assert set(curve.axes[0].get_legend_handles_labels()[1]) == {
        "operator",
        "planner",
        "both",
        "loop",
        "true model",
    }
    errors = error_figure(found.parameters, "prompt")
    assert errors.axes[9].get_title("left") == "mistake (0.01)"
    assert errors.axes[0].get_ylim()[1] > WIDEST
    robots = robot_figure(found.robots)
    ticks = [label.get_text() for label in robots.axes[0].get_xticklabels()]
    assert ticks == ["intuitive", "3", "6", "true"]
    for figure in (curve, errors, robots):
        figure.canvas.draw()


def test_cells_are_the_fits_without_the_references(rows: list[dict[str, Any]]) -> None:
    counted = {key[1:]: len(studies) for key, studies in cells(rows).items()}
    assert counted == {(s, n): 2 for s in ("operator", "planner", "both") for n in (3, 6)} | {
        ("loop", 3): 1, ("loop", 6): 1
    }  # fmt: skip


def test_kept_tables_are_read_as_they_were_written(found: Recovery, tmp_path: Path) -> None:
    part = Part("prompt", ("prompt",), PLAN, robot_trials=5)
    write_tables([found, found], [part, part], tmp_path)
    read = read_tables(tmp_path)
    for table in TABLES:
        written = getattr(found, table)
        assert len(read[table]) == 2 * len(written)
        for ours, theirs in zip(read[table], [*written, *written], strict=True):
            for key, value in theirs.items():
                number = isinstance(value, float)
                assert ours[key] == (pytest.approx(value, rel=1e-3, nan_ok=True) if number else value)
            assert list(ours) == list(theirs)
    made = json.loads((tmp_path / "recovery.json").read_text(encoding="utf-8"))
    assert made["simulated"] is True
    assert made["parts"][0]["plan"]["seed"] == PLAN.seed


def test_one_part_made_anew_replaces_its_own_rows_alone(
    found: Recovery, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    parts = [Part("all", ("prompt",), PLAN, 5), Part("six", ("prompt",), replace(PLAN, sizes=(6,)), 0)]
    monkeypatch.setattr(recovery_study, "PARTS", parts)
    write_tables([found], parts[:1], tmp_path)
    made = json.loads((tmp_path / "recovery.json").read_text(encoding="utf-8"))
    (tmp_path / "recovery.json").write_text(json.dumps(made | {"parts": made["parts"] * 2}), encoding="utf-8")
    before = {table: (tmp_path / f"recovery-{table}.csv").read_text().splitlines() for table in TABLES}
    six = [row for row in found.curve if row["size"] == 6 and row["source"] == "operator"]
    anew = replace(found, curve=[row | {"studies": 77} for row in six], parameters=[], robots=[])
    recovery_study.write_one(anew, 1, tmp_path)
    for table in TABLES:
        after = (tmp_path / f"recovery-{table}.csv").read_text().splitlines()
        changed = [new for old, new in zip(before[table], after, strict=True) if old != new]
        assert len(changed) == (table == "curve")
        assert all(line.startswith("prompt,operator,6,77,") for line in changed)
    plans = [part["plan"] for part in json.loads((tmp_path / "recovery.json").read_text())["parts"]]
    assert [plan["sizes"] for plan in plans] == [list(PLAN.sizes), [6]]


def test_the_kept_study_is_that_of_the_code() -> None:
    made = json.loads((RESULTS / "recovery.json").read_text(encoding="utf-8"))
    plans = [json.loads(json.dumps(asdict(part.plan))) for part in PARTS]
    assert [part["plan"] for part in made["parts"]] == plans
    kept = read_tables(RESULTS)
    assert {row["truth"] for row in kept["curve"]} == {"prompt", "hesitant", "intuitive"}
    for part in PARTS:
        of_part = {
            (truth, source, size)
            for truth in part.truths
            for source in part.plan.sources
            for size in part.plan.sizes
        }
        assert of_part <= {(row["truth"], row["source"], row["size"]) for row in kept["curve"]}
    assert {row["size"] for row in kept["curve"] if row["source"] == "loop"} == set(PARTS[0].plan.rounds)


QUICK = ["--sizes", "2", "3", "--repeats", "1", "--held-out", "2", "--balls", "2", "--distances", "1"]
QUICK += ["--horizon", "1", "--max-steps", "20", "--starts", "1", "--jobs", "1", "--robot", "both"]


def test_the_command_writes_a_report_and_goes_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, own = tmp_path / "new" / "out", tmp_path / "prompt.json"
    TRUTHS["hesitant"].save(own)
    asked = ["recover", "--truth", "prompt", str(own), *QUICK, "--out", str(out)]
    assert main(asked) == DONE
    assert "learning pays" in capsys.readouterr().out
    kept = (out / "fits.jsonl").read_bytes()
    assert "intervals" not in kept.decode().splitlines()[3]
    assert main([*asked, "--closed-loop", "2", "--json"]) == DONE
    document = json.loads(capsys.readouterr().out)
    assert {row["truth"] for row in document["crossings"]} == {"prompt", "prompt'"}
    assert len(document["robots"]) == 2 * 4
    assert (out / "fits.jsonl").read_bytes() == kept
    made = {path.name for path in out.iterdir()}
    assert {"report.md", "learning-curve.png", "errors-prompt.csv", "robots.png", "run.json"} <= made
    assert main([*asked, "--seed", "1"]) == FAILED
    assert "kept of another run, seed 0, not 1" in capsys.readouterr().err


@pytest.mark.verify
def test_intervals_kept_are_those_of_the_fit(tmp_path: Path) -> None:
    plan = Plan(**{**vars(PLAN), "sizes": (4,), "sources": ("operator",), "repeats": 1, "loops": 0})
    row = recover(tmp_path, WORLD, {"prompt": TRUTH}, Plan(**{**vars(plan), "intervals": True}))[-1]
    trials = [PLAN.teaching(WORLD, TRUTH).by_operator(n) for n in range(4)]
    found = uncertainty(fit(trials, world=WORLD, initial=intuitive_for(TRUTH), starts=1), trials)
    assert set(row["intervals"]) == {one.parameter for one in found.intervals if one.low is not None}
    for name, (low, high) in row["intervals"].items():
        one = found[name]
        assert (low, high) == (None if one.open_low else one.low, None if one.open_high else one.high)
    with pytest.raises(ValueError, match="kept of another run, intervals True, not False"):
        recover(tmp_path, WORLD, {"prompt": TRUTH}, plan)


def test_what_the_command_cannot_do_is_said_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = ["--out", str(tmp_path / "out")]
    for arguments, code, told in (
        (["--truth", "nobody"], USAGE, "neither one of prompt, hesitant, intuitive nor a model"),
        (["--sizes", "2", "2"], USAGE, "sizes: must be different numbers"),
        (["--robot", "loop"], USAGE, "sources: some of operator"),
    ):
        assert main(["recover", *arguments, *out]) == code
        assert told in " ".join(capsys.readouterr().err.replace("│", " ").split())
    other = TRUTHS["prompt"].with_dt(0.25)
    other.save(tmp_path / "other.json")
    assert main(["recover", "--truth", "prompt", str(tmp_path / "other.json"), *out]) == BAD_DATA
    assert "the truths have 0.25 s, 0.5 s" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.verify
def test_nothing_depends_on_the_number_of_processes(rows: list[dict[str, Any]], tmp_path: Path) -> None:
    assert recover(tmp_path, WORLD, {"prompt": TRUTH}, PLAN, jobs=2) == rows


@pytest.mark.verify
def test_errors_shrink_with_the_size_of_the_study_and_learning_pays(tmp_path: Path) -> None:
    plan = Plan(sizes=(22, 200), sources=("operator",), repeats=8, pool=1600, held_out=100)
    rows = recover(tmp_path, BallWorld(), {"prompt": TRUTH}, plan, jobs=2)
    rmse = {(row["parameter"], row["size"]): row["rmse"] for row in parameter_rows(rows)}
    for name in ("mistake", "that_mov.peak", "that_wrt.peak", "that_dist.peak", "that_wrt.rise"):
        assert rmse[name, 200] < rmse[name, 22]
    few, many = curve_rows(rows)
    assert few["gain_low"] > 0
    assert few["short"] > many["short"]
    assert many["short"] == pytest.approx(10 / 2 / 200, abs=0.03)  # half a nat a parameter and study
