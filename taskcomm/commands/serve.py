"""`taskcomm serve` and `taskcomm study serve`: the simulator and the study in the browser."""

import sys
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import typer

from taskcomm.commands.terminal import Terminal


def study(folder: Path, json: bool, **options: Any) -> int:
    """Serve a study until interrupted."""
    needs_web()
    from taskcomm.web.study.folder import StudyFolder

    opened = StudyFolder(folder)
    terminal = Terminal(json)
    for warning in opened.warnings:
        terminal.message(f"warning: {warning}")
    if options["lockstep"] and not opened.design.simulated:
        raise typer.BadParameter("only for a simulated study: no clock would run", param_hint="--lockstep")

    def say(address: str) -> None:
        _say_links(terminal, opened, address, folder)
        terminal.line(f"{address}: serving {opened.design.title!r} ({folder}); Ctrl-C ends it")
        terminal.line(f"admin      {address}/#{opened.tokens['admin']['admin']}")
        for role in ("operator", "annotator"):
            for name, token in opened.tokens.get(role, {}).items():
                terminal.line(f"{role:<10} {address}/#{token}  {name}")
        terminal.line(f"teachers   {address}/#TOKEN, one each: tokens in {opened.links}")
        sys.stdout.flush()

    _serve(opened, say, **options)
    return 0


def one_trial(out: Path | None, stay: bool, json: bool, **asked: Any) -> int:
    """Make a folder with one trial in it, serve it until that is over, say what can be done with its log."""
    needs_web()
    from taskcomm.commands.models import load_model
    from taskcomm.web.serving import listening
    from taskcomm.web.study.folder import StudyFolder
    from taskcomm.web.study.reading import StudyError

    origin, host, port = (asked.pop(name) for name in ("origin", "host", "port"))
    terminal = Terminal(json)
    model = asked["model"]
    load_model(model, "--model")
    folder = out or Path(f"taskcomm-trial-{time.strftime('%Y%m%d-%H%M%S')}")
    design = _design(**asked)
    bound = listening(host, port)
    try:
        opened = StudyFolder.new(folder, design, models=[] if model == "intuitive" else [Path(model)])
    except StudyError:
        bound.close()
        raise
    [plan] = opened.participants[0].trials

    def say(address: str) -> None:
        _say_links(terminal, opened, address, folder)
        [teacher] = opened.tokens["teacher"].values()
        terminal.line(f"teach the robot here    {address}/#{teacher}")
        for token in opened.tokens.get("operator", {}).values():
            terminal.line(f"control the robot here  {address}/#{token}  (where the teacher cannot see it)")
        terminal.line(f"look on, replay         {address}/#{opened.tokens['admin']['admin']}")
        sys.stdout.flush()

    def over(house: Any) -> bool:
        [room] = house.rooms.values()
        return not stay and room.finished and room.client is None

    _serve(opened, say, over, origin, host=host, bound=bound)
    log = opened.log_of(plan)
    if log.exists():
        terminal.line(f"{log}: the trial; `taskcomm replay {log} --out replay.png` shows it")
    return 0


def needs_web() -> None:
    """Raise a usage error where the packages of the server are missing."""
    missing = [name for name in ("starlette", "uvicorn", "websockets") if find_spec(name) is None]
    if missing:
        raise typer.BadParameter(
            f"the browser simulator needs {', '.join(missing)}: pip install 'taskcomm[web]'"
        )


def _design(
    operator: bool,
    model: str,
    horizon: int,
    threshold: float,
    balls: int,
    distances: int,
    task: str | None,
    limit: float,
    language: str,
) -> Any:
    from taskcomm.web.study import structure as st

    named = model if model == "intuitive" else Path(model).name
    robot = st.Condition(
        name="pomdp", controller="planner", model=named, horizon=horizon, threshold=threshold
    )
    world = st.WorldDesign(balls=balls, distances=distances)
    return st.Design(
        name="one-trial",
        language=language,
        teachers=1,
        operators=st.Operators(pool=("O1",), draw=1) if operator else None,
        world=world,
        conditions=(st.HUMAN if operator else robot,),
        cards="random" if task is None else (_task(task),),
        seed=time.time_ns() % 2**53,
        consent=st.Consent(ask=False),
        questionnaire=(),
        ratings=(),
        instructions=False,
        timing=st.Timing(limit=limit),
        annotators=(),
    )


def _task(text: str) -> tuple[int, int, int]:
    try:
        mov, wrt, dist = (int(part) for part in text.split(","))
    except ValueError:
        raise typer.BadParameter(f"{text!r}: as in 1,2,4 (mov, wrt, dist)", param_hint="--task") from None
    return mov, wrt, dist


def _say_links(terminal: Terminal, opened: Any, address: str, folder: Path) -> None:
    links = {
        role: {name: f"{address}/#{token}" for name, token in names.items()}
        for role, names in opened.tokens.items()
    }
    terminal.document({"address": address, "links": links, "folder": str(folder)})


def _serve(opened: Any, say: Any, until: Any = None, origin: list[str] | None = None, **options: Any) -> None:
    from taskcomm.web.serving import serve

    serve(opened, ready=say, until=until, origins=frozenset(origin or ()), **options)
