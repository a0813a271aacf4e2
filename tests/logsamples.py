"""Trials to write: any at all, and one short one."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from taskcomm.logs import (
    trial_bytes,
)
from taskcomm.tasks import Task
from taskcomm.trials import Step, Trial
from taskcomm.world import BallWorld

Lines = list[dict[str, Any]]
texts = st.text(max_size=8)
names = st.text(min_size=1, max_size=8)
json_values = st.recursive(
    st.none() | st.booleans() | st.integers(-9, 9) | texts,
    lambda inner: st.lists(inner, max_size=2) | st.dictionaries(texts, inner, max_size=2),
    max_leaves=4,
)
RESERVED = {"type", "trial_id", "seq"}
free_lines = st.dictionaries(names.filter(lambda key: key not in RESERVED), json_values, max_size=3)
ratings = st.fixed_dictionaries({"item": names, "value": st.integers(1, 10), "scale": st.just([1, 10])})


@st.composite
def trials(draw: st.DrawFn, world: Any = None) -> Trial:
    """Any trial of a BallWorld or of `world`, with events, ratings, labels between its steps."""
    if world is None:
        sizes = draw(st.integers(2, 4)), draw(st.integers(1, 4)), draw(st.booleans())
        world = BallWorld(*sizes)
    state, steps = world.start(), []
    for pick, pressed in draw(
        st.lists(st.tuples(st.integers(0, 99), st.booleans() | st.none()), max_size=12)
    ):
        actions = world.actions(state)
        action = actions[pick % len(actions)]
        state = world.step(state, action)
        source = draw(st.sampled_from(["planner", "operator", "default"]))
        timing = draw(st.none() | st.dictionaries(names, st.floats(-1e9, 1e9), max_size=2))
        signals = draw(st.none() | st.dictionaries(names, texts | st.floats(-1e9, 1e9), max_size=2))
        steps.append(Step(action, pressed, source, draw(st.none() | names), timing, signals))
    reason = draw(st.sampled_from(["final", "timeout", "aborted", None]))
    trial = Trial(
        trial_id=draw(names),
        world=world,
        task=draw(st.none() | st.sampled_from(world.tasks)),
        steps=tuple(steps),
        dt=draw(st.floats(0.01, 10)),
        reason=reason,
        displayed=draw(st.sampled_from(world.tasks)) if reason == "final" else None,
        participant_id=draw(st.none() | texts),
        operator_id=draw(st.none() | texts),
        session=draw(st.none() | texts),
        trial_index=draw(st.integers(0, 99)),
        condition=draw(names),
        source=draw(st.sampled_from(["simulated", "human"])),
        robot_model=draw(st.none() | st.just({"name": "intuitive", "sha256": "0" * 64})),
        planner=draw(st.none() | st.just({"horizon": 5, "threshold": 0.98, "seed": None})),
        taskcomm_version=draw(st.none() | texts),
    )
    return draw(with_extras(trial))


@st.composite
def with_extras(draw: st.DrawFn, trial: Trial) -> Trial:
    events = draw(st.lists(free_lines | free_lines.map(lambda line: line | {"type": "resume"}), max_size=3))
    rated = draw(st.lists(ratings, max_size=2))
    pressed = [t for t, step in enumerate(trial.steps) if step.pressed]
    labelled = draw(st.lists(st.sampled_from(pressed), max_size=2)) if pressed else []
    before_labels = 1 + trial.num_steps + (trial.reason is not None) + len(events) + len(rated)
    middle = draw(st.permutations(range(1, before_labels))) if before_labels > 1 else []
    places = sorted(middle[: len(events) + len(rated)])
    trial = replace(
        trial,
        events=tuple(line | {"seq": seq} for line, seq in zip(events, places, strict=False)),
        ratings=tuple(line | {"seq": seq} for line, seq in zip(rated, places[len(events) :], strict=False)),
    )
    labels = tuple(
        {"press_seq": trial.step_seqs[t], "mental_state": "that_mov", "annotator": "é", "seq": seq}
        for seq, t in enumerate(labelled, before_labels)
    )
    return replace(trial, labels=labels)


def played(trial_id: str = "a") -> Trial:
    """A short trial that ends rightly."""
    world = BallWorld()
    texts = ["light_on(1)", "noa", "pick_up(1)", "slide(1, 4, 2)", "noa"]
    state, steps = world.start(), []
    for text in texts:
        action = next(action for action in world.actions(state) if str(action) == text)
        state = world.step(state, action)
        steps.append(Step(action, text == "noa", "operator", "that_mov" if text == "noa" else "waiting"))
    task = Task(1, 2, 4)
    return Trial(trial_id, world, task, tuple(steps), reason="final", displayed=task, condition="operator")


def lines_of(trial: Trial) -> Lines:
    return [json.loads(line) for line in trial_bytes(trial).splitlines()]


def dump(path: Path, lines: Lines) -> Path:
    path.write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")
    return path
