"""A trial as it runs: the same as in simulation, its rules of time, and a crash in its midst."""

import asyncio
import os
import signal
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from taskcomm.logs import read_trials, validate
from taskcomm.logwriter import TrialWriter
from taskcomm.planner import EntropyPlanner
from taskcomm.robot import Robot
from taskcomm.simulate import SimulatedTeacher, run_trial
from taskcomm.teacher import TeacherModel
from taskcomm.trials import Trial
from taskcomm.web.journal import Journal
from taskcomm.web.pilots import OperatorPilot, Pilot, PlannerPilot
from taskcomm.web.protocol import Frame
from taskcomm.web.thinking import Minds, RobotPlan, Thought
from taskcomm.web.trialrun import StorageError, Timing, TrialRun
from taskcomm.world import BallWorld

WORLD, MODEL = BallWorld(), TeacherModel.intuitive()
TASK = WORLD.tasks[5]
ROBOT = RobotPlan(WORLD, MODEL, horizon=2)
LOCKSTEP = Timing(lockstep=True, limit=400)
QUICK = Timing(step=0.05, limit=20, countdown=0, grace=0.1, away=0.5)


@pytest.fixture(scope="module")
def minds() -> Iterator[Minds]:
    minds = Minds([ROBOT])
    minds.warm_up()
    yield minds
    minds.close()


class Hall:
    """The audience of a test: keeps the frames, and does something at each."""

    def __init__(self, at_frame: Callable[[Frame], None] | None = None) -> None:
        self.frames: list[Frame] = []
        self.seqs: list[int] = []
        self.at_frame = at_frame

    def show(self, frame: Frame) -> None:
        self.frames.append(frame)
        if self.at_frame is not None:
            self.at_frame(frame)

    def opened(self) -> None:
        pass

    def saved(self, seq: int) -> None:
        self.seqs.append(seq)

    def clocks(self) -> dict[str, float]:
        return {"teacher_rtt_ms": 1.5}


def head(**fields: object) -> Trial:
    trial = Trial("one", WORLD, TASK, (), source="simulated", condition="pomdp")
    return replace(trial, **fields)  # type: ignore[arg-type]


def played(
    path: Path,
    pilot: Pilot,
    timing: Timing,
    act: Callable[[TrialRun, Frame], None],
    writer: TrialWriter | None = None,
) -> tuple[TrialRun, Hall]:
    """A trial run to its end, with `act` called at every frame of a running step."""

    async def run() -> tuple[TrialRun, Hall]:
        journal = Journal()
        hall = Hall(lambda frame: act(trial, frame) if frame.state == "run" else None)
        begun = writer or TrialWriter(head(dt=timing.step))
        trial = TrialRun(begun, pilot, lambda line: journal.append(path, line), hall, timing)
        try:
            await trial.run()
        finally:
            journal.close()
        return trial, hall

    return asyncio.run(run())


def simulated_teacher(seed: int) -> Callable[[TrialRun, Frame], None]:
    teacher = SimulatedTeacher(WORLD, MODEL, TASK)
    rng = np.random.default_rng(seed).spawn(2)[1]

    def act(trial: TrialRun, frame: Frame) -> None:
        if teacher.observe(trial.state, rng):
            trial.press(n=frame.t + 1)
        trial.done("teacher", frame.t)

    return act


@pytest.mark.parametrize("seed", range(3))
def test_in_lockstep_a_trial_is_the_one_that_simulation_gives(
    tmp_path: Path, minds: Minds, seed: int
) -> None:
    path = tmp_path / "one.jsonl"
    played(path, PlannerPilot(minds, ROBOT), LOCKSTEP, simulated_teacher(seed))
    [trial] = read_trials(path)
    robot = Robot(WORLD, MODEL, EntropyPlanner(WORLD, MODEL, horizon=2))
    wanted = run_trial(
        robot, SimulatedTeacher(WORLD, MODEL, TASK), np.random.default_rng(seed), max_steps=400
    )
    assert trial.actions == wanted.actions
    assert trial.presses.tolist() == wanted.presses.tolist()
    assert (trial.reason, trial.displayed) == (wanted.reason, wanted.displayed)
    assert {step.action_source for step in trial.steps} == {"planner"}


def test_a_trial_that_a_crash_cut_goes_on_to_the_same_end(tmp_path: Path, minds: Minds) -> None:
    whole, cut = tmp_path / "whole.jsonl", tmp_path / "cut.jsonl"
    played(whole, PlannerPilot(minds, ROBOT), LOCKSTEP, simulated_teacher(1))
    [wanted] = read_trials(whole)
    lines = whole.read_bytes().splitlines(keepends=True)
    steps = [number for number, line in enumerate(lines) if b'"type":"step"' in line]
    kept = steps[len(steps) // 2]
    cut.write_bytes(b"".join(lines[: kept + 1]))
    [begun] = read_trials(cut)

    def act(trial: TrialRun, frame: Frame) -> None:
        if wanted.steps[frame.t].pressed:
            trial.press(n=frame.t + 1)
        trial.done("teacher", frame.t)

    writer = TrialWriter(begun, kept + 1)
    played(cut, PlannerPilot(minds, ROBOT), LOCKSTEP, act, writer)
    [trial] = read_trials(cut)
    assert trial.actions == wanted.actions
    assert trial.reason == wanted.reason
    assert [event["type"] for event in trial.events if event.get("type") == "resume"] == ["resume"]
    assert validate(cut).ok


def test_ticks_keep_to_deadlines_from_the_start_so_that_lateness_does_not_add_up(
    tmp_path: Path, minds: Minds
) -> None:
    run, _ = played(tmp_path / "a", OperatorPilot(WORLD), QUICK, lambda trial, frame: None)
    [trial] = read_trials(tmp_path / "a")
    assert trial.reason == "timeout"
    onsets = [step.timing["onset"] for step in trial.steps if step.timing]
    late = [step.timing["late_ms"] for step in trial.steps if step.timing]
    assert len(onsets) == 20
    for t, (onset, ms) in enumerate(zip(onsets, late, strict=True)):
        assert onset == pytest.approx(50.0 * t + (ms if ms < 250 else 0), abs=0.002)
    assert run.clock.summary()["ticks"] == 20
    [summary] = [event for event in trial.events if event["kind"] == "timing"]
    assert summary["late_ms_max"] == pytest.approx(max(late[1:]), abs=30.0)
    assert (summary["ticks"], summary["missed"], summary["teacher_rtt_ms"]) == (20, 0, 1.5)


def test_a_press_belongs_to_the_step_in_which_it_came_and_several_are_one(tmp_path: Path) -> None:
    def act(trial: TrialRun, frame: Frame) -> None:
        for _ in range({3: 1, 7: 3}.get(frame.t, 0)):
            trial.press(n=1)

    played(tmp_path / "a", OperatorPilot(WORLD), QUICK, act)
    [trial] = read_trials(tmp_path / "a")
    assert np.flatnonzero(trial.presses).tolist() == [3, 7]
    assert [event["t"] for event in trial.events if event["kind"] == "press"] == [3, 7, 7, 7]


def test_an_operator_controls_the_robot_and_steps_without_a_choice_are_default(tmp_path: Path) -> None:
    script = {0: "light_on(1)", 2: "pick_up(1)", 4: "slide(1, 4, 2)", 6: "final"}
    pilot = OperatorPilot(WORLD)
    refused: list[bool] = []

    def act(trial: TrialRun, frame: Frame) -> None:
        async def choose() -> None:
            refused.append(pilot.choose("release(3)"))
            if frame.t in script:
                assert pilot.choose(script[frame.t])

        asyncio.get_running_loop().create_task(choose())

    _, hall = played(tmp_path / "a", pilot, QUICK, act)
    [trial] = read_trials(tmp_path / "a")
    assert [str(step.action) for step in trial.steps] == [
        "noa",
        "light_on(1)",
        "noa",
        "pick_up(1)",
        "noa",
        "slide(1, 4, 2)",
        "noa",
    ]
    assert [step.action_source for step in trial.steps] == ["default", "operator"] * 3 + ["default"]
    assert (trial.reason, tuple(trial.displayed or ())) == ("final", (1, 2, 4))
    assert not any(refused)
    assert (hall.frames[-1].final, hall.frames[-1].state) == ([1, 2, 4], "over")


def test_a_planner_that_is_late_is_not_waited_for(tmp_path: Path, minds: Minds) -> None:
    class Slow(PlannerPilot):
        """Has thought of nothing by the end of any step."""

        def look(self, steps: object, action: object, state: object) -> None:
            if action is None:
                super().look(steps, action, state)  # type: ignore[arg-type]
            else:
                self._thoughts = {}

    run, _ = played(tmp_path / "a", Slow(minds, ROBOT), QUICK, lambda trial, frame: None)
    [trial] = read_trials(tmp_path / "a")
    assert [step.action_source for step in trial.steps] == ["planner"] + ["default"] * 19
    assert {str(step.action) for step in trial.steps[1:]} == {"noa"}
    assert run.defaults == 19


def test_while_the_teacher_is_away_the_key_is_not_recorded_then_the_clock_pauses(tmp_path: Path) -> None:
    def act(trial: TrialRun, frame: Frame) -> None:
        if frame.t == 5:
            trial.teacher_away()
            asyncio.get_running_loop().call_later(0.3, trial.teacher_back)

    _, hall = played(tmp_path / "a", OperatorPilot(WORLD), QUICK, act)
    [trial] = read_trials(tmp_path / "a")
    assert trial.num_steps == 20
    lost = np.flatnonzero(~trial.recorded).tolist()
    assert lost[0] == 5
    assert 2 <= len(lost) <= 4  # `grace` is two steps
    assert "pause" in {frame.state for frame in hall.frames}
    kinds = [event["kind"] for event in trial.events]
    assert [kind for kind in kinds if kind != "timing"] == ["away", "pause", "back", "go_on"]


def test_a_teacher_who_stays_away_ends_the_trial(tmp_path: Path) -> None:
    played(
        tmp_path / "a",
        OperatorPilot(WORLD),
        QUICK,
        lambda trial, frame: trial.teacher_away() if frame.t == 5 else None,
    )
    [trial] = read_trials(tmp_path / "a")
    assert trial.reason == "aborted"
    assert trial.num_steps < 12


def test_pause_and_abort_are_obeyed_at_the_next_tick(tmp_path: Path) -> None:
    def act(trial: TrialRun, frame: Frame) -> None:
        if frame.t == 5:
            trial.order("pause")
            asyncio.get_running_loop().call_later(0.2, trial.order, "go_on")
        if frame.t == 10:
            trial.order("abort")

    played(tmp_path / "a", OperatorPilot(WORLD), QUICK, act)
    [trial] = read_trials(tmp_path / "a")
    assert (trial.reason, trial.num_steps) == ("aborted", 11)
    assert trial.recorded.all()


def test_a_stall_lengthens_one_step_and_makes_no_short_ones(tmp_path: Path) -> None:
    shown: list[float] = []

    def act(trial: TrialRun, frame: Frame) -> None:
        shown.append(time.monotonic())
        if frame.t == 5:
            asyncio.get_running_loop().call_later(0.01, stall, trial)

    def stall(trial: TrialRun) -> None:
        """With a press in it, which is read some turns of the loop later."""
        time.sleep(0.4)
        press_after(4, trial)

    def press_after(turns: int, trial: TrialRun) -> None:
        if turns:
            asyncio.get_running_loop().call_soon(press_after, turns - 1, trial)
        else:
            trial.press(n=1)

    run, _ = played(tmp_path / "a", OperatorPilot(WORLD), QUICK, act)
    [trial] = read_trials(tmp_path / "a")
    assert shown[7] - shown[6] >= 0.02  # no burst: half a step, and the clock's own unsteadiness
    late = [step.timing["late_ms"] for step in trial.steps if step.timing]
    onsets = [step.timing["onset"] for step in trial.steps if step.timing]
    assert late[6] >= 250
    assert np.flatnonzero(trial.presses).tolist() == [5]
    assert onsets[6] == 300
    stalls = [event for event in trial.events if event["kind"] == "stall"]
    assert {"kind": "stall", "t": 5, "ms": late[6]}.items() <= stalls[0].items()
    assert run.clock.summary()["missed"] == sum(ms >= 50 for ms in late)


@pytest.mark.parametrize("away", [False, True])
def test_what_comes_in_the_countdown_holds_up_the_first_step(tmp_path: Path, away: bool) -> None:
    counted = replace(QUICK, countdown=1)

    async def run() -> None:
        journal = Journal()
        hall = Hall()
        trial = TrialRun(
            TrialWriter(head(dt=0.05)),
            OperatorPilot(WORLD),
            lambda line: journal.append(tmp_path / "a", line),
            hall,
            counted,
        )
        later = asyncio.get_running_loop().call_later
        hold = trial.teacher_away if away else lambda: trial.order("pause")
        go_on = trial.teacher_back if away else lambda: trial.order("go_on")
        later(0.2, hold)
        later(1.3, go_on)
        try:
            await trial.run()
        finally:
            journal.close()
        modes = [frame.state for frame in hall.frames]
        assert modes[:4] == ["count", "pause", "count", "run"]
        assert [frame.t for frame in hall.frames[:4]] == [-1, -1, -1, 0]

    asyncio.run(run())
    [trial] = read_trials(tmp_path / "a")
    assert trial.num_steps == 20
    assert trial.recorded.all()


def test_what_is_chosen_in_a_pause_is_not_said_to_count(tmp_path: Path) -> None:
    held: dict[str, bool] = {}

    def act(trial: TrialRun, frame: Frame) -> None:
        later = asyncio.get_running_loop().call_later
        held[f"step {frame.t}"] = trial.held
        if frame.t == 5:
            trial.order("pause")
            later(0.15, lambda: held.update(pause=trial.held))
            later(0.2, trial.order, "go_on")

    played(tmp_path / "a", OperatorPilot(WORLD), QUICK, act)
    assert held.pop("pause")
    assert not any(held.values())


def test_a_planner_whose_process_is_killed_is_back_within_the_trial(tmp_path: Path) -> None:
    minds = Minds([ROBOT])
    minds.warm_up()
    [process] = minds.processes()

    def act(trial: TrialRun, frame: Frame) -> None:
        if frame.t == 3:
            os.kill(process, signal.SIGKILL)
        if (
            frame.t > 10
            and minds.processes() != [process]
            and trial.writer.steps[-1].action_source == "planner"
        ):
            trial.order("abort")

    try:
        played(tmp_path / "a", PlannerPilot(minds, ROBOT), replace(QUICK, step=0.2, limit=150), act)
    finally:
        minds.close()
    [trial] = read_trials(tmp_path / "a")
    sources = [step.action_source for step in trial.steps]
    assert trial.reason == "aborted"
    assert sources[:3] == ["planner"] * 3
    assert "default" in sources
    assert {str(step.action) for step in trial.steps if step.action_source == "default"} == {"noa"}
    assert minds.replaced == 1


def test_a_trial_begins_without_a_planner_that_does_not_answer(tmp_path: Path, minds: Minds) -> None:
    class Mute(PlannerPilot):
        """Never done with any thought."""

        def _asked(self, history: object) -> "Future[Thought]":
            return Future()

    began = time.monotonic()
    played(tmp_path / "a", Mute(minds, ROBOT), QUICK, lambda trial, frame: None)
    [trial] = read_trials(tmp_path / "a")
    assert {step.action_source for step in trial.steps} == {"default"}
    assert time.monotonic() - began < 5


def test_a_log_that_cannot_be_written_stops_the_trial(tmp_path: Path) -> None:
    async def run() -> None:
        journal = Journal()
        written = 0

        def append(line: bytes) -> "asyncio.Future[None]":
            nonlocal written
            written += 1
            path = tmp_path / "a" if written < 6 else tmp_path / "no" / "folder"
            return journal.append(path, line)

        trial = TrialRun(TrialWriter(head(dt=0.05)), OperatorPilot(WORLD), append, Hall(), QUICK)
        try:
            with pytest.raises(StorageError, match="cannot be written"):
                await trial.run()
            await asyncio.sleep(0.1)  # for what the journal has yet to say of the lines after the first lost
        finally:
            journal.close()

    asyncio.run(run())
    [trial] = read_trials(tmp_path / "a")
    assert (trial.reason, trial.num_steps) == (None, 4)
