"""Compiled passes over a `Lattice`: levels, forward, backward. Arrays in, arrays out.

Each function takes the units from `first` up to `last` and writes only what belongs to them, so that
ranges of units can run at once. `share` is P(M_t = m) / peak: the level, times the decay of the
plateau, or 0 while the teacher rests.
"""

import math
from typing import Any

from taskcomm.compiling import kernel

SMALL = 1e-200

_kernel = kernel(__name__, "the passes over a trial")


@_kernel
def trace(
    lattice: Any, first: int, last: int, dt: float, rise: Any, fall: Any, late: Any, part: Any, decay: Any,
    hold: Any, share: Any, slope: Any,
) -> None:  # fmt: skip
    """Write `share` along every track, and to `slope` (5, size) its rates in rise, fall, delay, decay, hold.

    Where a level has just reached 0 or 1 the rates are those of staying there; in the delay they are
    those towards a longer one, in the hold those towards a shorter one.
    """
    for j in range(lattice.unit_tracks[first], lattice.unit_tracks[last]):
        m = lattice.track_state[j]
        up, down, n = 1.0 / rise[m], 1.0 / fall[m], late[m]
        early = part[m] * dt
        level = by_rise = by_fall = by_delay = 0.0
        on_time = on_by_delay = 0.0
        at, cue, start = lattice.track_at[j], lattice.track_cue[j], lattice.track_first[j]
        rest = lattice.track_rest[j] + start
        for i in range(lattice.track_length[j]):
            t = start + i
            older = t - n - 1 >= 0 and lattice.cues[cue + t - n - 1] > 0
            newer = t - n >= 0 and lattice.cues[cue + t - n] > 0
            for half in range(2):
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
def transition(lattice: Any, layer: int, s: int, reset: int, mistake: float, peak: Any, share: Any) -> Any:
    """P(that reset, what is observed | memory s) at the event of a layer."""
    event, press = lattice.event[layer], lattice.layer_press[layer]
    if reset > 0:
        return event[1 + reset] * peak[reset - 1] * share[lattice.memory_base[s, reset - 1] + press]
    if event[0] == 0.0:
        return event[1] * mistake
    waiting = 1.0 - mistake
    for m in range(len(peak)):
        waiting -= peak[m] * share[lattice.memory_base[s, m] + press]
    return event[0] * waiting + event[1] * mistake


@_kernel
def forward(
    lattice: Any, first: int, last: int, mistake: float, peak: Any, share: Any, quiet: Any, entered: Any,
    left: Any, total: Any, log_likelihood: Any,
) -> None:  # fmt: skip
    """Filter forward over the layers; write the log-likelihood of each unit.

    `quiet[s]` is the log-probability of the steps before the event in memory s, less the greatest of its
    layer; `entered[s]` and `left[s]` are the weights of memory s when its layer begins and when its
    event comes; `total[l]` is what the weights of layer l summed to, before they were made to sum to 1.
    """
    states = len(peak)
    for u in range(first, last):
        answer = lattice.unit_constant[u]
        begin = lattice.layer_memories[lattice.unit_layers[u]]
        end = lattice.layer_memories[lattice.unit_layers[u + 1]]
        for s in range(begin, end):
            entered[s] = 0.0
        entered[begin] = 1.0
        for layer in range(lattice.unit_layers[u], lattice.unit_layers[u + 1]):
            begin, end = lattice.layer_memories[layer], lattice.layer_memories[layer + 1]
            press = lattice.layer_press[layer]
            best = -math.inf
            for s in range(begin, end):
                product, logs = 1.0, 0.0
                for t in range(lattice.layer_first[layer], press):
                    waiting = 1.0 - mistake
                    for m in range(states):
                        waiting -= peak[m] * share[lattice.memory_base[s, m] + t]
                    product *= waiting
                    if product < SMALL:
                        logs += math.log(product)
                        product = 1.0
                quiet[s] = logs + math.log(product)
                if entered[s] > 0.0:
                    best = max(best, quiet[s])
            answer += best
            final = layer + 1 == lattice.unit_layers[u + 1]
            weight = 0.0
            for s in range(begin, end):
                quiet[s] = min(quiet[s] - best, 600.0)
                left[s] = entered[s] * math.exp(quiet[s])
                if final:
                    weight += left[s]
                    continue
                for reset in range(states + 1):
                    after = lattice.memory_next[s, reset]
                    if after >= 0:
                        p = transition(lattice, layer, s, reset, mistake, peak, share)
                        entered[after] += left[s] * p
                        weight += left[s] * p
            total[layer] = weight
            answer += math.log(weight) if weight > 0.0 else -math.inf
            if not weight > 0.0:
                answer = -math.inf
                break
            if not final:
                for s in range(end, lattice.layer_memories[layer + 2]):
                    entered[s] /= weight
        log_likelihood[u] = answer


@_kernel
def backward(
    lattice: Any, first: int, last: int, mistake: float, peak: Any, share: Any, quiet: Any, entered: Any,
    left: Any, total: Any, log_likelihood: Any, unit_weight: Any, ahead: Any, memory: Any, flow: Any,
) -> None:  # fmt: skip
    """Smooth backward: `memory[s]`, P(memory s | whole trial), and `flow[s, state]`, (memories, 2 + M).

    `flow` times P(M = state | memory s) at the event is P(memory s, M = state | whole trial), columns as
    `mental_states`; it is the rate of the log-likelihood in that probability, and may be positive where
    the probability is 0. All is weighted by `unit_weight`; a unit of probability 0 has zeros.
    """
    states = len(peak)
    for u in range(first, last):
        impossible = log_likelihood[u] == -math.inf
        for layer in range(lattice.unit_layers[u + 1] - 1, lattice.unit_layers[u] - 1, -1):
            event, final = lattice.event[layer], layer + 1 == lattice.unit_layers[u + 1]
            for s in range(lattice.layer_memories[layer], lattice.layer_memories[layer + 1]):
                flow[s] = 0.0
                if impossible:
                    memory[s] = 0.0
                    continue
                future = unit_weight[u] / total[layer] if final else 0.0
                for reset in range(states + 1):
                    after = -1 if final else lattice.memory_next[s, reset]
                    if after < 0:
                        continue
                    onward = ahead[after] / total[layer]
                    future += onward * transition(lattice, layer, s, reset, mistake, peak, share)
                    flow[s, 1 + reset] = left[s] * onward * event[1 + reset]
                    if reset == 0:
                        flow[s, 0] = left[s] * onward * event[0]
                ahead[s] = math.exp(quiet[s]) * future
                memory[s] = entered[s] * ahead[s]
