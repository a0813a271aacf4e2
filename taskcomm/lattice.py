"""The memory of one trial as a lattice of last resets (MODEL.md, sections 5 and 7).

Given a task, the hidden memory of a teacher is which event was the last to reset each approval state. An
event is a step whose observation leaves it open what M was: a press, or a step whose key state is unknown.
The memory changes only there, so a trial is a row of layers: between two events the memory is constant,
and each event, with no reset or with that of one approval, leads to a memory of the next layer. The
lattice depends on the parameters only through an `Extent`, so that it is built once and used for every
set of parameters within it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from taskcomm.beam import Beam, Ray
from taskcomm.teacher import Parameters

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

MAX_MEMORIES = 200_000
SLACK = 1e-9
LEAST_LOG = -700.0  # exp of less may be 0


class LatticeTooLarge(ValueError):
    """More memories, summed over the layers of one trial under one task, than a bound allows."""


@dataclass(frozen=True)
class Extent:
    """The parameters for which a lattice holds: longest rise and fall (s), and the lags of the cues.

    Arrays over the M approval states. A cue read with delay d at step t is c[t - n - 1] and c[t - n];
    `least_late` and `most_late` bound those lags in steps. `decays` says where the probability also
    depends on how long the cue has been on; `rest_steps` is how many steps after a press no approval
    can follow.
    """

    rise: Floats
    fall: Floats
    least_late: Ints
    most_late: Ints
    decays: Bools
    rest_steps: int

    @classmethod
    def of(cls, parameters: Parameters) -> Self:
        """The extent that holds one model alone: the smallest lattice."""
        p = parameters
        most = p.steps_late + (p.part_late > 0)
        return cls(p.rise, p.fall, p.steps_late, most, np.isfinite(p.decay), p.rest_steps)

    @property
    def lag(self) -> int:
        """The most steps late that a cue may be read, for the rates in the delay too."""
        return int(self.most_late.max()) + 1


class Lattice(NamedTuple):
    """Lattices of several units, a unit being one trial under one task, as flat arrays.

    `cues` holds the cue of each (unit, approval) over time, `rests` each unit's steps in which no
    approval can happen. A *track* is the level of one approval since one reset: approval
    `track_state`, from step `track_first` for `track_length` steps, stored from `track_at`; its cue is
    `cues[track_cue + t]`, its rest `rests[track_rest + t]`. Layer l spans the steps from `layer_first`
    up to its event at `layer_press` (or the end of the trial, for the last of a unit) and holds the
    memories `layer_memories[l]` to `layer_memories[l + 1]`. In memory s approval m is on track
    `memory_track[s, m]`, its level at step t stored at `memory_base[s, m] + t`; s goes to memory
    `memory_next[s, reset]` at the event: reset 0 is none (waiting or mistake), 1 + m that of approval m,
    and -1 says that it cannot happen. `event_log[l]` (2 + M) is ln P(observation | M) at the event, columns
    as `mental_states`, less its greatest; `event[l]` is exp(event_log[l] - event_scale[l]), where the forward
    pass moves the scale from 0 as far as the states that are possible are less probable than the greatest.
    Unit u has the layers `unit_layers[u]` to `unit_layers[u + 1]` and
    the tracks `unit_tracks[u]` to `unit_tracks[u + 1]`; `unit_constant[u]` is the log-probability, in nats,
    of what its observations say of no memory. `unit_dropped[u]` bounds what memories that were left out
    as too improbable add to the log-likelihood, at the parameters that they were judged by. No cue is
    seen more than `lag` steps late.
    """

    cues: NDArray[np.uint8]
    rests: NDArray[np.uint8]
    track_state: Ints
    track_first: Ints
    track_length: Ints
    track_at: Ints
    track_cue: Ints
    track_rest: Ints
    layer_first: Ints
    layer_press: Ints
    layer_memories: Ints
    memory_track: Ints
    memory_base: Ints
    memory_next: Ints
    unit_layers: Ints
    unit_tracks: Ints
    event: Floats
    event_log: Floats
    event_scale: Floats
    unit_constant: Floats
    unit_dropped: Floats
    lag: int

    @property
    def size(self) -> int:
        """How many levels all the tracks hold."""
        return int(self.track_length.sum())

    def observe(self, layers: Ints, logs: Floats) -> None:
        """Set `event_log` of some layers to `logs` (layers, 2 + M), and what follows from it."""
        self.event_log[layers], self.event_scale[layers] = logs, 0.0
        self.event[layers] = np.exp(logs)


class Unit(NamedTuple):
    """The lattice of one trial under one task, to be joined; fields as in `Lattice`."""

    cues: NDArray[np.uint8]
    rests: NDArray[np.uint8]
    track_state: Ints
    track_first: Ints
    track_length: Ints
    layer_first: Ints
    layer_press: Ints
    layer_sizes: Ints
    memory_track: Ints
    memory_next: Ints
    event_log: Floats
    constant: float
    dropped: float
    lag: int


def _runs(flags: Bools) -> Ints:
    """How many steps up to and with each step the flag has been set without a break, down axis 0."""
    steps = np.arange(1, len(flags) + 1)[:, None]
    return np.asarray(steps - np.maximum.accumulate(np.where(flags, 0, steps), axis=0), dtype=np.int64)


def _late_cues(cues: Bools, extent: Extent) -> tuple[Bools, Bools]:
    """Where the late cue is off, and on, throughout a step whatever the delay, each (T, M)."""
    off, on = np.ones_like(cues), np.ones_like(cues)
    for m in range(cues.shape[1]):
        for late in range(int(extent.least_late[m]), int(extent.most_late[m]) + 1):
            seen = np.zeros(len(cues), dtype=np.bool_)
            seen[late:] = cues[: len(cues) - late, m] if late < len(cues) else False
            off[:, m] &= ~seen
            on[:, m] &= seen
    return off, on


def _last_true(flags: Bools) -> Ints:
    """The last step up to and with each step at which the flag was set, -1 if none, down axis 0."""
    steps = np.arange(len(flags))[:, None]
    return np.asarray(np.maximum.accumulate(np.where(flags, steps, -1), axis=0), dtype=np.int64)


class _Certainty(NamedTuple):
    """What holds for every parameter of an extent, each (T, M), by step.

    `zero`: the level is 0; `off_run`: steps the late cue has been off; `forgets`: resets up to this
    step (-1: none) make no difference any more.
    """

    zero: Bools
    off_run: Ints
    forgets: Ints


def _certainty(cues: Bools, extent: Extent, dt: float) -> _Certainty:
    off, on = _late_cues(cues, extent)
    off_run, on_run = _runs(off), _runs(on)
    steps = np.arange(1, len(cues) + 1)[:, None]
    zero = (off_run * dt >= extent.fall * (1 + SLACK)) | (off_run == steps)
    # A level is 1 for certain once its cue has been on, since the reset too, for the longest rise.
    needed = np.ceil(extent.rise * (1 + SLACK) / dt).astype(np.int64)
    full = np.maximum.accumulate(np.where(on_run >= needed, steps - 1 - needed, -1), axis=0)
    # With decay, the time the cue has been on also remembers a reset, until the cue goes off.
    settled = _last_true(off)
    kept = np.take_along_axis(full, np.maximum(settled, 0), axis=0)
    full = np.where(extent.decays, np.where(settled >= 0, kept, -1), full)
    return _Certainty(zero, off_run, np.maximum(_last_true(zero), full))


def _unique_rows(rows: Ints, base: int) -> tuple[Ints, Ints]:
    """The distinct rows in order, and where each row went; entries lie in [0, base)."""
    code = np.zeros(len(rows), dtype=np.int64)
    for m in range(rows.shape[1]):
        if base ** (m + 1) >= 1 << 62:
            code = np.unique(code, return_inverse=True)[1]
        code = code * base + rows[:, m]
    _, index, inverse = np.unique(code, return_index=True, return_inverse=True)
    return rows[index], inverse.astype(np.int64)


def press_logs(presses: Bools, states: int) -> Floats:
    """ln P(observation | M) where the key neither misses nor fires by itself: shape (T, 2 + M)."""
    logs = np.zeros((len(presses), 2 + states))
    logs[presses, 0] = -np.inf
    logs[~presses, 1:] = -np.inf
    return logs


def relative(logs: Floats) -> tuple[Floats, Floats]:
    """Logarithms less the greatest of their row, -inf where all are, and the greatest, each (rows, 1)."""
    greatest = logs.max(axis=1, keepdims=True, initial=-np.inf)
    return logs - np.where(np.isfinite(greatest), greatest, 0.0), greatest


def build_unit(
    cues: Bools,
    presses: Bools,
    extent: Extent,
    dt: float,
    most: int = MAX_MEMORIES,
    logs: Floats | None = None,
    beam: Beam | None = None,
) -> Unit:
    """The lattice of one trial under one task: `cues` (T, M), `presses` (T,).

    `logs` (T, 2 + M) is ln P(observation | M), by default that of the presses alone; rest follows `presses`.
    Resets that give the same levels for every parameter within the extent are one, and a reset of a
    level that is certainly 0 does not happen. With a `beam` memories that are too improbable are left
    out. Raises LatticeTooLarge past `most` memories, ValueError for an observation that no parameters
    within the extent allow.
    """
    steps, states = cues.shape
    logs = press_logs(presses, states) if logs is None else logs
    weights = np.where(np.isfinite(logs), np.exp(np.maximum(relative(logs)[0], LEAST_LOG)), 0.0)
    certain = _certainty(cues, extent, dt)
    events = np.flatnonzero(weights[:, 1:].any(axis=1))
    resets = np.concatenate([[-1], events])
    rests = np.zeros(steps, dtype=np.uint8)
    for step in np.flatnonzero(presses):
        rests[step + 1 : step + 1 + extent.rest_steps] = 1
    ray = None if beam is None else Ray(beam, cues, rests, weights, events)
    layers, moves, last_use = [], [], np.full((states, len(resets)), -1, dtype=np.int64)  # -1: never
    memories, count = np.zeros((1, states), dtype=np.int64), 0
    for k in range(len(resets)):
        layers.append(memories)
        count += len(memories)
        if count > most:
            raise LatticeTooLarge(
                f"more than {most} memories by event {k} of {len(events)} (step {resets[k]} of {steps}): too"
                " many presses, or key states that are unknown, while levels rise and fall; shorter bounds on"
                " rise, fall and delay make a trial smaller"
            )
        end = events[k] + 1 if k < len(events) else steps
        for m in range(states):
            last_use[m, memories[:, m]] = end
        if k < len(events):
            memories, move = _after(memories, k, resets, certain, weights, rests)
            if ray is not None:
                memories, move = ray.pruned(layers[-1], k, memories, move)
            moves.append(move)
    if ray is not None:
        ray.finish(memories)
    return _assemble(cues, resets, layers, moves, last_use, rests, logs, ray, extent.lag)


def _after(
    memories: Ints, k: int, resets: Ints, certain: _Certainty, weights: Floats, rests: NDArray[np.uint8]
) -> tuple[Ints, Ints]:
    """The memories after event k + 1, and where each old memory goes with each reset."""
    step, states = int(resets[k + 1]), memories.shape[1]
    off_run = certain.off_run[step]
    possible = ~certain.zero[step] & (step - resets[memories] > off_run) & (not rests[step])
    possible &= weights[step, 2:] > 0
    kept = np.arange(len(memories)) if weights[step, :2].any() else np.zeros(0, dtype=np.int64)
    rows, sources = [memories[kept]], [kept]
    for m in range(states):
        source = np.flatnonzero(possible[:, m])
        after = memories[source]
        # A reset while the cue is off, since an earlier event, leaves the same level 0 as that one.
        after[:, m] = 1 + np.searchsorted(resets[1:], step - off_run[m])
        rows.append(after)
        sources.append(source)
    every = np.concatenate(rows)
    if not len(every):
        raise ValueError(f"what was observed in step {step} is impossible for all parameters in bounds")
    every[resets[every] <= certain.forgets[step]] = 0
    after, where = _unique_rows(every, len(resets))
    move = np.full((len(memories), states + 1), -1, dtype=np.int64)
    at = 0
    for reset, source in enumerate(sources):
        move[source, reset] = where[at : at + len(source)]
        at += len(source)
    return after, move


def _assemble(
    cues: Bools,
    resets: Ints,
    layers: list[Ints],
    moves: list[Ints],
    last_use: Ints,
    rests: NDArray[np.uint8],
    logs: Floats,
    ray: Ray | None,
    lag: int,
) -> Unit:
    steps = len(cues)
    sizes = np.array([len(layer) for layer in layers], dtype=np.int64)
    starts = np.concatenate([[0], np.cumsum(sizes)])
    state, reset = np.nonzero(last_use >= 0)
    track = np.zeros_like(last_use)
    track[state, reset] = np.arange(len(state))
    memories = np.concatenate(layers)
    after = np.full((len(memories), cues.shape[1] + 1), -1, dtype=np.int64)
    for k, move in enumerate(moves):
        after[starts[k] : starts[k + 1]] = np.where(move >= 0, move + starts[k + 1], -1)
    event_log, constant = weigh(logs, resets[1:])
    return Unit(
        cues=np.ascontiguousarray(cues.T).astype(np.uint8),
        rests=rests,
        track_state=state.astype(np.int64),
        track_first=resets[reset] + 1,
        track_length=last_use[state, reset] - resets[reset] - 1,
        layer_first=resets + 1,
        layer_press=np.append(resets[1:], steps),
        layer_sizes=sizes,
        memory_track=track[np.arange(cues.shape[1]), memories],
        memory_next=after,
        event_log=event_log,
        constant=constant,
        dropped=0.0 if ray is None else ray.bound,
        lag=lag,
    )


def weigh(logs: Floats, events: Ints) -> tuple[Floats, float]:
    """`Lattice.event_log` of the layers of a unit, and what its observations say of no memory, in nats.

    The last layer ends with no event: zeros stand there.
    """
    at_events, greatest = relative(logs[events])
    silent = np.ones(len(logs), dtype=np.bool_)
    silent[events] = False
    return np.vstack([at_events, np.zeros(logs.shape[1])]), float(greatest.sum() + logs[silent, 0].sum())


def join(units: Sequence[Unit]) -> Lattice:
    """Several units as one flat lattice, in order."""

    def starts(lengths: Sequence[int]) -> Ints:
        return np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)

    tracks = starts([len(unit.track_state) for unit in units])
    memories = starts([len(unit.memory_next) for unit in units])
    cue_at, rest_at = starts([unit.cues.size for unit in units]), starts([unit.rests.size for unit in units])
    length = np.concatenate([unit.track_length for unit in units])
    first = np.concatenate([unit.track_first for unit in units])
    at = starts(list(length))[:-1]
    event_log = np.concatenate([unit.event_log for unit in units])
    memory_track = np.concatenate([tracks[u] + unit.memory_track for u, unit in enumerate(units)])
    return Lattice(
        cues=np.concatenate([unit.cues.ravel() for unit in units]),
        rests=np.concatenate([unit.rests for unit in units]),
        track_state=np.concatenate([unit.track_state for unit in units]),
        track_first=first,
        track_length=length,
        track_at=at,
        track_cue=np.concatenate(
            [cue_at[u] + unit.track_state * unit.cues.shape[1] for u, unit in enumerate(units)]
        ),
        track_rest=np.concatenate(
            [np.full(len(unit.track_state), rest_at[u]) for u, unit in enumerate(units)]
        ),
        layer_first=np.concatenate([unit.layer_first for unit in units]),
        layer_press=np.concatenate([unit.layer_press for unit in units]),
        layer_memories=starts([size for unit in units for size in unit.layer_sizes]),
        memory_track=memory_track,
        memory_base=(at - first)[memory_track],
        memory_next=np.concatenate(
            [
                np.where(unit.memory_next >= 0, unit.memory_next + memories[u], -1)
                for u, unit in enumerate(units)
            ]
        ),
        unit_layers=starts([len(unit.layer_first) for unit in units]),
        unit_tracks=tracks,
        event=np.exp(event_log),
        event_log=event_log,
        event_scale=np.zeros(len(event_log)),
        unit_constant=np.array([unit.constant for unit in units]),
        unit_dropped=np.array([unit.dropped for unit in units]),
        lag=max(unit.lag for unit in units),
    )
