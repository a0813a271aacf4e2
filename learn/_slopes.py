"""Compiled sums over a `Lattice`: expected log-probabilities and their rates. Arrays in, arrays out."""

import math
from typing import Any

from taskcomm.compiling import kernel

SMALL = 1e-200
NEGLIGIBLE = 1e-14
NEGLIGIBLE_REASON = 1e-12  # a reason less probable than this shall not bar the way of a level to 0

_kernel = kernel(__name__, "the passes of the fit")


@_kernel
def expected(
    lattice: Any, first: int, last: int, mistake: float, peak: Any, share: Any, memory: Any, press: Any,
    as_counts: bool, by_share: Any, answer: Any,
) -> None:  # fmt: skip
    """Sum of weight * log P over steps, and its rates.

    `memory[s]` weighs the steps before the event in memory s. With `as_counts`, `press[s, state]` is
    the weight of M = state at the event that ends s, and log P of events is summed too; without,
    it is the rate in P itself (`flow` of the backward pass) and the sum is left at the steps before
    events. Writes the rates in P(M_t = m) to `by_share` (one for each level of the tracks) and to
    `answer` (2,) the sum and the rate in mistake.
    """
    states = len(peak)
    value, by_mistake = 0.0, 0.0
    for j in range(lattice.unit_tracks[first], lattice.unit_tracks[last]):
        for i in range(lattice.track_at[j], lattice.track_at[j] + lattice.track_length[j]):
            by_share[i] = 0.0
    for layer in range(lattice.unit_layers[first], lattice.unit_layers[last]):
        begin, end = lattice.layer_first[layer], lattice.layer_press[layer]
        for s in range(lattice.layer_memories[layer], lattice.layer_memories[layer + 1]):
            weight = memory[s]
            if weight > NEGLIGIBLE:
                product, logs = 1.0, 0.0
                for t in range(begin, end):
                    waiting = 1.0 - mistake
                    for m in range(states):
                        waiting -= peak[m] * share[lattice.memory_base[s, m] + t]
                    product *= waiting
                    if product < SMALL:
                        logs += math.log(product)
                        product = 1.0
                    rate = weight / waiting
                    by_mistake -= rate
                    for m in range(states):
                        by_share[lattice.memory_base[s, m] + t] -= rate
                value += weight * (logs + math.log(product))
            for state in range(states + 2):
                weight = press[s, state]
                if weight <= NEGLIGIBLE or (as_counts and weight <= NEGLIGIBLE_REASON):
                    continue
                p = mistake
                if state > 1:
                    p = peak[state - 2] * share[lattice.memory_base[s, state - 2] + end]
                elif state == 0:
                    p = 1.0 - mistake
                    for m in range(states):
                        p -= peak[m] * share[lattice.memory_base[s, m] + end]
                rate = weight
                if as_counts:
                    rate = weight / p if p > 0.0 else math.inf
                    value += weight * math.log(p) if p > 0.0 else -math.inf
                if state > 1:
                    by_share[lattice.memory_base[s, state - 2] + end] += rate
                elif state == 1:
                    by_mistake += rate
                else:
                    by_mistake -= rate
                    for m in range(states):
                        by_share[lattice.memory_base[s, m] + end] -= rate
    answer[0] = value
    answer[1] = by_mistake


@_kernel
def collapse(
    lattice: Any, first: int, last: int, peak: Any, share: Any, slope: Any, by_share: Any, rates: Any
) -> None:
    """Rates in peak, rise, fall, delay, decay and hold, (6, M), from those in P(M_t = m) = peak * share."""
    rates[:] = 0.0
    for j in range(lattice.unit_tracks[first], lattice.unit_tracks[last]):
        m = lattice.track_state[j]
        for i in range(lattice.track_at[j], lattice.track_at[j] + lattice.track_length[j]):
            rates[0, m] += by_share[i] * share[i]
            for k in range(len(slope)):
                rates[1 + k, m] += by_share[i] * slope[k, i] * peak[m]


@_kernel
def informed(
    lattice: Any, share: Any, slope: Any, memory: Any, press: Any, steps: Any, presses: Any, reached: Any
) -> None:
    """Expected steps and presses whose probability each parameter changes, and the highest levels.

    `steps` and `presses` (7, M): rows peak, rise, ..., hold; in the last row, first column, mistake:
    steps in which only a mistake could be the reason, and the expected mistakes. `reached` (M,) is the
    highest level of each approval that a memory of some weight has shown.
    """
    states = len(reached)
    for layer in range(len(lattice.layer_first)):
        begin, end = lattice.layer_first[layer], lattice.layer_press[layer]
        for s in range(lattice.layer_memories[layer], lattice.layer_memories[layer + 1]):
            pressed = 0.0
            for state in range(states + 2):
                pressed += press[s, state]
            presses[6, 0] += press[s, 1]
            for t in range(begin, end + 1):
                weight = memory[s] if t < end else pressed
                if weight <= NEGLIGIBLE:
                    continue
                silent = True
                for m in range(states):
                    at = lattice.memory_base[s, m] + t
                    if share[at] > 0.0:
                        silent = False
                        steps[0, m] += weight
                        if weight > 1e-6:
                            reached[m] = max(reached[m], share[at])
                        if t == end:
                            presses[0, m] += press[s, 2 + m]
                    for k in range(len(slope)):
                        if slope[k, at] != 0.0:
                            steps[1 + k, m] += weight
                            if t == end:
                                presses[1 + k, m] += press[s, 2 + m]
                if silent:
                    steps[6, 0] += weight
