"""`make bench-planner-peers`: pymdp and pomdp-py on the closest form of the decision they can express."""

import json
import subprocess
import sys
import time
import venv
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.planner.peers.problem import WORLD, situations, static_model, write
from benchmarks.planner.situations import Situation

from taskcomm.planner import EntropyPlanner

HERE, BUILD = Path(__file__).parent, Path("build") / "peers"
DECISIONS = 8
SECONDS = 120.0
SIMULATIONS = 10000
PEERS = (
    ("inferactively-pymdp", "with_pymdp.py", ()),
    ("pomdp-py", "with_pomdp_py.py", (str(SIMULATIONS),)),
)
TEXT = f"""\
The decision without timing: rises and falls of one step, so that a press has a probability for each world
and task; 3 balls, 24 tasks; {DECISIONS} decisions of one simulated trial; {SECONDS:g} s a row at most.
Processor time of all threads, without start and compilation; each peer in a process of its own.
  peer/search  median ratio of the times of a decision
  best         decisions in which the peer's action is one of the best (ties included), by exact values
  lost         expected cost above the least, nats, mean; in parentheses: what the worst action loses

What they cannot express
  both      levels that rise, fall, are seen late and are reset by presses, unless every memory becomes a
            hidden state of its own for each task
  pymdp     the sum of the entropies over the steps: free energy counts information once, whenever it comes;
            actions valid in some worlds only: here those that are missing do nothing. Nothing is pruned (its
            own choice drops what is less probable than 1/16, as presses mostly are), so its tree is the
            whole one, in single precision.
  pomdp-py  costs of a belief: rewards are of states and actions. Here the robot may name the task at any
            time, with reward 1 if right; POUCT samples that, {SIMULATIONS} simulations a decision.
"""


def installed(package: str) -> Path | str:
    """The interpreter of an environment with the package, made if need be; or why there is none."""
    python = BUILD / package / "bin" / "python"
    if not (BUILD / package / ".ready").exists():
        venv.create(BUILD / package, with_pip=True, clear=True)
        pip = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", package]
        done = subprocess.run(pip, capture_output=True, text=True, check=False)
        if done.returncode:
            return (done.stderr.strip().splitlines() or ["pip failed"])[-1]
        (BUILD / package / ".ready").touch()
    return python


def version(python: Path, package: str) -> str:
    code = f"from importlib.metadata import version; print(version({package!r}))"
    return subprocess.run(
        [str(python), "-c", code], capture_output=True, text=True, check=True
    ).stdout.strip()


def answers(python: Path, script: str, problem: Path, more: tuple[str, ...]) -> list[dict[str, Any]]:
    """What a peer answered before its time was over."""
    command = [str(python), str(HERE / script), str(problem), *more]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS, check=False)
        if done.returncode:
            raise RuntimeError(f"{script} failed: {done.stderr.strip().splitlines()[-1]}")
        lines = done.stdout
    except subprocess.TimeoutExpired as late:
        lines = late.stdout.decode() if isinstance(late.stdout, bytes) else late.stdout or ""
    return [json.loads(line) for line in lines.splitlines(keepends=True) if line.endswith("\n")]


def searched(found: list[Situation], horizon: int) -> tuple[list[float], list[list[float]]]:
    """Seconds of the search, the best of five, and the exact value of every action."""
    planner, seconds, values = EntropyPlanner(WORLD, static_model(), horizon), [], []
    for situation in found:
        exact = planner.plan(situation.belief, situation.state, exact_values=True)
        values.append(list(exact.values.values()))
        times = []
        for _ in range(5):
            started = time.process_time()
            planner.plan(situation.belief, situation.state)
            times.append(time.process_time() - started)
        seconds.append(min(times))
    return seconds, values


def row(package: str, horizon: int, found: list[dict[str, Any]], ours: Any) -> dict[str, Any]:
    """The figures of one peer at one horizon."""
    seconds, values = ours
    lost = [v[min(a["chosen"], len(v) - 1)] - min(v) for a, v in zip(found, values, strict=False)]
    ratios = [answer["seconds"] / own for answer, own in zip(found, seconds, strict=False)]
    return {
        "peer": package,
        "horizon": horizon,
        "answered": len(found),
        "of": len(values),
        "peer_over_search": float(np.median(ratios)),
        "best": sum(nats <= 1e-6 for nats in lost),
        "lost": float(np.mean(lost)),
        "worst": float(np.mean([max(v) - min(v) for v in values[: len(found)]])),
    }


def main() -> int:
    print(TEXT)
    found, rows = situations(DECISIONS), []
    BUILD.mkdir(parents=True, exist_ok=True)
    for package, script, more in PEERS:
        python = installed(package)
        if isinstance(python, str):
            print(f"{package} could not be installed here: {python}")
            continue
        print(f"{package} {version(python, package)}", flush=True)
        for horizon in (1, 2, 3):
            problem = BUILD / f"horizon-{horizon}.npz"
            write(problem, found, horizon)
            got = answers(python, script, problem, more)
            if not got:
                print(f"  horizon {horizon}: no answer in {SECONDS:g} s", flush=True)
                continue
            rows.append(row(package, horizon, got, searched(found, horizon)))
            print(
                "  horizon {horizon}: {answered} of {of} answered, peer/search {peer_over_search:.0f},"
                " best {best}, lost {lost:.1e} ({worst:.1e})".format(**rows[-1]),
                flush=True,
            )
    (BUILD / "rows.json").write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    print(f"\nin {BUILD}: rows.json")
    return 0


if __name__ == "__main__":
    sys.exit(main())
