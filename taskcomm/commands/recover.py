"""`taskcomm recover`: simulate studies of known teachers, fit them, and compare with the truth."""

from pathlib import Path

import typer

from learn.recovery import SOURCES, Plan, recover
from learn.recovery_report import Recovery, interval, recovery_of, robot_plan, write_recovery
from learn.recovery_robots import INTUITIVE, run_robots
from learn.teaching import TRUTHS
from taskcomm.commands.models import check_model, load_model, model_files
from taskcomm.commands.output import result_directory, run_record, sha256_of, write_json
from taskcomm.commands.terminal import Terminal
from taskcomm.teacher import ModelError, TeacherModel
from taskcomm.wholefile import OutputError
from taskcomm.world import BallWorld


def run(
    out: Path,
    truth: list[str] | None,
    sizes: list[int] | None,
    robot: list[str] | None,
    repeats: int,
    pool: int,
    loops: int,
    loop_trials: int,
    batch: int,
    held_out: int,
    closed_loop: int,
    intervals: bool,
    delays: bool,
    decays: bool,
    starts: int,
    horizon: int,
    threshold: float,
    max_steps: int,
    balls: int,
    distances: int,
    seed: int,
    jobs: int,
    json: bool,
) -> int:
    """Recover, write the report, print a summary; rows are kept in `out`, for a run to be gone on with."""
    settings = {key: value for key, value in locals().items() if key not in ("json", "jobs")}
    terminal, world = Terminal(json), BallWorld(balls, distances)
    named = truth or ["prompt"]
    truths = truths_of(named, world)
    options = {"starts": starts, "delays": delays, "decays": decays}
    try:
        plan = Plan(
            tuple(sizes or (22, 44, 200)), tuple(robot or SOURCES), repeats, pool, loops, loop_trials, batch,
            held_out, horizon, threshold, max_steps, seed, intervals, options,
        )  # fmt: skip
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None
    record = run_record("recover", settings, model_files(named))
    with result_directory(out) as part:
        out.mkdir(parents=True, exist_ok=True)
        try:
            fits = recover(out, world, truths, plan, jobs=jobs, stage=terminal.progress)
            robots = []
            if closed_loop:
                driven = robot_plan(plan, closed_loop)
                robots = run_robots(out, world, truths, fits, driven, jobs=jobs, stage=terminal.progress)
        except ValueError as error:
            if "kept of another run" not in str(error):
                raise
            raise OutputError(str(error)) from None
        found = recovery_of(fits, robots, truths, plan)
        written = write_recovery(found, part)
        write_json(found.to_json(), part / "recovery.json")
        outputs = {path.name: sha256_of(path) for path in [*written, part / "recovery.json"]}
        write_json({**record, "outputs": outputs}, part / "run.json")
    terminal.document({"command": "recover", "out": str(out), **found.to_json()})
    summarise(found, terminal)
    terminal.line(f"{out / 'report.md'}: the report, with figures and tables beside it")
    return 0


def truths_of(named: list[str], world: BallWorld) -> dict[str, TeacherModel]:
    """The teachers to recover: those that are known by name, or model files, by their stems made distinct."""
    truths: dict[str, TeacherModel] = {}
    for name in named:
        model = TRUTHS[name] if name in TRUTHS else load_truth(name)
        check_model(model, name, world, {model.dt})
        truth = name if name in TRUTHS else Path(name).stem
        while truth in truths:
            truth += "'"
        truths[truth] = model
    steps = sorted({model.dt for model in truths.values()})
    if len(steps) > 1:
        raise ModelError(f"dt: the truths have {', '.join(f'{dt:g} s' for dt in steps)}; recover them apart")
    return truths


def load_truth(name: str) -> TeacherModel:
    """A model file; the usage error for what is none also names the teachers there are."""
    if not Path(name).is_file():
        known = ", ".join(TRUTHS)
        raise typer.BadParameter(f"{name!r} is neither one of {known} nor a model file", param_hint="--truth")
    return load_model(name, "--truth")


def summarise(found: Recovery, terminal: Terminal) -> None:
    """Tables for people."""
    last = {(row["truth"], row["source"]): row for row in sorted(found.curve, key=lambda row: row["size"])}
    lines = []
    for one in found.crossings:
        row = last[one["truth"], one["source"]]
        gain, possible = interval(row, "gain"), f"{row['possible']:.2f}"
        lines.append([one["truth"], one["source"], one["from_trials"], row["size"], gain, possible])
    terminal.table(
        "From how many trials on learning pays (simulated; nats per fresh trial)",
        ["teachers", "robot moved by", "pays from (trials)", "last size", "gain there", "true model's"],
        lines,
    )
    if found.robots:
        rows = []
        for row in found.robots:
            late, forms = round(row["timeout"] * row["trials"]), (("time", ".1f"), ("time_ratio", ".2f"))
            numbers = [interval(row, name, form) for name, form in (*forms, ("correct", ".3f"))]
            rows.append([row["truth"], row["arm"], *numbers, late])
        terminal.table(
            f"Robots, {found.robots[0]['trials']} simulated trials each",
            ["teachers", "robot", "mean time (s)", f"time / {INTUITIVE}", "share right", "timeouts"],
            rows,
        )
