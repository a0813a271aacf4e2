"""What the teacher has in mind: put ball `mov` at distance `dist` from ball `wrt`."""

from typing import NamedTuple


class Task(NamedTuple):
    """A task of the ball world, counted from 1 as in the paper (MODEL.md, section 2).

    >>> str(Task(mov=1, wrt=2, dist=4))
    'Task(mov=1, wrt=2, dist=4)'
    """

    mov: int
    wrt: int
    dist: int


def enumerate_tasks(num_balls: int, num_distances: int) -> tuple[Task, ...]:
    """Every (mov, wrt, dist) with mov != wrt, in lexicographic order.

    >>> len(enumerate_tasks(3, 4))
    24
    """
    balls = range(1, num_balls + 1)
    return tuple(
        Task(mov, wrt, dist)
        for mov in balls
        for wrt in balls
        if wrt != mov
        for dist in range(1, num_distances + 1)
    )
