"""A trial: what the robot did, when the teacher pressed, and how it ended."""

from collections import Counter
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import count, islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taskcomm.world import World


@dataclass(frozen=True, slots=True)
class Step:
    """One time step: the robot's action, then whether the spacebar was pressed (None: not recorded).

    `signals` are further observations by the name of their channel. `action_source` is `planner`, `operator`
    or `default`; `mental_state` is known in simulated trials only; `timing` holds onset, late_ms and plan_ms
    where they were measured.
    """

    action: Hashable
    pressed: bool | None
    action_source: str = "planner"
    mental_state: str | None = None
    timing: Mapping[str, float] | None = None
    signals: Mapping[str, str | float] | None = None


@dataclass(frozen=True)
class Trial:
    """A finished or broken-off trial. `dt` is in seconds.

    `task` is the teacher's card, None where unknown. `reason` is `final`, `timeout`, `aborted`, or
    None where the log broke off; `displayed` is the task shown with Final. `robot_model` is {name,
    sha256}, `planner` {horizon, threshold, seed}. `ratings`, `events` and `labels` hold those
    lines of the log as mappings, each with its place `seq` in the trial's lines (without it, it is
    written after all others); a `resume` line is an event of that `type`.
    """

    trial_id: str
    world: World
    task: Any | None
    steps: tuple[Step, ...]
    dt: float = 0.5
    reason: str | None = None
    displayed: Any | None = None
    participant_id: str | None = None
    operator_id: str | None = None
    session: str | None = None
    trial_index: int = 0
    condition: str = "other"
    source: str = "simulated"
    robot_model: Mapping[str, str] | None = None
    planner: Mapping[str, Any] | None = None
    started_utc: str | None = None
    taskcomm_version: str | None = None
    ratings: tuple[Mapping[str, Any], ...] = ()
    events: tuple[Mapping[str, Any], ...] = ()
    labels: tuple[Mapping[str, Any], ...] = field(default=())

    @property
    def num_steps(self) -> int:
        """Number of observations; time to the end is num_steps * dt."""
        return len(self.steps)

    @property
    def duration(self) -> float:
        """Length in seconds."""
        return self.num_steps * self.dt

    @property
    def correct(self) -> bool | None:
        """Whether Final showed the teacher's task; a timeout is not correct; None if unknown."""
        if self.reason == "timeout":
            return False
        if self.reason != "final" or self.task is None:
            return None
        return bool(self.displayed == self.task)

    @property
    def actions(self) -> tuple[Hashable, ...]:
        return tuple(step.action for step in self.steps)

    @property
    def presses(self) -> NDArray[np.bool_]:
        """Whether a press was recorded, shape (num_steps,); False too where the key was not recorded."""
        return np.array([bool(step.pressed) for step in self.steps], dtype=np.bool_)

    @property
    def recorded(self) -> NDArray[np.bool_]:
        """Whether the key state was recorded, shape (num_steps,)."""
        return np.array([step.pressed is not None for step in self.steps], dtype=np.bool_)

    def signals(self, name: str) -> tuple[str | float | None, ...]:
        """The signal of one channel by step, None where it is missing."""
        return tuple((step.signals or {}).get(name) for step in self.steps)

    @property
    def channels(self) -> tuple[str, ...]:
        """The names of the channels with a signal in any step, in the order in which they appear."""
        return tuple(dict.fromkeys(name for step in self.steps for name in step.signals or {}))

    @cached_property
    def states(self) -> tuple[Hashable, ...]:
        """The world state at the end of each step, shape (num_steps,), recomputed from the actions."""
        state, states = self.world.start(), []
        for step in self.steps:
            state = self.world.step(state, step.action)
            states.append(state)
        return tuple(states)

    @property
    def step_seqs(self) -> tuple[int, ...]:
        """The place of each step among the trial's lines: what `press_seq` of a label refers to."""
        extras = (*self.events, *self.ratings, *self.labels)
        taken = {line["seq"] for line in extras if "seq" in line}
        return tuple(islice((seq for seq in count(1) if seq not in taken), self.num_steps))

    @property
    def labelled(self) -> dict[int, dict[str | None, str]]:
        """The mental state behind a press by annotator, by step: of each annotator the last label counts."""
        at = {seq: t for t, seq in enumerate(self.step_seqs)}
        given: dict[int, dict[str | None, str]] = {}
        for label in self.labels:
            given.setdefault(at[label["press_seq"]], {})[label.get("annotator")] = label["mental_state"]
        return given

    @property
    def reasons(self) -> dict[int, str]:
        """Known mental states behind presses, by step: as simulated or, above that, as most annotators say.

        A press of which as many annotators say one thing as another is left out: its reason is not known.
        """
        known = {
            t: step.mental_state for t, step in enumerate(self.steps) if step.pressed and step.mental_state
        }
        for t, said in self.labelled.items():
            known.pop(t, None)
            (state, most), *others = Counter(said.values()).most_common(2)
            if not others or most > others[0][1]:
                known[t] = state
        return known
