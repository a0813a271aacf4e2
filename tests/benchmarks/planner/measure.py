"""One row of the benchmark: the search and the plain tree on the same decisions, in one process.

A process of its own does the work, so that a decision that takes too long can be stopped and its memory
is counted by itself. Time is the processor's, of all threads together.
"""

import multiprocessing
import resource
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
from benchmarks.planner.situations import Situation, Situations
from plaintree import PlainTree

from taskcomm.planner import EntropyPlanner

SEED = 7
EQUAL = 1e-9


@dataclass(frozen=True)
class Limits:
    """Seconds that a row may spend on the search and on the plain tree, and one decision on either.

    `plain_decisions` is how many decisions the plain tree is run on at most.
    """

    search: float
    plain: float
    plain_decisions: int
    decision: float


@dataclass
class Row:
    """What one row measured; times in seconds, one for each decision, infinite where it was stopped."""

    name: str
    num_balls: int
    tasks: int
    horizon: int
    step: float
    of: int
    seconds: list[float] = field(default_factory=list)
    nodes: list[int] = field(default_factory=list)
    plain_nodes: list[int] = field(default_factory=list)
    ratios: list[float] = field(default_factory=list)
    memory: int = 0
    trouble: str = ""

    def summary(self) -> dict[str, Any]:
        """The figures: shares are of a time step, memory in bytes; None where there is nothing to say."""
        share = np.sort(np.array(self.seconds)) / self.step
        some = len(share) > 0
        low, middle, high = np.quantile(self.ratios, [0.25, 0.5, 0.75]) if self.ratios else [np.nan] * 3
        figures = {
            "decisions": len(share),
            "stopped": int(np.isinf(share).sum()),
            "plain_decisions": len(self.ratios),
            "plain_over_search": middle,
            "plain_over_search_quartiles": [_number(low), _number(high)],
            "nodes": np.median(self.nodes) if self.nodes else np.nan,
            "plain_nodes": np.median(self.plain_nodes) if self.plain_nodes else np.nan,
            "median_share": np.median(share) if some else np.nan,
            "p99_share": np.quantile(share, 0.99, method="higher") if some else np.nan,
            "max_share": share.max() if some else np.nan,
            "within_step": np.mean(share <= 1) if some else np.nan,
        }
        known = {key: _number(value) for key, value in figures.items()}
        kept = {key: asdict(self)[key] for key in ("name", "num_balls", "tasks", "horizon", "of")}
        return kept | known | {"memory": self.memory, "trouble": self.trouble}


def _number(value: Any) -> Any:
    """A plain number; None for one that is not finite."""
    if isinstance(value, (list, int)):
        return value
    return float(value) if np.isfinite(value) else None


def measured(situations: Situations, horizon: int, plain: bool, limits: Limits) -> Row:
    """Decisions in an order drawn with a fixed seed, as many as the limits allow."""
    found = situations.found
    order = np.random.default_rng(SEED).permutation(len(found)).tolist()
    row = Row(
        situations.name,
        situations.world.num_balls,
        len(situations.world.tasks),
        horizon,
        situations.model.dt,
        len(found),
    )
    while order and limits.decision * sum(np.isinf(row.seconds)) < limits.search:
        done, stopped = len(row.seconds), ""
        for kind, *values in _from_process(situations, order, horizon, plain, limits):
            if kind == "search":
                row.seconds.append(values[0])
                row.nodes.append(values[1])
            elif kind == "plain":
                row.ratios.append(values[0])
                row.plain_nodes.append(values[1])
            elif kind == "memory":
                row.memory = max(row.memory, values[0])
            else:
                stopped = kind
        order = order[len(row.seconds) - done :]
        if not stopped:
            break
        if stopped == "search stopped":
            row.seconds.append(np.inf)
            order = order[1:]
        elif stopped == "plain stopped":
            plain = False  # it was reached for too far
        else:
            row.trouble = stopped
            break
    return row


def _from_process(
    situations: Situations, order: list[int], horizon: int, plain: bool, limits: Limits
) -> Iterator[tuple[Any, ...]]:
    """What the working process says, to its end, or that it was stopped."""
    fork = multiprocessing.get_context("fork")
    here, there = fork.Pipe(duplex=False)
    process = fork.Process(target=_work, args=(there, situations, order, horizon, plain, limits))
    process.start()
    there.close()
    at = "search"
    try:
        while here.poll(limits.decision):
            message = here.recv()
            if message[0] == "end":
                return
            at = message[1] if message[0] == "begin" else at
            if message[0] != "begin":
                yield message
        yield (f"{at} stopped",)
    except EOFError:
        process.join()
        yield (f"the process ended with {process.exitcode}",)
    finally:
        process.kill()
        process.join()
        here.close()


def _work(
    pipe: Connection, situations: Situations, order: list[int], horizon: int, plain: bool, limits: Limits
) -> None:
    try:
        _decide(pipe, situations, order, horizon, plain, limits)
        pipe.send(("end",))
    except MemoryError:
        pipe.send(("out of memory",))
    except Exception as error:
        pipe.send((f"{type(error).__name__}: {error}",))
        raise


def _decide(
    pipe: Connection, situations: Situations, order: list[int], horizon: int, plain: bool, limits: Limits
) -> None:
    world, model = situations.world, situations.model
    planner, tree = EntropyPlanner(world, model, horizon), PlainTree(world, model, horizon)
    spent, plain_spent = 0.0, 0.0
    for number, index in enumerate(order):
        on = plain and number < limits.plain_decisions and plain_spent < limits.plain
        if spent >= limits.search and not on:
            return
        situation, began = situations.found[index], time.perf_counter()
        known = planner._at(*situation.before)
        planner._graph.grow(known, horizon)  # the world near it is known, as it is to a robot on its way
        pipe.send(("begin", "search"))
        seconds, decision = _timed(planner.plan, situation)
        pipe.send(("search", seconds, decision.nodes))
        pipe.send(("memory", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024))
        spent += time.perf_counter() - began
        if on:
            pipe.send(("begin", "plain"))
            tree.grow(situation.state)
            plain_seconds, values = _timed(tree.values, situation)
            plain_spent += plain_seconds
            if abs(min(values.values()) - decision.value) > EQUAL:
                raise AssertionError(f"plain tree {min(values.values())!r}, search {decision.value!r}")
            pipe.send(("plain", plain_seconds / seconds, tree.nodes))


def _timed(call: Any, situation: Situation) -> tuple[float, Any]:
    started = time.process_time()
    result = call(situation.belief, situation.state)
    return time.process_time() - started, result
