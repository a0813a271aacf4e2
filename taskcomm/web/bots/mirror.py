"""The world state behind a frame: what somebody knows who only watches."""

from taskcomm.web.protocol import Frame
from taskcomm.world import BallState, BallWorld


def world_of(frame: Frame) -> BallWorld:
    """The world that a frame is of."""
    return BallWorld(frame.balls, frame.distances)


def state_of(frame: Frame, before: BallState | None = None) -> BallState:
    """The world state that the frame shows.

    Which way a ball slid follows from `before`, the state last seen, however long ago; where that is
    unknown, or leaves it open, it slid nearer.

    >>> from taskcomm.web.protocol import Frame
    >>> state_of(Frame(t=7, balls=3, distances=4, lit=[2], held=1, placements=[[1, 3, 4]], slid=[1, 3, 4],
    ...                final=[], count=0, state="run", action="slide(1, 4, 3)")).slid
    (1, -1)
    """
    placements: list[tuple[int, int] | None] = [None] * frame.balls
    for ball, reference, distance in frame.placements:
        placements[ball - 1] = (reference, distance)
    slid = None
    if frame.slid:
        ball, reference, distance = frame.slid
        at = frame.distances + 1 if before is None else world_of(frame).distance(before, ball, reference)
        slid = (ball, 1 if distance > at else -1)
    return BallState(frozenset(frame.lit), frame.held or None, tuple(placements), slid)
