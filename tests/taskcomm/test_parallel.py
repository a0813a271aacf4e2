"""Work over many items: the same results on one process or several, and errors that come through."""

import os
from dataclasses import dataclass
from threading import get_ident

import pytest

from taskcomm import parallel
from taskcomm.parallel import map_in_order
from taskcomm.world import InvalidAction


@dataclass
class Square:
    """A number squared, and whether it was done in another process."""

    home: int
    fails_at: int | None = None

    def __call__(self, number: int) -> tuple[int, bool]:
        if number == self.fails_at:
            raise InvalidAction(f"no square of {number}")
        return number * number, os.getpid() != self.home


def test_results_come_in_order_and_do_not_depend_on_the_number_of_processes() -> None:
    told: list[int] = []
    work = Square(os.getpid())
    alone = map_in_order(work, range(9), jobs=1)
    shared = map_in_order(work, range(9), jobs=2, progress=told.append)
    assert [square for square, _ in alone] == [square for square, _ in shared] == [n * n for n in range(9)]
    assert told == list(range(1, 10))
    assert not any(away for _, away in alone)
    assert all(away for _, away in shared)


@pytest.mark.parametrize("jobs", [1, 2])
def test_results_end_with_the_first_that_is_enough(jobs: int) -> None:
    found = map_in_order(Square(os.getpid()), range(9), jobs, until=lambda result: result[0] in (16, 25))
    assert [square for square, _ in found] == [0, 1, 4, 9, 16]
    every = map_in_order(Square(os.getpid()), range(4), jobs, until=lambda result: result[0] > 100)
    assert [square for square, _ in every] == [0, 1, 4, 9]


@pytest.mark.parametrize("jobs", [1, 2])
def test_an_error_of_the_work_is_raised_as_it_is(jobs: int) -> None:
    with pytest.raises(InvalidAction, match="no square of 3"):
        map_in_order(Square(os.getpid(), fails_at=3), range(9), jobs=jobs)


def test_no_processes_are_refused_and_no_items_are_no_results() -> None:
    with pytest.raises(ValueError, match="jobs: must be at least 1, not 0"):
        map_in_order(abs, [1], jobs=0)
    assert map_in_order(abs, [], jobs=2) == []


class Dying:
    def __call__(self, number: int) -> int:
        os._exit(1)


def test_a_process_that_dies_is_one_clear_error() -> None:
    with pytest.raises(RuntimeError, match="a worker process died or could not start"):
        map_in_order(Dying(), range(4), jobs=2)


def test_ranges_on_threads_give_what_they_give_one_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    ranges = [(k, k + 3) for k in range(40)]
    monkeypatch.setattr(parallel, "_threads", 1)
    alone = parallel.over_ranges(lambda first, last: (first * last, get_ident()), ranges)
    monkeypatch.setattr(parallel, "_threads", 4)
    together = parallel.over_ranges(lambda first, last: (first * last, get_ident()), ranges)
    assert [value for value, _ in together] == [value for value, _ in alone]
    assert get_ident() not in {thread for _, thread in together}
