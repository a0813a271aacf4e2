"""One function over many items on several processes, its results in the order of the items."""

from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_EXCEPTION, ProcessPoolExecutor, as_completed, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from typing import Any, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

_work: Callable[[Any], Any] | None = None


def _install(work: Callable[[Any], Any]) -> None:
    global _work
    _work = work


def _call(item: Any) -> Any:
    if _work is None:
        raise RuntimeError("the worker process was not given its work")
    return _work(item)


def map_in_order(
    work: Callable[[Item], Result],
    items: Iterable[Item],
    jobs: int = 1,
    progress: Callable[[int], None] | None = None,
) -> list[Result]:
    """[work(item) for item in items], on `jobs` processes.

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


def _raise_first(futures: list[Any]) -> None:
    for future in futures:
        if future.done():
            future.result()
