"""What a browser is shown of a ball world."""

from collections.abc import Hashable, Iterable
from typing import Literal

from taskcomm.tasks import Task
from taskcomm.web.protocol import Frame
from taskcomm.world import Action, BallState, BallWorld


def frame(
    world: BallWorld,
    state: BallState,
    t: int,
    action: Hashable | None = None,
    *,
    final: Task | None = None,
    count: int = 0,
    mode: Literal["count", "run", "pause", "over"] = "run",
) -> Frame:
    """The world in `state` during step `t`, after `action` (None: before the first)."""
    slide = isinstance(action, Action) and action.name == "slide"
    placed = [[ball, *at] for ball, at in enumerate(state.placements, 1) if at is not None]
    return Frame(
        t=t,
        balls=world.num_balls,
        distances=world.num_distances,
        lit=sorted(state.lit),
        held=state.held or 0,
        placements=placed,
        slid=[action.ball, action.reference, action.distance] if slide else [],  # type: ignore[union-attr]
        final=list(final) if final else [],
        count=count,
        state=mode,
        action="final" if final else "" if action is None else str(action),
    )


def last_slid(actions: Iterable[Hashable]) -> Task | None:
    """The task that the world shows after these actions: where the ball that was slid last now stands."""
    slides = [action for action in actions if isinstance(action, Action) and action.name == "slide"]
    if not slides:
        return None
    last = slides[-1]
    return Task(last.ball or 0, last.reference or 0, last.distance or 0)
