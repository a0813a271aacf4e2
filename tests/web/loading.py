"""So many trials of the planner at once in real time, and what that costs the server."""

import asyncio
import os
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from web.rehearsing import everybody, logs, study

from taskcomm.teacher import TeacherModel
from taskcomm.web.serverprocess import ServerProcess
from taskcomm.web.study.structure import CERTAIN, Condition, Timing

TICKS_A_SECOND = os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True)
class Load:
    """What was measured: lateness in ms of every tick, by the server's logs and by what bots saw; the steps
    of each trial and why it ended; memory in MB of server and planners, once a second; processor seconds of
    each; seconds.
    """

    late_ms: list[float]
    seen_late_ms: list[float]
    missed: int
    defaults: int
    steps: list[int]
    reasons: list[str]
    memory: list[float]
    server_cpu: float
    planner_cpu: float
    seconds: float

    def __str__(self) -> str:
        late, seen = (np.quantile(ms, [0.5, 0.99, 1]).round(1) for ms in (self.late_ms, self.seen_late_ms))
        cpu = self.server_cpu + self.planner_cpu
        return (
            f"{len(self.steps)} trials, {len(self.late_ms)} ticks: late by {late[0]} ms,"
            f" {late[1]} (99%), {late[2]} (greatest); frames arrived by {seen[0]}, {seen[1]}, {seen[2]};"
            f" {self.missed} missed, {self.defaults} default actions; {cpu / self.seconds:.2f} processors,"
            f" the planner {self.planner_cpu / cpu:.0%} of that; memory {self.memory[0]:.0f} MB at first,"
            f" {self.memory[-1]:.0f} MB at last"
        )


def undecided(step: float, presses: float = 0.04) -> TeacherModel:
    """A teacher whose presses have no reason: the robot never knows the task, the trial goes on."""
    plain = TeacherModel.intuitive().to_dict()
    tops = {name: top | {"peak": 0.0} for name, top in plain["approvals"].items()}
    return TeacherModel.from_dict(plain | {"dt": step, "mistake": presses, "approvals": tops})


def loaded(
    path: Path, trials: int, seconds: float, *, horizon: int, processes: int, step: float = 0.5
) -> Load:
    """Run so many trials for so many seconds each."""
    condition = Condition(name="pomdp", controller="planner", horizon=horizon, threshold=CERTAIN)
    timing = Timing(step=step, limit=seconds, countdown=1.0)
    folder = study(path / "study", trials, operators=0, conditions=(condition,), timing=timing)
    arrivals: dict[str, list[float]] = {person.id: [] for person in folder.participants}
    server = ServerProcess(folder.path, path / "server.err", lockstep=False, processes=processes)
    server.start()
    try:
        heard = {name: _noting(times) for name, times in arrivals.items()}
        rehearsal = everybody(folder, server.address, undecided(step), at_once=trials, heard=heard)
        memory, cpu = asyncio.run(_watched(rehearsal.run(), server.pid))
        server.stop()
    finally:
        server.kill()
    written = logs(folder).values()
    steps = [[line for line in log if line["type"] == "step"] for log in written]
    summaries = [line for log in written for line in log if line.get("kind") == "timing"]
    return Load(
        late_ms=[line["timing"]["late_ms"] for log in steps for line in log],
        seen_late_ms=[ms for times in arrivals.values() for ms in _lateness(times, step)],
        missed=sum(line["missed"] for line in summaries),
        defaults=sum(line["default_actions"] for line in summaries),
        steps=[len(log) for log in steps],
        reasons=[line["reason"] for log in written for line in log if line["type"] == "trial_end"],
        memory=memory,
        server_cpu=cpu[0],
        planner_cpu=cpu[1],
        seconds=seconds,
    )


def _noting(times: list[float]) -> Callable[[float, bytes], None]:
    def heard(seconds: float, content: bytes) -> None:
        if b'"type":"frame"' in content and b'"state":"run"' in content:
            times.append(seconds)

    return heard


def _lateness(times: list[float], step: float) -> list[float]:
    """Of each frame behind the beat of the quickest of them, in ms."""
    behind = np.array(times) - step * np.arange(len(times))
    return [float(ms) for ms in 1e3 * (behind - behind.min())]


async def _watched(run: Coroutine[Any, Any, None], pid: int) -> tuple[list[float], tuple[float, float]]:
    """Memory once a second while it runs; processor seconds of server and planners by its end."""
    task, memory = asyncio.create_task(run), []
    before = cpu = _processor_seconds(pid)
    while not task.done():
        cpu = _processor_seconds(pid)
        memory.append(sum(map(_memory, [pid, *_children(pid)])))
        await asyncio.wait({task}, timeout=1.0)
    await task
    return memory, (cpu[0] - before[0], cpu[1] - before[1])


def _children(pid: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def _memory(pid: int) -> float:
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def _processor_seconds(pid: int) -> tuple[float, float]:
    def of(process: int) -> float:
        fields = Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / TICKS_A_SECOND

    return of(pid), sum(map(of, _children(pid)))
