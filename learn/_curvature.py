"""Compiled second derivatives of log-likelihoods over a `Lattice`. Arrays in, arrays out.

The forward pass of `taskcomm._chain`, with every weight carried together with its first and second
derivatives in the natural parameters. Every factor of the likelihood depends on few of them, so that
its derivatives are kept as short lists of those that are not 0.
"""

import math
from typing import Any, NamedTuple

from taskcomm.compiling import kernel

_kernel = kernel(__name__, "the curvature of the likelihood")


class Buffers(NamedTuple):
    """Room for one unit at a time: a track's shares and derivatives, the weights of two layers of
    memories, and the lists of one factor. `pair` (5, 5) numbers the second derivatives of a share."""

    pair: Any
    share: Any
    first: Any
    second: Any
    weight: Any
    rates: Any
    bends: Any
    by: Any
    rate: Any
    by_one: Any
    by_other: Any
    bend: Any
    quiet_rates: Any
    quiet_bends: Any


@_kernel
def _trace(
    lattice: Any, unit: int, origin: int, dt: float, rise: Any, fall: Any, late: Any, part: Any, decay: Any,
    hold: Any, to: Any,
) -> None:  # fmt: skip
    """Shares of a unit's tracks with their first (5, size) and second (15, size) derivatives.

    Since it was last held at 0 or 1, a level has risen for `ups` and fallen for `downs` seconds, both
    linear in the delay. Where it has just reached 0 or 1 its derivatives are those of staying there.
    """
    for j in range(lattice.unit_tracks[unit], lattice.unit_tracks[unit + 1]):
        m = lattice.track_state[j]
        up, down, n = 1.0 / rise[m], 1.0 / fall[m], late[m]
        early = part[m] * dt
        level = ups = downs = ups_late = downs_late = 0.0
        on_time = on_late = 0.0
        cue, start = lattice.track_cue[j], lattice.track_first[j]
        rest = lattice.track_rest[j] + start
        for i in range(lattice.track_length[j]):
            t, at = start + i, lattice.track_at[j] + i - origin
            older = t - n - 1 >= 0 and lattice.cues[cue + t - n - 1] > 0
            newer = t - n >= 0 and lattice.cues[cue + t - n] > 0
            for half in range(2):
                on = older if half == 0 else newer
                seconds = early if half == 0 else dt - early
                stretch = 1.0 if half == 0 else -1.0
                if on:
                    level += seconds * up
                    ups += seconds
                    ups_late += stretch
                    on_time += seconds
                    on_late += stretch
                else:
                    level -= seconds * down
                    downs += seconds
                    downs_late += stretch
                    if seconds > 0.0:
                        on_time = 0.0
                    on_late = 0.0
                if (on and level >= 1.0) or (not on and level <= 0.0):
                    level = 1.0 if on else 0.0
                    ups = downs = ups_late = downs_late = 0.0
            for k in range(5):
                to.first[k, at] = 0.0
            for k in range(15):
                to.second[k, at] = 0.0
            if lattice.rests[rest + i]:
                to.share[at] = 0.0
                continue
            factor = 1.0
            faded = decay[m] < math.inf and on_time > hold[m]
            if faded:
                factor = math.exp(-(on_time - hold[m]) / decay[m])
            by_rise, by_fall = -ups * up * up, downs * down * down
            by_delay = ups_late * up - downs_late * down
            to.share[at] = level * factor
            to.first[0, at] = by_rise * factor
            to.first[1, at] = by_fall * factor
            to.first[2, at] = by_delay * factor
            to.second[to.pair[0, 0], at] = 2.0 * ups * up * up * up * factor
            to.second[to.pair[1, 1], at] = -2.0 * downs * down * down * down * factor
            to.second[to.pair[0, 2], at] = -ups_late * up * up * factor
            to.second[to.pair[1, 2], at] = downs_late * down * down * factor
            if faded:
                # factor = exp(-u), u = (on time - hold) / decay
                u = (on_time - hold[m]) / decay[m]
                u_delay, u_decay, u_hold = on_late / decay[m], -u / decay[m], -1.0 / decay[m]
                to.first[2, at] -= level * factor * u_delay
                to.first[3, at] = -level * factor * u_decay
                to.first[4, at] = -level * factor * u_hold
                to.second[to.pair[0, 2], at] -= by_rise * factor * u_delay
                to.second[to.pair[0, 3], at] = -by_rise * factor * u_decay
                to.second[to.pair[0, 4], at] = -by_rise * factor * u_hold
                to.second[to.pair[1, 2], at] -= by_fall * factor * u_delay
                to.second[to.pair[1, 3], at] = -by_fall * factor * u_decay
                to.second[to.pair[1, 4], at] = -by_fall * factor * u_hold
                of_level = level * factor
                to.second[to.pair[2, 2], at] = (
                    of_level * u_delay * u_delay - 2.0 * by_delay * factor * u_delay
                )
                to.second[to.pair[2, 3], at] = (
                    of_level * (u_delay * u_decay + u_delay / decay[m]) - by_delay * factor * u_decay
                )
                to.second[to.pair[2, 4], at] = of_level * u_delay * u_hold - by_delay * factor * u_hold
                to.second[to.pair[3, 3], at] = of_level * (u_decay * u_decay + 2.0 * u_decay / decay[m])
                to.second[to.pair[3, 4], at] = of_level * (u_decay * u_hold + u_hold / decay[m])
                to.second[to.pair[4, 4], at] = of_level * u_hold * u_hold


@_kernel
def _approval(
    scale: float, m: int, at: int, peak: Any, column: Any, to: Any, count: int, bends: int
) -> tuple[int, int]:
    """Append the derivatives of scale * peak[m] * share to the lists, and give how long they are now."""
    states = len(peak)
    own = column[1 + m]
    if own >= 0 and to.share[at] != 0.0:
        to.by[count] = own
        to.rate[count] = scale * to.share[at]
        count += 1
    for k in range(5):
        at_k = column[1 + (k + 1) * states + m]
        if at_k < 0:
            continue
        if to.first[k, at] != 0.0:
            to.by[count] = at_k
            to.rate[count] = scale * peak[m] * to.first[k, at]
            count += 1
            if own >= 0:
                to.by_one[bends] = own
                to.by_other[bends] = at_k
                to.bend[bends] = scale * to.first[k, at]
                bends += 1
        for other in range(k, 5):
            at_other = column[1 + (other + 1) * states + m]
            curved = to.second[to.pair[k, other], at]
            if at_other >= 0 and curved != 0.0:
                to.by_one[bends] = at_k
                to.by_other[bends] = at_other
                to.bend[bends] = scale * peak[m] * curved
                bends += 1
    return count, bends


@_kernel
def _waiting(
    scale: float, s: int, t: int, lattice: Any, origin: int, mistake: float, peak: Any, column: Any, to: Any,
    count: int, bends: int,
) -> tuple[float, int, int]:  # fmt: skip
    """scale * P(waiting) at step t in memory s, its derivatives but that in mistake appended."""
    value = 1.0 - mistake
    for m in range(len(peak)):
        at = lattice.memory_base[s, m] + t - origin
        value -= peak[m] * to.share[at]
        count, bends = _approval(-scale, m, at, peak, column, to, count, bends)
    return scale * value, count, bends


@_kernel
def _quiet(
    lattice: Any, layer: int, s: int, origin: int, mistake: float, peak: Any, column: Any, to: Any
) -> float:
    """Log-probability of the steps of a layer before its event, in memory s, and its derivatives."""
    size = len(to.quiet_rates)
    for a in range(size):
        to.quiet_rates[a] = 0.0
        for b in range(size):
            to.quiet_bends[a, b] = 0.0
    logs = 0.0
    for t in range(lattice.layer_first[layer], lattice.layer_press[layer]):
        count, bends = 0, 0
        if column[0] >= 0:
            to.by[0] = column[0]
            to.rate[0] = -1.0
            count = 1
        value, count, bends = _waiting(1.0, s, t, lattice, origin, mistake, peak, column, to, count, bends)
        logs += math.log(value)
        for i in range(count):
            rate = to.rate[i] / value
            to.quiet_rates[to.by[i]] += rate
            for j in range(count):
                to.quiet_bends[to.by[i], to.by[j]] -= rate * to.rate[j] / value
        for i in range(bends):
            bend = to.bend[i] / value
            to.quiet_bends[to.by_one[i], to.by_other[i]] += bend
            if to.by_one[i] != to.by_other[i]:
                to.quiet_bends[to.by_other[i], to.by_one[i]] += bend
    return logs


@_kernel
def _leave(scale: float, now: int, s: int, to: Any) -> None:
    """Multiply a weight by scale * exp(log-probability of `_quiet`), derivatives too."""
    size = len(to.quiet_rates)
    weight = to.weight[now, s]
    for a in range(size):
        rate, quiet = to.rates[now, s, a], to.quiet_rates[a]
        for b in range(size):
            to.bends[now, s, a, b] = scale * (
                to.bends[now, s, a, b]
                + rate * to.quiet_rates[b]
                + quiet * to.rates[now, s, b]
                + weight * (to.quiet_bends[a, b] + quiet * to.quiet_rates[b])
            )
    for a in range(size):
        to.rates[now, s, a] = scale * (to.rates[now, s, a] + weight * to.quiet_rates[a])
    to.weight[now, s] = scale * weight


@_kernel
def _enter(p: float, count: int, bends: int, now: int, s: int, onward: int, after: int, to: Any) -> None:
    """Add to the weight of a memory of the next layer that of `s` times a factor p, derivatives too."""
    size = len(to.quiet_rates)
    weight = to.weight[now, s]
    to.weight[onward, after] += weight * p
    for a in range(size):
        to.rates[onward, after, a] += to.rates[now, s, a] * p
        for b in range(size):
            to.bends[onward, after, a, b] += to.bends[now, s, a, b] * p
    for i in range(count):
        by, rate = to.by[i], to.rate[i]
        to.rates[onward, after, by] += weight * rate
        for a in range(size):
            to.bends[onward, after, a, by] += to.rates[now, s, a] * rate
            to.bends[onward, after, by, a] += to.rates[now, s, a] * rate
    for i in range(bends):
        bend = weight * to.bend[i]
        to.bends[onward, after, to.by_one[i], to.by_other[i]] += bend
        if to.by_one[i] != to.by_other[i]:
            to.bends[onward, after, to.by_other[i], to.by_one[i]] += bend


@_kernel
def _scale(layer: int, count: int, scale: float, to: Any) -> None:
    """Multiply the weights of the first `count` memories of a layer, derivatives too."""
    size = len(to.quiet_rates)
    for s in range(count):
        to.weight[layer, s] *= scale
        for a in range(size):
            to.rates[layer, s, a] *= scale
            for b in range(size):
                to.bends[layer, s, a, b] *= scale


@_kernel
def _clear(layer: int, count: int, to: Any) -> None:
    """Make the weights of the first `count` memories of a layer 0, derivatives too."""
    to.weight[layer, :count] = 0.0
    to.rates[layer, :count] = 0.0
    to.bends[layer, :count] = 0.0


@_kernel
def _best_quiet(lattice: Any, layer: int, origin: int, mistake: float, peak: Any, now: int, to: Any) -> float:
    """The greatest log-probability of the steps of a layer before its event, over its memories."""
    best, begin = -math.inf, lattice.layer_memories[layer]
    for s in range(begin, lattice.layer_memories[layer + 1]):
        if to.weight[now, s - begin] > 0.0:
            logs = 0.0
            for t in range(lattice.layer_first[layer], lattice.layer_press[layer]):
                waiting = 1.0 - mistake
                for m in range(len(peak)):
                    waiting -= peak[m] * to.share[lattice.memory_base[s, m] + t - origin]
                logs += math.log(waiting)
            best = max(best, logs)
    return best


@_kernel
def _event(
    lattice: Any, layer: int, s: int, reset: int, origin: int, mistake: float, peak: Any, column: Any, to: Any
) -> tuple[float, int, int]:  # fmt: skip
    """P(that reset, what is observed | memory s) at the event of a layer, and its derivatives."""
    event, end = lattice.event[layer], lattice.layer_press[layer]
    if reset > 0:
        scale, at = event[1 + reset], lattice.memory_base[s, reset - 1] + end - origin
        count, bends = _approval(scale, reset - 1, at, peak, column, to, 0, 0)
        return scale * peak[reset - 1] * to.share[at], count, bends
    value, count, bends = event[1] * mistake, 0, 0
    if column[0] >= 0:
        to.by[0] = column[0]
        to.rate[0] = event[1] - event[0]
        count = 1
    if event[0] > 0.0:
        waiting, count, bends = _waiting(
            event[0], s, end, lattice, origin, mistake, peak, column, to, count, bends
        )
        value += waiting
    return value, count, bends


@_kernel
def curve(
    lattice: Any, first: int, last: int, dt: float, mistake: float, peak: Any, rise: Any, fall: Any,
    late: Any, part: Any, decay: Any, hold: Any, column: Any, to: Any, log_likelihood: Any, score: Any,
    hessian: Any,
) -> None:  # fmt: skip
    """Log-likelihoods of the units, (units,), with first (units, n) and second derivatives (units, n, n).

    `column[i]` is the place of natural parameter i among the n, or -1 where its derivatives are not wanted.
    A forward pass at the same parameters has scaled the lattice's events.
    """
    states, size = len(peak), len(to.quiet_rates)
    for u in range(first, last):
        origin = lattice.track_at[lattice.unit_tracks[u]]
        _trace(lattice, u, origin, dt, rise, fall, late, part, decay, hold, to)
        answer, now = 0.0, 0
        _clear(now, 1, to)
        to.weight[now, 0] = 1.0
        for layer in range(lattice.unit_layers[u], lattice.unit_layers[u + 1]):
            begin, end = lattice.layer_memories[layer], lattice.layer_memories[layer + 1]
            final, onward, total = layer + 1 == lattice.unit_layers[u + 1], 1 - now, 0.0
            after_end = end if final else lattice.layer_memories[layer + 2]
            _clear(onward, 1 if final else after_end - end, to)
            best = _best_quiet(lattice, layer, origin, mistake, peak, now, to)
            for s in range(begin, end):
                quiet = _quiet(lattice, layer, s, origin, mistake, peak, column, to)
                _leave(math.exp(min(quiet - best, 600.0)), now, s - begin, to)
                if final:
                    _enter(1.0, 0, 0, now, s - begin, onward, 0, to)
                    total += to.weight[now, s - begin]
                    continue
                for reset in range(states + 1):
                    after = lattice.memory_next[s, reset]
                    if after >= 0:
                        p, count, bends = _event(lattice, layer, s, reset, origin, mistake, peak, column, to)
                        _enter(p, count, bends, now, s - begin, onward, after - end, to)
                        total += to.weight[now, s - begin] * p
            answer += best + (math.log(total) if total > 0.0 else -math.inf)
            if not final:
                answer += lattice.event_scale[layer]
            if not total > 0.0:
                break
            _scale(onward, 1 if final else after_end - end, 1.0 / total, to)
            now = onward
        log_likelihood[u] = answer
        for a in range(size):
            score[u, a] = to.rates[now, 0, a]
        for a in range(size):
            for b in range(size):
                hessian[u, a, b] = to.bends[now, 0, a, b] - score[u, a] * score[u, b]
