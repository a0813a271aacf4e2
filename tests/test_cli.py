"""The command line: what it writes, what it prints, its exit codes, and what it leaves when it fails."""

import gzip
import json
import resource
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

import taskcomm.cli
from taskcomm.cli import main
from taskcomm.commands.output import result_directory
from taskcomm.logs import read_trials
from taskcomm.teacher import TeacherModel

LEARNING = ("fit", "population", "structure", "recover")
COMMANDS = ("simulate", "compare", "replay", "figures", "validate", "demo", "serve", *LEARNING)
DONE, FAILED, USAGE, BAD_DATA, NOT_CONVERGED = range(5)


def run(*arguments: object) -> int:
    """The exit code; fits come without intervals, which take most of their time (see test_fit_command)."""
    quick = ["--intervals", "none"] if arguments[:1] == ("fit",) and "--help" not in arguments else []
    return main([str(argument) for argument in (*arguments, *quick)])


def left_in(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six operator trials of three people."""
    path = tmp_path_factory.mktemp("logs") / "trials.jsonl"
    code = run("simulate", "--robot", "operator", "--trials", 6, "--people", 3, "--jobs", 1, "--out", path)
    assert code == DONE
    return path


@pytest.fixture(scope="module")
def model(log: Path) -> Path:
    """The model fitted to them."""
    path = log.with_name("model.json")
    assert run("fit", log, "--starts", 1, "--out", path) == DONE
    return path


def test_help_answers_in_half_a_second() -> None:
    # Processor time, of the best of five: what it takes on a machine that has nothing else to do.
    taken = []
    for _ in range(5):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, "-m", "taskcomm.cli", "--help"], check=True, capture_output=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        taken.append(after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime)
    assert min(taken) <= 0.5


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_every_command_shows_an_example(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(command, "--help") == DONE
    shown = capsys.readouterr().out
    assert f"Example: taskcomm {command}" in shown
    assert "--json" in shown


def test_the_version_is_that_of_the_package(capsys: pytest.CaptureFixture[str]) -> None:
    from taskcomm import __version__

    assert run("--version") == DONE
    assert capsys.readouterr().out == f"taskcomm {__version__}\n"


def test_fit_loads_no_torch_and_no_plots(log: Path, tmp_path: Path) -> None:
    script = (
        "import sys; from taskcomm.cli import main\n"
        f"code = main(['fit', {str(log)!r}, '--starts', '1', '--intervals', 'none',"
        f" '--out', {str(tmp_path / 'm.json')!r}])\n"
        "heavy = {'torch', 'sklearn', 'pomegranate', 'matplotlib', 'pandas'} & set(sys.modules)\n"
        "sys.exit(code if not heavy else f'loaded {heavy}')"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == DONE, done.stderr


def test_simulate_gives_the_same_bytes_for_a_seed_and_others_for_another(tmp_path: Path) -> None:
    for name, seed, jobs in (("a.jsonl", 3, 1), ("b.jsonl", 3, 2), ("c.jsonl", 4, 1)):
        arguments = ("--robot", "operator", "--trials", 3, "--seed", seed, "--jobs", jobs)
        assert run("simulate", *arguments, "--out", tmp_path / name) == DONE
    a, b, c = ((tmp_path / name).read_bytes() for name in ("a.jsonl", "b.jsonl", "c.jsonl"))
    assert a == b
    assert a != c


def test_simulate_with_a_planning_robot_and_files_in_a_small_world(tmp_path: Path, model: Path) -> None:
    out = tmp_path / "trials.jsonl.gz"
    size = ("--balls", 2, "--distances", 1, "--horizon", 2, "--max-steps", 30, "--trials", 2, "--jobs", 1)
    assert run("simulate", "--teacher", model, "--robot", model, *size, "--out", out) == DONE
    assert gzip.decompress(out.read_bytes())
    trials = read_trials(out)
    assert {trial.robot_model["sha256"] for trial in trials if trial.robot_model} == {
        TeacherModel.load(model).sha256
    }
    people = {f"s0-{TeacherModel.load(model).sha256[:4]}-p{number:03d}" for number in range(2)}
    assert {trial.participant_id for trial in trials} == people
    assert all(trial.num_steps <= 30 for trial in trials)


def test_logs_of_one_seed_can_be_used_together(tmp_path: Path, model: Path) -> None:
    """Trials have ids of their own, whatever was set; people are the same where they teach alike."""
    short = ("--trials", 2, "--max-steps", 4, "--horizon", 1, "--jobs", 1, "--out")
    settings: dict[str, tuple[object, ...]] = {
        "operator": ("--robot", "operator"),
        "robot": (),
        "visits": ("--people", 1),
        "model": ("--robot", model),
        "threshold": ("--threshold", 0.9),
        "others": ("--robot", "operator", "--teacher", model),
    }
    for name, chosen in settings.items():
        assert run("simulate", *chosen, *short, tmp_path / f"{name}.jsonl") == DONE
    of = {name: read_trials(tmp_path / f"{name}.jsonl") for name in settings}
    assert len(read_trials(tmp_path)) == 2 * len(settings)
    assert {trial.trial_id.split("-")[1] for trial in of["operator"]} == {"operator"}
    assert {trial.trial_id.split("-")[1] for trial in of["robot"]} == {"pomdp"}
    people = {name: {trial.participant_id for trial in trials} for name, trials in of.items()}
    assert people["operator"] == people["robot"] == people["model"]
    assert people["visits"] < people["robot"]
    assert people["others"].isdisjoint(people["operator"])


def test_more_trials_begin_with_the_same_ones(tmp_path: Path) -> None:
    for count in (2, 3):
        quick = ("--robot", "operator", "--max-steps", 5, "--jobs", 1)
        assert run("simulate", *quick, "--trials", count, "--out", tmp_path / f"{count}.jsonl") == DONE
    two, three = ((tmp_path / f"{count}.jsonl").read_bytes() for count in (2, 3))
    assert three.startswith(two)


@pytest.mark.parametrize(
    ("robot", "jobs", "expected"),
    [("intuitive", 2, ["warm", "map"]), ("intuitive", 1, ["map"]), ("operator", 2, ["map"])],
)
def test_the_search_is_compiled_before_it_is_needed_in_several_processes(
    robot: str, jobs: int, expected: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []

    def mapped(work: Any, items: Any, *_: Any) -> list[Any]:
        done.append("map")
        return [work(item) for item in items]

    monkeypatch.setattr("taskcomm.commands.simulate.map_in_order", mapped)
    monkeypatch.setattr("taskcomm.planner.EntropyPlanner.warm_up", lambda _: done.append("warm"))
    size = ("--trials", 1, "--max-steps", 1, "--horizon", 1)
    assert run("simulate", "--robot", robot, *size, "--jobs", jobs, "--out", tmp_path / "t.jsonl") == DONE
    assert done == expected


def test_every_result_has_a_record_of_settings_versions_and_hashes(log: Path, model: Path) -> None:
    record = json.loads(model.with_name("model.json.run.json").read_text(encoding="utf-8"))
    assert record["schema"] == "taskcomm.run/1"
    assert record["settings"]["starts"] == 1
    assert {"python", "numpy", "taskcomm"} <= set(record["versions"])
    assert set(record["inputs"]) == {str(log)}
    from taskcomm.commands.output import sha256_of

    assert record["inputs"][str(log)] == sha256_of(log)
    assert record["outputs"] == {"model.json": sha256_of(model)}


def test_fit_prints_a_row_for_each_parameter_and_says_what_informed_it(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("fit", log, "--starts", 1, "--out", tmp_path / "m.json") == DONE
    said = capsys.readouterr()
    for word in ("parameter", "intuitive", "learned", "presses", "steps", "mistake", "that_dist.fall"):
        assert word in said.out
    assert "fitting 6 trials" in said.err
    assert left_in(tmp_path) == {"m.json", "m.json.run.json"}


def test_json_is_all_there_is_on_stdout(
    log: Path, model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = read_trials(log)[0].trial_id
    jobs: dict[str, tuple[object, ...]] = {
        "simulate": ("--robot", "operator", "--trials", 1, "--out", tmp_path / "t.jsonl"),
        "fit": (log, "--starts", 1, "--out", tmp_path / "m.json"),
        "replay": (log, "--trial", first, "--model", model, "--out", tmp_path / "r.svg"),
        "validate": (log,),
    }
    for command, arguments in jobs.items():
        assert run(command, *arguments, "--json") == DONE
        document: dict[str, Any] = json.loads(capsys.readouterr().out)
        assert document


def test_a_fit_that_did_not_converge_writes_its_model_marked_and_says_so(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "m.json"
    assert run("fit", log, "--starts", 1, "--max-iter", 1, "--out", out) == NOT_CONVERGED
    assert TeacherModel.load(out).provenance["converged"] is False
    assert "not converged" in capsys.readouterr().err
    assert left_in(tmp_path) == {"m.json", "m.json.run.json"}


def test_fit_without_task_cards_is_another_fit(log: Path, model: Path, tmp_path: Path) -> None:
    out = tmp_path / "unknown.json"
    assert run("fit", log, "--starts", 1, "--task-unknown", "--out", out) in (DONE, NOT_CONVERGED)
    assert TeacherModel.load(out) != TeacherModel.load(model)


def test_compare_writes_a_report_and_takes_several_models_after_one_option(
    log: Path, model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "results" / "cömpare"
    settings = ("--closed-loop", 2, "--horizon", 1, "--max-steps", 20, "--decisions", 5, "--folds", 2)
    quick = ("--starts", 1, "--jobs", 1, "--no-blind")
    code = run("compare", log, "--models", "intuitive", model, *settings, *quick, "--out", out, "--json")
    said = capsys.readouterr()
    document = json.loads(said.out)
    assert code == (DONE if document["folds_converged"] and "did not" not in said.err else NOT_CONVERGED)
    assert set(document["held_out"]) == {"intuitive", "model", "learned"}
    assert document["held_out"]["model"]["in_sample_trials"] == 6
    files = {"report.md", "run.json", "comparison.json", "learned.json", "held-out.csv", "thresholds.csv"}
    for figure in ("table-tops", "time-to-final", "entropy", "calibration"):
        files |= {f"{figure}.png", f"{figure}.csv"}
    assert left_in(out) == files
    record = json.loads((out / "run.json").read_text(encoding="utf-8"))
    assert set(record["inputs"]) == {str(log), str(model)}
    assert set(record["outputs"]) == files - {"run.json"}
    assert left_in(out.parent) == {"cömpare"}


def test_replay_writes_the_figure_and_its_numbers(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trial = read_trials(log)[2]
    assert run("replay", log, "--trial", trial.trial_id, "--out", tmp_path / "r.png") == DONE
    assert left_in(tmp_path) == {"r.png", "r.json", "r.png.run.json"}
    document = json.loads((tmp_path / "r.json").read_text(encoding="utf-8"))
    assert len(document["entropy"]) == trial.num_steps + 1
    assert len(document["presses"]) == int(trial.presses.sum())
    assert [press["noted"] for press in document["presses"]] == [
        step.mental_state for step in trial.steps if step.pressed
    ]
    assert "Why each press was made" in capsys.readouterr().out


def test_replay_explains_a_decision_in_words_as_json_and_as_a_drawing(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trial = read_trials(log)[1]
    asked = ("replay", log, "--trial", trial.trial_id, "--explain", 4, "--horizon", 2)
    assert run(*asked, "--out", tmp_path / "r.png") == DONE
    said = capsys.readouterr().out
    plan = {"r-step4.png", "r-step4.json"}
    assert left_in(tmp_path) == {"r.png", "r.json", "r.png.run.json"} | plan
    told = json.loads((tmp_path / "r-step4.json").read_text(encoding="utf-8"))
    assert f"{told['action']} has the least expected entropy, summed over 2 steps (1 s)" in said
    assert "The decision at step 4 (2 s; " in said
    assert (told["logged"], told["horizon"]) == (str(trial.steps[4].action), 2)
    record = json.loads((tmp_path / "r.png.run.json").read_text(encoding="utf-8"))
    assert (record["settings"]["explain"], record["settings"]["horizon"]) == (4, 2)
    belief = json.loads((tmp_path / "r.json").read_text(encoding="utf-8"))
    assert told["entropy"] == belief["entropy"][4]
    assert "explanation" not in belief

    assert run(*asked, "--json") == DONE
    assert json.loads(capsys.readouterr().out)["explanation"] == told
    assert run("replay", log, "--trial", trial.trial_id, "--explain", 10**6) == USAGE
    assert "there is no step" in " ".join(capsys.readouterr().err.replace("│", " ").split())


def test_replay_of_one_among_many_wants_its_name(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("replay", log) == USAGE
    assert "holds 6 trials" in " ".join(capsys.readouterr().err.replace("│", " ").split())
    assert run("replay", log, "--trial", "nobody") == USAGE
    assert "no trial 'nobody'" in capsys.readouterr().err


def test_validate_lists_problems_and_ends_with_bad_data(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("validate", log) == DONE
    assert "6 trials" in capsys.readouterr().out
    lines = log.read_text(encoding="utf-8").splitlines()
    lines[3] = lines[3].replace('"t":2', '"t":7')
    broken = tmp_path / "broken.jsonl"
    broken.write_text("\n".join(lines) + "\n", encoding="utf-8")
    assert run("validate", broken) == BAD_DATA
    assert f"{broken}, line 4" in capsys.readouterr().out.replace(":4", ", line 4")


def test_validate_of_what_is_no_log_is_short(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    foreign = tmp_path / "picture.jsonl"
    foreign.write_bytes(bytes(range(256)) * 99 + b"\n")  # 100 lines
    assert run("validate", foreign, log) == BAD_DATA
    said = capsys.readouterr().out.splitlines()
    assert len(said) == 22
    assert said[20] == f"problem: {foreign}: and 80 more"
    assert said[21].startswith("2 files, 6 trials, ")
    assert said[21].endswith(" steps: 100 problems, 0 notices")
    assert run("validate", foreign, "--json") == BAD_DATA
    document = json.loads(capsys.readouterr().out)
    assert (len(document["problems"]), document["counts"]) == (21, {"problems": 100, "notices": 0})


def bad_log(kind: str, log: Path, folder: Path) -> Path:
    """A log with one thing wrong, at a path that is not ASCII."""
    lines = log.read_text(encoding="utf-8").splitlines()
    start = next(n for n in range(1, len(lines)) if '"trial_start"' in lines[n])
    texts = {
        "empty": "",
        "foreign": "a,b\n1,2\n",
        "truncated": "\n".join([*lines[: start - 5], lines[start - 5][:20], *lines[start - 4 : start]])
        + "\n",
        "duplicated": "\n".join(lines[:start] + lines[:start]) + "\n",
        "out of order": "\n".join([lines[0], lines[2], lines[1], *lines[3:start]]) + "\n",
        "invalid action": "\n".join(lines[:start]).replace("light_on", "release", 1) + "\n",
        "card": "\n".join(lines[:start]).replace('"mov":', '"mov":9', 1) + "\n",
        "version": "\n".join(lines[:start]).replace("taskcomm.trial/1", "taskcomm.trial/9", 1) + "\n",
        "two dt": "\n".join(lines[:start] + [line.replace('"dt":0.5', '"dt":0.25') for line in lines[start:]])
        + "\n",
    }
    path = folder / "schlechte Prüfung.jsonl"
    path.write_text(texts[kind], encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "kind",
    [
        "empty",
        "foreign",
        "truncated",
        "duplicated",
        "out of order",
        "invalid action",
        "card",
        "version",
        "two dt",
    ],
)
def test_a_bad_log_is_one_message_and_leaves_no_file(
    kind: str, log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = bad_log(kind, log, tmp_path)
    for command in ("fit", "compare"):
        capsys.readouterr()
        assert run(command, bad, "--out", tmp_path / "out") == BAD_DATA
        said = capsys.readouterr()
        assert said.out == ""
        message = [line for line in said.err.splitlines() if line.startswith("error: ")]
        assert len(message) == 1
        assert "Traceback" not in said.err
        assert kind == "two dt" or bad.name in message[0]
        assert left_in(tmp_path) == {bad.name}


def test_an_empty_folder_and_a_missing_log_are_told_apart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "logs").mkdir()
    assert run("fit", tmp_path / "logs", "--out", tmp_path / "m.json") == BAD_DATA
    assert run("fit", tmp_path / "nothing.jsonl", "--out", tmp_path / "m.json") == USAGE
    assert "does not exist" in capsys.readouterr().err
    assert left_in(tmp_path) == {"logs"}


def test_a_torn_last_line_is_named_and_the_rest_is_fitted(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    torn = tmp_path / "torn.jsonl"
    torn.write_bytes(log.read_bytes()[:-30])
    assert run("fit", torn, "--starts", 1, "--out", tmp_path / "m.json") == DONE
    assert f"warning: {torn}" in capsys.readouterr().err


def test_what_cannot_be_fitted_is_named_with_its_place(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    quick = tmp_path / "quick.jsonl"
    quick.write_text(
        log.read_text(encoding="utf-8").replace('"dt":0.5', '"dt":0.25').replace('"s0-', '"s1-'),
        encoding="utf-8",
    )
    one, other = read_trials(log)[0].trial_id, read_trials(quick)[0].trial_id
    for command in ("fit", "compare"):
        capsys.readouterr()
        assert run(command, log, quick, "--out", tmp_path / "out") == BAD_DATA
        said = capsys.readouterr().err.splitlines()[-1]
        assert said.startswith(f"error: two dt in one fit: 0.5 s in trial {one}, 0.25 s in trial {other} (")
        assert said.endswith(f"(trial {one} is at {log}:1; trial {other} is at {quick}:1)")
    assert left_in(tmp_path) == {"quick.jsonl"}


def test_a_model_is_converted_to_the_step_of_the_logs_only_when_asked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    quick, log, out = tmp_path / "quick.json", tmp_path / "t.jsonl", tmp_path / "out"
    TeacherModel.intuitive().with_dt(0.25).save(quick)
    made = ("--teacher", quick, "--robot", "operator", "--trials", 4, "--people", 2, "--jobs", 1)
    assert run("simulate", *made, "--out", log) == DONE
    few = ("--closed-loop", 2, "--horizon", 1, "--max-steps", 9, "--decisions", 3, "--folds", 2, "--no-blind")
    compared = ("compare", log, *few, "--starts", 1, "--jobs", 1, "--out", out / "results")
    out.mkdir()
    for command in (
        ("fit", log, "--starts", 1, "--out", out / "m.json"),
        compared,
        (*compared, "--models", quick),
    ):
        before = left_in(out)
        capsys.readouterr()
        assert run(*command) == BAD_DATA
        said = capsys.readouterr().err
        assert "the model is for steps of 0.5 s, the trials have 0.25 s; --convert-dt converts it" in said
        assert left_in(out) == before
        assert run(*command, "--convert-dt") in (DONE, NOT_CONVERGED)
        said = capsys.readouterr().err
        assert said.count("converted from steps of 0.5 s to 0.25 s; this is approximate") == 1
    for fitted in (TeacherModel.load(out / "m.json"), TeacherModel.load(out / "results" / "learned.json")):
        assert fitted.dt == 0.25
        assert fitted.provenance["initial_conversion"] == "from dt = 0.5 s to 0.25 s, approximate"


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"schema": "taskcomm.teacher/9"}, "schema"),
        ({"mistake": -1}, "mistake"),
        ({"surprise": 1}, "surprise"),
    ],
)
def test_a_bad_model_is_one_message_that_names_file_and_field(
    change: dict[str, Any], reason: str, log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = tmp_path / "bad.json"
    bad.write_text(json.dumps(json.loads(TeacherModel.intuitive().to_json()) | change), encoding="utf-8")
    assert run("fit", log, "--initial", bad, "--out", tmp_path / "m.json") == BAD_DATA
    said = capsys.readouterr().err
    assert str(bad) in said
    assert reason in said
    assert left_in(tmp_path) == {"bad.json"}


def test_a_model_with_another_cue_or_step_is_bad_data(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other.json"
    other.write_text(TeacherModel.intuitive().to_json().replace("mov_lit", "mov_sung"), encoding="utf-8")
    TeacherModel.intuitive().with_dt(0.25).save(tmp_path / "quick.json")
    before = left_in(tmp_path)
    for name, reason in (("other.json", "mov_sung"), ("quick.json", "dt")):
        for arguments in (
            ("fit", log, "--initial", tmp_path / name, "--out", tmp_path / "m.json"),
            ("compare", log, "--models", tmp_path / name, "--out", tmp_path / "dir"),
            ("replay", log, "--trial", read_trials(log)[0].trial_id, "--model", tmp_path / name),
        ):
            assert run(*arguments) == BAD_DATA
            said = capsys.readouterr().err
            assert reason in said
            assert str(tmp_path / name) in said
    slow = ("--trials", 1, "--out", tmp_path / "t.jsonl")
    assert run("simulate", "--teacher", tmp_path / "quick.json", *slow) == BAD_DATA
    assert left_in(tmp_path) == before


def test_output_that_cannot_be_written_is_found_out_before_the_work(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:

    def work(*_: object) -> None:
        raise AssertionError("the work has begun")

    monkeypatch.setattr("taskcomm.logs.LogReader.read", work)
    (tmp_path / "file").write_text("", encoding="utf-8")
    nowhere = tmp_path / "no such folder" / "m.json"
    for arguments in (
        ("fit", log, "--out", nowhere),
        ("fit", log, "--out", tmp_path),
        ("compare", log, "--out", tmp_path / "file"),
        ("compare", log, "--out", tmp_path / "file" / "below"),
        ("demo", "--data", log.parent, "--out", tmp_path / "file"),
        ("simulate", "--out", nowhere.with_name("t.jsonl.gz")),
        ("fit", log, "--out", "."),
        ("fit", log, "--out", ""),
        ("compare", log, "--out", "/"),
    ):
        assert run(*arguments) == FAILED
        said = capsys.readouterr().err
        assert said.startswith("error: ")
        assert len(said.splitlines()) == 1
        missing = f"cannot be written: there is no folder {nowhere.parent}; make it first"
        assert (missing in said) == any("no such folder" in str(argument) for argument in arguments)
    assert left_in(tmp_path) == {"file"}


def test_results_go_into_the_current_directory_beside_what_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = tmp_path / "here"
    for folder in (here, tmp_path / "here.part"):
        folder.mkdir()
        (folder / "mine.txt").write_text("mine", encoding="utf-8")
    monkeypatch.chdir(here)
    with result_directory(Path()) as part:
        (part / "report.md").write_text("new", encoding="utf-8")
    assert left_in(here) == {"mine.txt", "report.md"}
    assert left_in(tmp_path) == {"here", "here.part"}
    assert left_in(tmp_path / "here.part") == {"mine.txt"}


def test_usage_errors_end_with_two(log: Path, tmp_path: Path) -> None:
    for arguments in (
        ("fit",),
        ("fit", log),
        ("fit", log, "--out", tmp_path / "m.json", "--starts", 0),
        ("fit", log, "--out", tmp_path / "m.json", "--initial", "nobody"),
        ("simulate", "--out", tmp_path / "t.jsonl", "--robot", "nobody"),
        ("replay", log, "--trial", "a", "--out", tmp_path / "figure.docx"),
        ("simulate", "--trials", 1, "--out", tmp_path / "trials.csv"),
        ("frobnicate",),
    ):
        assert run(*arguments) == USAGE
    assert left_in(tmp_path) == set()


def test_a_failure_of_the_work_leaves_no_half_written_file(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("taskcomm.teacher.TeacherModel.save", fails)
    (tmp_path / "m.json").write_text("as it was", encoding="utf-8")
    assert run("fit", log, "--starts", 1, "--out", tmp_path / "m.json") == FAILED
    assert (tmp_path / "m.json").read_text(encoding="utf-8") == "as it was"
    assert left_in(tmp_path) == {"m.json"}


def test_a_full_disk_is_a_failure_that_names_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(self: Path, content: bytes) -> int:
        self.touch()
        if content:
            raise OSError(28, "No space left on device")
        return 0

    monkeypatch.setattr(Path, "write_bytes", full)
    out = tmp_path / "t.jsonl"
    made = ("--robot", "operator", "--trials", 1, "--max-steps", 3, "--jobs", 1)
    assert run("simulate", *made, "--out", out) == FAILED
    assert capsys.readouterr().err == f"error: {out}: cannot be written: No space left on device\n"
    assert left_in(tmp_path) == set()


def test_the_demo_on_other_data_begins_its_report_with_what_was_gained(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data, out = tmp_path / "data", tmp_path / "out"
    data.mkdir()
    (data / "trials.jsonl").write_bytes(log.read_bytes())
    (data / "teachers.json").write_text("[1, 2]", encoding="utf-8")
    assert run("demo", "--data", data, "--trials", 2, "--jobs", 1, "--out", out) == BAD_DATA
    assert str(data / "teachers.json") in capsys.readouterr().err
    assert left_in(tmp_path) == {"data"}
    (data / "teachers.json").unlink()
    assert run("demo", "--data", data, "--trials", 2, "--jobs", 1, "--out", out) == DONE
    text = (out / "report.md").read_text(encoding="utf-8")
    gained = capsys.readouterr().out.splitlines()[-2]
    assert gained.startswith("With the learned model the robot takes ")
    assert gained in text.split("\n## ")[0]
    pictures = {"table-tops.png", "time-to-final.png", "entropy.png", "mistake.png"}
    assert pictures <= left_in(out)
    assert all(f"]({name})" in text for name in pictures)


def test_a_trial_that_broke_off_before_its_first_step_is_named_and_left_out(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    start = json.loads(log.read_bytes().split(b"\n")[0]) | {"trial_id": "begun"}
    begun, more = tmp_path / "begun.jsonl", tmp_path / "more.jsonl"
    begun.write_text(json.dumps(start) + "\n", encoding="utf-8")
    more.write_bytes(log.read_bytes() + begun.read_bytes())
    assert run("fit", more, "--out", tmp_path / "m.json", "--starts", 1) == DONE
    assert "left out, since they broke off before the first step: begun" in capsys.readouterr().err
    assert run("fit", begun, "--out", tmp_path / "n.json", "--starts", 1) == BAD_DATA
    assert capsys.readouterr().err == f"error: {begun}: no trial with a step\n"
    assert not (tmp_path / "n.json").exists()


@pytest.mark.verify
def test_the_demo_takes_less_than_three_minutes(tmp_path: Path) -> None:
    started = time.perf_counter()
    subprocess.run([sys.executable, "-m", "taskcomm.cli", "demo", "--out", tmp_path / "out"], check=True)
    assert time.perf_counter() - started < 180


def test_the_demo_says_where_it_looked_for_its_data(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from taskcomm.commands import demo

    assert demo.study_folder().name == "simulated-study"
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(demo, "__file__", str(tmp_path / "a" / "b" / "c" / "demo.py"))
    assert run("demo", "--out", tmp_path / "out") == BAD_DATA
    said = capsys.readouterr().err
    assert "simulated-study" in said
    assert str(tmp_path) in said
    assert left_in(tmp_path) == set()


def test_an_option_that_takes_all_that_follow() -> None:
    spread = taskcomm.cli._spread
    assert spread("--models", ["a", "--models", "b", "c", "--out", "d", "e"]) == [
        "a", "--models", "b", "--models", "c", "--out", "d", "e",
    ]  # fmt: skip
    assert spread("--models", ["--models", "a", "--models", "b"]) == ["--models", "a", "--models", "b"]
