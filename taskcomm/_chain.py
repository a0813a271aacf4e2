"""Compiled passes over a `Lattice`: levels, forward, backward. Arrays in, arrays out.

Each function takes the units from `first` up to `last` and writes only what belongs to them, so that
ranges of units can run at once. `share` is P(M_t = m) / peak: the level, times the decay of the
plateau, or 0 while the teacher rests.
"""

import math
from typing import Any

from taskcomm.compiling import kernel

SMALL = 1e-200  # a product is folded into its logarithm below
FAR = 1e-50  # so is one, below or above its inverse, that may be multiplied by such a product
FAINT = 1e-150  # an event less probable than that is scaled anew
MOST = 300.0  # the greatest exponent then; a state above it is one that no memory leaves possible

_kernel = kernel(__name__, "the passes over a trial", _nrt=False, error_model="numpy")


@_kernel
def trace(
    lattice: Any, courses: Any, first: int, last: int, dt: float, rise: Any, fall: Any, late: Any,
    part: Any, decay: Any, hold: Any, share: Any, slope: Any,
) -> None:  # fmt: skip
    """Write `share` along lines, and to `slope` (5, levels) its rates in rise, fall, delay, decay, hold.

    Where a level has just reached 0 or 1 the rates are those of staying there; in the delay they are
    those towards a longer one, in the hold those towards a shorter one.
    """
    for line in range(courses.unit_lines[first], courses.unit_lines[last]):
        j = courses.line_track[line]
        m = lattice.track_state[j]
        up, down, n = 1.0 / rise[m], 1.0 / fall[m], late[m]
        early = part[m] * dt
        level = by_rise = by_fall = by_delay = 0.0
        on_time = on_by_delay = 0.0
        at, cue, start = courses.line_at[line], lattice.track_cue[j], lattice.track_first[j]
        rest = lattice.track_rest[j] + start
        for i in range(lattice.track_length[j]):
            t = start + i
            older = t - n - 1 >= 0 and lattice.cues[cue + t - n - 1] > 0
            newer = t - n >= 0 and lattice.cues[cue + t - n] > 0
            if level == 0.0 and not older and not newer:
                on_time = on_by_delay = 0.0
                share[at + i] = 0.0
                for k in range(5):
                    slope[k, at + i] = 0.0
                continue
            halves = 2
            if level == 1.0 and older and newer:  # nothing changes but the time
                on_time += dt
                halves = 0
            for half in range(halves):
                on = older if half == 0 else newer
                seconds = early if half == 0 else dt - early
                stretch = 1.0 if half == 0 else -1.0
                if on:
                    level += seconds * up
                    by_rise -= seconds * up * up
                    by_delay += stretch * up
                    on_time += seconds
                    on_by_delay += stretch
                    if level >= 1.0:
                        level = 1.0
                        by_rise = by_fall = by_delay = 0.0
                else:
                    level -= seconds * down
                    by_fall += seconds * down * down
                    by_delay -= stretch * down
                    if seconds > 0.0:
                        on_time = 0.0
                    on_by_delay = 0.0
                    if level <= 0.0:
                        level = by_rise = by_fall = by_delay = 0.0
            factor, by_decay, by_hold, factor_by_delay = 1.0, 0.0, 0.0, 0.0
            if lattice.rests[rest + i]:
                factor = 0.0
            elif decay[m] < math.inf and on_time > hold[m]:
                factor = math.exp(-(on_time - hold[m]) / decay[m])
                by_hold = level * factor / decay[m]
                by_decay = by_hold * (on_time - hold[m]) / decay[m]
                factor_by_delay = -factor * on_by_delay / decay[m]
            share[at + i] = level * factor
            slope[0, at + i] = by_rise * factor
            slope[1, at + i] = by_fall * factor
            slope[2, at + i] = by_delay * factor + level * factor_by_delay
            slope[3, at + i] = by_decay
            slope[4, at + i] = by_hold


@_kernel
def along(
    lattice: Any, courses: Any, first: int, last: int, mistake: float, peak: Any, share: Any, waiting: Any,
    before: Any, scale: Any,
) -> None:  # fmt: skip
    """Write P(waiting) of every cell, and the probability of waiting in all cells of its course before it.

    The latter is `before` times the exponential of `scale`.
    """
    for k in range(courses.unit_courses[first], courses.unit_courses[last]):
        product, logs = 1.0, 0.0
        for c in range(courses.course_at[k], courses.course_at[k + 1]):
            before[c] = product
            scale[c] = logs
            p = 1.0 - mistake
            for m in range(len(peak)):
                p -= peak[m] * share[courses.cell_level[c, m]]
            waiting[c] = p
            product *= p
            if product < SMALL:
                logs += math.log(product)
                product = 1.0


@_kernel
def _rescale(lattice: Any, layer: int, likeliest: float) -> None:
    """Write `event` of a layer anew: the exponentials of its `event_log` less `likeliest`, in nats."""
    lattice.event_scale[layer] = likeliest
    for state in range(lattice.event.shape[1]):
        lattice.event[layer, state] = math.exp(min(lattice.event_log[layer, state] - likeliest, MOST))


@_kernel
def _likeliest(
    lattice: Any, courses: Any, layer: int, mistake: float, peak: Any, share: Any, waiting: Any, quiet: Any,
    entered: Any,
) -> float:  # fmt: skip
    """The greatest `event_log` of the states that some memory with a weight leaves possible at an event."""
    found, press = -math.inf, lattice.layer_press[layer]
    for s in range(lattice.layer_memories[layer], lattice.layer_memories[layer + 1]):
        if not entered[s] * quiet[s] > 0.0:
            continue
        cell = courses.memory_cell[s] + press
        if lattice.memory_next[s, 0] >= 0:
            if waiting[cell] > 0.0:
                found = max(found, lattice.event_log[layer, 0])
            if mistake > 0.0:
                found = max(found, lattice.event_log[layer, 1])
        for m in range(len(peak)):
            if lattice.memory_next[s, 1 + m] >= 0 and peak[m] * share[courses.cell_level[cell, m]] > 0.0:
                found = max(found, lattice.event_log[layer, 2 + m])
    return found


@_kernel
def forward(
    lattice: Any, courses: Any, first: int, last: int, mistake: float, peak: Any, share: Any, waiting: Any,
    before: Any, scale: Any, quiet: Any, entered: Any, total: Any, log_likelihood: Any,
) -> None:  # fmt: skip
    """Filter forward over the layers; write the log-likelihood of each unit.

    `quiet[s]` is the probability of the steps before the event in memory s, over a number common to its
    layer; `entered[s]` is the weight of memory s when its layer begins; `total[l]` is what the weights of
    layer l summed to when its event came, before they were made to sum to 1. An event all but impossible is
    taken once more, over the likeliest of the states that are possible.
    """
    states = len(peak)
    for u in range(first, last):
        answer, mass = lattice.unit_constant[u], 1.0
        begin = lattice.layer_memories[lattice.unit_layers[u]]
        end = lattice.layer_memories[lattice.unit_layers[u + 1]]
        for s in range(begin, end):
            entered[s] = 0.0
        entered[begin] = 1.0
        for layer in range(lattice.unit_layers[u], lattice.unit_layers[u + 1]):
            begin, end = lattice.layer_memories[layer], lattice.layer_memories[layer + 1]
            start, press = lattice.layer_first[layer], lattice.layer_press[layer]
            best, top = -math.inf, 1.0
            for s in range(begin, end):
                cell = courses.memory_cell[s]
                p, lost = (
                    before[cell + press] / before[cell + start],
                    scale[cell + press] - scale[cell + start],
                )
                quiet[s] = p
                if entered[s] > 0.0 and lost >= best:
                    top = max(top, p) if lost == best else p
                    best = lost
            answer += best
            mass *= top
            if not FAR < mass < 1 / FAR:
                answer += math.log(mass)
                mass = 1.0
            final, weight = layer + 1 == lattice.unit_layers[u + 1], 0.0
            if lattice.event_scale[layer] != 0.0:
                _rescale(lattice, layer, 0.0)
            for attempt in range(2):
                silent, weight = lattice.event[layer, 0], 0.0
                for s in range(begin, end):
                    cell = courses.memory_cell[s]
                    if attempt == 0:
                        p, lost = quiet[s] / top, scale[cell + press] - scale[cell + start]
                        if lost != best:
                            p *= math.exp(min(lost - best, 600.0))
                        quiet[s] = p
                    leaving = entered[s] * quiet[s]
                    if final:
                        weight += leaving
                        continue
                    for reset in range(states + 1):
                        after = lattice.memory_next[s, reset]
                        if after < 0:
                            continue
                        if reset > 0:
                            p = peak[reset - 1] * share[courses.cell_level[cell + press, reset - 1]]
                            p *= lattice.event[layer, 1 + reset]
                        else:
                            p = lattice.event[layer, 1] * mistake
                            if silent > 0.0:
                                p += silent * waiting[cell + press]
                        entered[after] += leaving * p
                        weight += leaving * p
                if attempt == 1 or final or weight > FAINT:
                    break
                likeliest = _likeliest(lattice, courses, layer, mistake, peak, share, waiting, quiet, entered)
                if likeliest == -math.inf:
                    break
                _rescale(lattice, layer, likeliest)
                entered[end : lattice.layer_memories[layer + 2]] = 0.0
            answer += lattice.event_scale[layer]
            total[layer] = weight
            if not weight > 0.0:
                answer = -math.inf
                break
            mass *= weight
            if not FAR < mass < 1 / FAR:
                answer += math.log(mass)
                mass = 1.0
            if not final:
                for s in range(end, lattice.layer_memories[layer + 2]):
                    entered[s] /= weight
        log_likelihood[u] = answer + math.log(mass)


@_kernel
def backward(
    lattice: Any, courses: Any, first: int, last: int, mistake: float, peak: Any, share: Any, waiting: Any,
    quiet: Any, entered: Any, total: Any, log_likelihood: Any, unit_weight: Any, ahead: Any, memory: Any,
    flow: Any, press: Any,
) -> None:  # fmt: skip
    """Smooth backward: `memory[s]`, P(memory s | whole trial), and `press[s, state]`, (memories, 2 + M).

    `press` is P(memory s, M = state at its event | whole trial), columns as `mental_states`; `flow` is
    `press` over P(M = state | memory s): the rate of the log-likelihood in that probability, which may be
    positive where the probability is 0. All is weighted by `unit_weight`; a unit of probability 0 has zeros.
    """
    states = len(peak)
    for u in range(first, last):
        impossible = log_likelihood[u] == -math.inf
        for layer in range(lattice.unit_layers[u + 1] - 1, lattice.unit_layers[u] - 1, -1):
            final = layer + 1 == lattice.unit_layers[u + 1]
            silent, event = lattice.event[layer, 0], lattice.layer_press[layer]
            for s in range(lattice.layer_memories[layer], lattice.layer_memories[layer + 1]):
                for state in range(states + 2):
                    flow[s, state] = 0.0
                    press[s, state] = 0.0
                if impossible:
                    memory[s] = 0.0
                    continue
                future = unit_weight[u] / total[layer] if final else 0.0
                if not final:
                    cell, leaving = courses.memory_cell[s] + event, entered[s] * quiet[s]
                    for reset in range(states + 1):
                        after = lattice.memory_next[s, reset]
                        if after < 0:
                            continue
                        onward = ahead[after] / total[layer]
                        if reset > 0:
                            p = peak[reset - 1] * share[courses.cell_level[cell, reset - 1]]
                            rate = leaving * onward * lattice.event[layer, 1 + reset]
                            flow[s, 1 + reset] = rate
                            press[s, 1 + reset] = rate * p
                            future += onward * (p * lattice.event[layer, 1 + reset])
                            continue
                        rate = leaving * onward * lattice.event[layer, 1]
                        flow[s, 1] = rate
                        press[s, 1] = rate * mistake
                        p = lattice.event[layer, 1] * mistake
                        if silent > 0.0:
                            flow[s, 0] = leaving * onward * silent
                            press[s, 0] = flow[s, 0] * waiting[cell]
                            p += silent * waiting[cell]
                        future += onward * p
                ahead[s] = quiet[s] * future
                memory[s] = entered[s] * ahead[s]
