"""Compiled sums over a `Lattice`: expected log-probabilities and their rates. Arrays in, arrays out."""

import math
from typing import Any

from taskcomm.compiling import kernel

SMALL = 1e-200
NEGLIGIBLE = 1e-14
NEGLIGIBLE_REASON = 1e-12  # a reason less probable than this shall not bar the way of a level to 0

_kernel = kernel(__name__, "the passes of the fit", _nrt=False, error_model="numpy")


@_kernel
def expected(
    lattice: Any, courses: Any, first: int, last: int, mistake: float, peak: Any, share: Any, waiting: Any,
    before: Any, scale: Any, memory: Any, press: Any, as_counts: bool, spread: Any, by_share: Any,
    answer: Any,
) -> None:  # fmt: skip
    """Sum of weight * log P over steps, and its rates.

    `memory[s]` weighs the steps before the event in memory s. With `as_counts`, `press[s, state]` is
    the weight of M = state at the event that ends s, and the sum is taken; without, it is the rate in P
    itself (`flow` of the backward pass), and there is no sum. Writes the rates in P(M_t = m) to
    `by_share` (one for each level of the lines) and to `answer` (2,) the sum and the rate in mistake.
    `spread` has room for a number for each cell of the courses.
    """
    states = len(peak)
    value, by_mistake = 0.0, 0.0
    begin_course, end_course = courses.unit_courses[first], courses.unit_courses[last]
    for c in range(courses.course_at[begin_course], courses.course_at[end_course]):
        spread[c] = 0.0
    for i in range(courses.line_at[courses.unit_lines[first]], courses.line_at[courses.unit_lines[last]]):
        by_share[i] = 0.0
    for layer in range(lattice.unit_layers[first], lattice.unit_layers[last]):
        begin, end = lattice.layer_first[layer], lattice.layer_press[layer]
        for s in range(lattice.layer_memories[layer], lattice.layer_memories[layer + 1]):
            cell, weight = courses.memory_cell[s], memory[s]
            if weight > NEGLIGIBLE and end > begin:
                spread[cell + begin] += weight
                spread[cell + end] -= weight
                if as_counts:
                    lost = scale[cell + end] - scale[cell + begin]
                    value += weight * (lost + math.log(before[cell + end] / before[cell + begin]))
            for state in range(states + 2):
                rate = press[s, state]
                if rate <= NEGLIGIBLE:
                    continue
                if as_counts:
                    if rate <= NEGLIGIBLE_REASON:
                        continue
                    p = mistake
                    if state > 1:
                        p = peak[state - 2] * share[courses.cell_level[cell + end, state - 2]]
                    elif state == 0:
                        p = waiting[cell + end]
                    value += rate * math.log(p) if p > 0.0 else -math.inf
                    rate = rate / p if p > 0.0 else math.inf
                if state > 1:
                    by_share[courses.cell_level[cell + end, state - 2]] += rate
                elif state == 1:
                    by_mistake += rate
                else:
                    by_mistake -= rate
                    for m in range(states):
                        by_share[courses.cell_level[cell + end, m]] -= rate
    for k in range(begin_course, end_course):
        weight = 0.0
        for c in range(courses.course_at[k], courses.course_at[k + 1]):
            weight += spread[c]
            if weight > NEGLIGIBLE:
                rate = weight / waiting[c]
                by_mistake -= rate
                for m in range(states):
                    by_share[courses.cell_level[c, m]] -= rate
    answer[0] = value
    answer[1] = by_mistake


@_kernel
def collapse(
    lattice: Any,
    courses: Any,
    first: int,
    last: int,
    peak: Any,
    share: Any,
    slope: Any,
    by_share: Any,
    rates: Any,
) -> None:
    """Rates in peak, rise, fall, delay, decay and hold, (6, M), from those in P(M_t = m) = peak * share."""
    for k in range(rates.shape[0]):
        for m in range(rates.shape[1]):
            rates[k, m] = 0.0
    for line in range(courses.unit_lines[first], courses.unit_lines[last]):
        m = lattice.track_state[courses.line_track[line]]
        by_peak = by_rise = by_fall = by_delay = by_decay = by_hold = 0.0
        for i in range(courses.line_at[line], courses.line_at[line + 1]):
            rate = by_share[i]
            if rate != 0.0:
                by_peak += rate * share[i]
                by_rise += rate * slope[0, i]
                by_fall += rate * slope[1, i]
                by_delay += rate * slope[2, i]
                by_decay += rate * slope[3, i]
                by_hold += rate * slope[4, i]
        rates[0, m] += by_peak
        for k, by_time in enumerate((by_rise, by_fall, by_delay, by_decay, by_hold)):
            rates[1 + k, m] += by_time * peak[m]


@_kernel
def informed(
    lattice: Any,
    courses: Any,
    share: Any,
    slope: Any,
    memory: Any,
    press: Any,
    steps: Any,
    presses: Any,
    reached: Any,
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
                    at = courses.cell_level[courses.memory_cell[s] + t, m]
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
