"""Tasks: every (mov, wrt, dist) once, in the order of every marginal."""

import itertools

import pytest

from taskcomm.tasks import Task, enumerate_tasks


@pytest.mark.parametrize(("num_balls", "num_distances"), [(2, 1), (3, 4), (5, 2)])
def test_the_tasks_are_every_triple_of_two_balls_and_a_distance_in_order(
    num_balls: int, num_distances: int
) -> None:
    balls, distances = range(1, num_balls + 1), range(1, num_distances + 1)
    expected = sorted((i, j, k) for i, j, k in itertools.product(balls, balls, distances) if i != j)
    assert list(enumerate_tasks(num_balls, num_distances)) == expected


def test_the_paper_has_24_tasks_from_ball_1() -> None:
    tasks = enumerate_tasks(3, 4)
    assert len(tasks) == 24
    assert (tasks[0], tasks[-1]) == (Task(1, 2, 1), Task(mov=3, wrt=2, dist=4))
