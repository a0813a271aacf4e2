"""Simulated teachers draw from the model; trials are reproducible and timed as the model says."""

from typing import Any

import numpy as np
import oracles
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tinyworld import menu

from taskcomm.logs import trial_bytes
from taskcomm.operators import ScriptedOperator
from taskcomm.planner import EntropyPlanner
from taskcomm.robot import Final, Robot
from taskcomm.simulate import SimulatedTeacher, run_trial
from taskcomm.teacher import ModelError, TableTop, TeacherModel
from taskcomm.world import NOA, Action, BallState, BallWorld, InvalidAction

WORLD, MODEL = BallWorld(), TeacherModel.intuitive()
SMALL = BallWorld(num_balls=2, num_distances=2)

table_tops = st.builds(
    TableTop,
    cue=st.sampled_from(BallWorld.cue_names),
    peak=st.floats(0, 0.3),
    rise=st.floats(0.5, 4),
    fall=st.floats(0.5, 4),
    delay=st.floats(0, 2),
    decay=st.none() | st.floats(0.5, 4),
    hold=st.floats(0, 1),
)
models = st.builds(
    TeacherModel,
    mistake=st.floats(0.001, 0.05),
    approvals=st.dictionaries(st.sampled_from(["a", "b", "c"]), table_tops, min_size=1),
    rest=st.sampled_from([0.0, 0.5, 1.2]),
)


class Fixed(np.random.Generator):
    """A generator whose uniform numbers are given."""

    def __init__(self, numbers: list[float]) -> None:
        super().__init__(np.random.PCG64(0))
        self.numbers = numbers

    def random(self, *args: Any, **kwargs: Any) -> Any:
        return self.numbers.pop(0)


class Scripted:
    """A controller that does what its list says, then noa, then Final after `steps` steps."""

    source, dt = "default", 0.5

    def __init__(self, world: Any, actions: list[Any], steps: int, draws: int = 0) -> None:
        self.world, self.actions, self.steps, self.draws = world, actions, steps, draws
        self.description = {"condition": "other"}
        self.heard: list[bool | None] = []

    def reset(self, rng: np.random.Generator | None = None) -> None:
        self.heard = []
        if rng is not None:
            rng.random(self.draws)

    def act(self, pressed: bool | None) -> Any:
        self.heard.append(pressed)
        at = len(self.heard) - 1
        if at == self.steps:
            return Final(self.world.tasks[0])
        return self.actions[at] if at < len(self.actions) else NOA


histories = st.lists(
    st.tuples(st.integers(0, 99), st.integers(0, 4), st.sampled_from([0.001, 0.5, 0.999])), max_size=30
)


@settings(max_examples=150)
@given(models, histories)
def test_the_number_drawn_picks_from_the_models_distribution(
    model: TeacherModel, history: list[tuple[int, int, float]]
) -> None:
    task = 1
    teacher, state = SimulatedTeacher(SMALL, model, SMALL.tasks[task]), SMALL.start()
    states: list[BallState] = []
    path: list[str] = []
    pressed: list[bool] = []
    order = ["mistake", *model.approvals, "waiting"]
    for pick, wanted, part in history:
        actions = SMALL.actions(state)
        state = SMALL.step(state, actions[pick % len(actions)])
        states.append(state)
        cues = oracles.cue_columns(SMALL, model, states, task)
        expected = oracles.probabilities(model, cues, path, pressed)
        likely = [name for name in order if expected[name] > 1e-6]
        name = likely[wanted % len(likely)]
        number = sum(expected[before] for before in order[: order.index(name)]) + part * expected[name]
        press = teacher.observe(state, Fixed([number]))
        assert teacher.mental_state == name
        assert press == (name != "waiting")
        path.append(name)
        pressed.append(press)


def test_one_number_a_step_whatever_happens() -> None:
    rng, other = np.random.default_rng(1), np.random.default_rng(1)
    teacher = SimulatedTeacher(WORLD, MODEL, WORLD.tasks[0], forced={3: "that_mov", 4: "waiting"})
    for _ in range(20):
        teacher.observe(WORLD.start(), rng)
    other.random(20)
    assert rng.random() == other.random()


def test_a_forced_mental_state_happens_and_resets_its_level() -> None:
    lit = WORLD.step(WORLD.start(), Action.parse("light_on(1)"))
    bold = TeacherModel(mistake=0.001, approvals={"that_mov": TableTop("mov_lit", 0.9, 0.5, 0.5)})
    slow = TeacherModel(mistake=0.001, approvals={"that_mov": TableTop("mov_lit", 0.9, 5.0, 5.0)})
    for model, after in ((bold, True), (slow, False)):
        teacher = SimulatedTeacher(WORLD, model, WORLD.tasks[0], forced={9: "that_mov", 11: "mistake"})
        seen = [teacher.observe(lit, Fixed([0.95 if t < 10 else 0.5])) for t in range(12)]
        assert seen[9:] == [True, after, True]
        assert teacher.mental_state == "mistake"
        assert not any(seen[:9])


def test_a_reset_begins_the_decay_of_the_plateau_anew() -> None:
    lit = WORLD.step(WORLD.start(), Action.parse("light_on(1)"))
    tired = TeacherModel(mistake=0.001, approvals={"that_mov": TableTop("mov_lit", 0.3, 0.5, 0.5, decay=1.0)})
    for forced, pressed in (({7: "that_mov"}, True), ({}, False)):
        teacher = SimulatedTeacher(WORLD, tired, WORLD.tasks[0], forced=forced)
        seen = [teacher.observe(lit, Fixed([0.999 if t < 8 else 0.1])) for t in range(9)]
        assert seen[8] is pressed  # 0.3 exp(-0.5) = 0.18 after a reset, 0.3 exp(-4.5) = 0.003 without


def test_refuses_what_does_not_exist() -> None:
    with pytest.raises(ValueError, match="task: pizza is none of the 24 tasks"):
        SimulatedTeacher(WORLD, MODEL, "pizza")
    with pytest.raises(ValueError, match="forced: unknown mental state 'bored'"):
        SimulatedTeacher(WORLD, MODEL, WORLD.tasks[0], forced={0: "bored"})
    with pytest.raises(ModelError, match="unknown cue"):
        SimulatedTeacher(menu()[0], MODEL, "pizza")


def test_a_trial_alternates_action_world_press() -> None:
    actions = [Action.parse(text) for text in ("light_on(1)", "light_off(1)", "pick_up(2)")]
    controller = Scripted(WORLD, actions, steps=6)
    teacher = SimulatedTeacher(WORLD, MODEL, WORLD.tasks[0], forced={1: "mistake", 5: "that_dist"})
    trial = run_trial(controller, teacher, np.random.default_rng(2), participant_id="p", condition="mine")
    assert trial.actions == (*actions, NOA, NOA, NOA)
    assert controller.heard == [None, *trial.presses]
    assert trial.presses[1]
    assert trial.presses[5]
    assert trial.reasons[5] == "that_dist"
    assert (trial.num_steps, trial.duration) == (6, 3.0)
    assert (trial.reason, trial.displayed, trial.correct) == ("final", WORLD.tasks[0], True)
    assert (trial.condition, trial.source, trial.participant_id) == ("mine", "simulated", "p")
    assert trial.started_utc is None


def test_a_wrong_final_is_not_correct_and_a_timeout_neither() -> None:
    wrong = SimulatedTeacher(WORLD, MODEL, WORLD.tasks[5])
    assert run_trial(Scripted(WORLD, [], 4), wrong, np.random.default_rng(0)).correct is False
    late = run_trial(Scripted(WORLD, [], 99), wrong, np.random.default_rng(0), max_steps=7)
    assert (late.num_steps, late.reason, late.displayed, late.correct) == (7, "timeout", None, False)
    in_time = run_trial(Scripted(WORLD, [], 7), wrong, np.random.default_rng(0), max_steps=7)
    assert in_time.reason == "final"


def test_the_teachers_luck_does_not_depend_on_the_controllers_draws() -> None:
    teacher = SimulatedTeacher(WORLD, MODEL, WORLD.tasks[0])
    lit = [Action.parse("light_on(1)")]
    presses = [
        run_trial(Scripted(WORLD, lit, 200, draws), teacher, np.random.default_rng(4)).presses.tolist()
        for draws in (0, 1, 50)
    ]
    assert any(presses[0])
    assert presses[0] == presses[1] == presses[2]


@pytest.mark.parametrize("kind", ["robot", "operator"])
def test_a_seed_gives_the_same_bytes(kind: str) -> None:
    def play(seed: int) -> bytes:
        planner = EntropyPlanner(WORLD, MODEL, horizon=1, ties="random")
        robot = ScriptedOperator(WORLD) if kind == "operator" else Robot(WORLD, MODEL, planner)
        teacher = SimulatedTeacher(WORLD, MODEL, WORLD.tasks[7])
        return trial_bytes(run_trial(robot, teacher, np.random.default_rng(seed), max_steps=80))

    assert play(1) == play(1) != play(2)
    assert b'utc":null' in play(1)


def test_trials_of_one_generator_have_ids_of_their_own() -> None:
    rng, teacher = np.random.default_rng(8), SimulatedTeacher(WORLD, MODEL, WORLD.tasks[0])
    names = [run_trial(Scripted(WORLD, [], 2), teacher, rng).trial_id for _ in range(3)]
    assert len(set(names)) == 3
    again = run_trial(Scripted(WORLD, [], 2), teacher, np.random.default_rng(8)).trial_id
    assert again == names[0]


@pytest.mark.parametrize("cues", [1, 3, 5])
def test_trials_run_in_any_world(cues: int) -> None:
    world, model = menu(cues)
    robot = Robot(world, model, EntropyPlanner(world, model, horizon=2))
    trials = [
        run_trial(robot, SimulatedTeacher(world, model, world.tasks[i % 4]), np.random.default_rng([cues, i]))
        for i in range(12)
    ]
    assert sum(bool(trial.correct) for trial in trials) >= 11
    ends: list[Any] = [trial.states[-1] for trial in trials]
    assert [served for _, served in ends] == [trial.displayed for trial in trials]


def test_refuses_controllers_of_another_world_or_time_step_or_without_a_valid_action() -> None:
    rng, teacher = np.random.default_rng(0), SimulatedTeacher(WORLD, MODEL, WORLD.tasks[0])
    with pytest.raises(ValueError, match="in different worlds"):
        run_trial(Scripted(SMALL, [], 2), teacher, rng)
    with pytest.raises(ValueError, match=r"dt is 0.25 s for the controller, 0.5 s for the teacher"):
        run_trial(ScriptedOperator(WORLD, dt=0.25), teacher, rng)
    with pytest.raises(InvalidAction, match=r"step 1: light_off\(2\) is not valid in"):
        run_trial(Scripted(WORLD, [NOA, Action.parse("light_off(2)")], 5), teacher, rng)
    with pytest.raises(ValueError, match="max_steps: must be at least 1, not 0"):
        run_trial(Scripted(WORLD, [], 2), teacher, rng, max_steps=0)
    seed: Any = 7
    with pytest.raises(TypeError, match=r"rng: must be a numpy.random.Generator, such as default_rng\(7\)"):
        run_trial(Scripted(WORLD, [], 2), teacher, rng=seed)
