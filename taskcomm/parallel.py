"""One function over many items on several processes or threads, its results in the order of the items."""

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_EXCEPTION, ProcessPoolExecutor, ThreadPoolExecutor, as_completed, wait
from concurrent.futures.process import BrokenProcessPool
from functools import cache
from multiprocessing import get_context
from typing import Any, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

_work: Callable[[Any], Any] | None = None
_threads = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _install(work: Callable[[Any], Any]) -> None:
    """In a worker process: its work; the other processes have the other cores."""
    global _work, _threads
    _work, _threads = work, 1


def _call(item: Any) -> Any:
    if _work is None:
        raise RuntimeError("the worker process was not given its work")
    return _work(item)


def map_in_order(
    work: Callable[[Item], Result],
    items: Iterable[Item],
    jobs: int = 1,
    progress: Callable[[int], None] | None = None,
    until: Callable[[Result], bool] | None = None,
) -> list[Result]:
    """[work(item) for item in items], on `jobs` processes; up to the first result that `until` is true of.

    Each process gets `work` once, so whatever it holds (a planner, a graph) is made once per process.
    The results depend on the items alone, not on `jobs`. `progress` is called with the number done.
    With `jobs` above 1, `work`, items and results are pickled, and processes are started anew
    (spawn): a World defined in a notebook cannot follow, and needs `jobs=1`.

    Raises ValueError for jobs < 1, RuntimeError if a process died, and whatever `work` raises.

    >>> map_in_order(abs, [3, -4])
    [3, 4]
    """
    if jobs < 1:
        raise ValueError(f"jobs: must be at least 1, not {jobs}")
    items = list(items)
    if jobs == 1 or len(items) < 2:
        results = []
        for item in items:
            results.append(work(item))
            if progress is not None:
                progress(len(results))
            if until is not None and until(results[-1]):
                break
        return results
    pool = ProcessPoolExecutor(
        min(jobs, len(items)), mp_context=get_context("spawn"), initializer=_install, initargs=(work,)
    )
    with pool:
        futures = [pool.submit(_call, item) for item in items]
        try:
            for done, _ in enumerate(as_completed(futures), start=1):
                if progress is not None:
                    progress(done)
                if done % 16 == 0:
                    _raise_first(futures)
                if until is not None and (found := _up_to(futures, until)):
                    pool.shutdown(wait=False, cancel_futures=True)
                    return found
            wait(futures, return_when=FIRST_EXCEPTION)
            return [future.result() for future in futures]
        except BrokenProcessPool:
            raise RuntimeError(
                "a worker process died or could not start; a World or model defined in a notebook or an"
                " unguarded script needs jobs=1"
            ) from None
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _up_to(futures: list[Any], until: Callable[[Any], bool]) -> list[Any]:
    """The results up to the first that `until` is true of, if all before it are there; else none."""
    found: list[Any] = []
    for future in futures:
        if not future.done():
            return []
        found.append(future.result())
        if until(found[-1]):
            return found
    return []


def _raise_first(futures: list[Any]) -> None:
    for future in futures:
        if future.done():
            future.result()


def over_ranges(work: Callable[[int, int], Result], ranges: Sequence[tuple[int, int]]) -> list[Result]:
    """[work(first, last) for first, last in ranges], on a thread for each core.

    For compiled `work` that releases the interpreter's lock and writes only what belongs to its range. The
    answer does not depend on the number of threads.

    >>> over_ranges(lambda first, last: last - first, [(0, 3), (3, 10)])
    [3, 7]
    """
    if len(ranges) == 1 or _threads == 1:
        return [work(first, last) for first, last in ranges]
    return list(_pool(os.getpid()).map(lambda ends: work(*ends), ranges))


@cache
def _pool(_process: int) -> ThreadPoolExecutor:
    """The threads of a process, started when first needed; a forked process has its own."""
    return ThreadPoolExecutor(_threads, thread_name_prefix="taskcomm")
