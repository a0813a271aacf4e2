"""A scripted operator: stands in for the human who controls the robot behind the scenes."""

from collections.abc import Generator, Iterable
from typing import Any

import numpy as np

from taskcomm.robot import Final
from taskcomm.tasks import Task
from taskcomm.world import NOA, Action, BallWorld

Script = Generator[Any, bool, Any]


class ScriptedOperator:
    """A controller that questions one thing after the other, as people do, and sees only presses.

    It lights the balls one by one, each for about `dwell` seconds; picks up the one approved;
    lights the others while it holds that one; slides it through the distances from the one
    approved, nearest and back, pausing at each; shows Final after one or two approvals at a
    distance. A press within `reaction` seconds of a change is taken to mean what was there before.
    Where nothing is approved for long it goes back a stage. Dwell times, orders and how many
    approvals it wants vary with the generator given to `reset`; without one they are those of
    seed 0. In steps without a deliberate action it does `noa`, and `source` is `default`.

    `dt`, `dwell` and `reaction` are in seconds. Raises ValueError for another World than
    BallWorld or times that are not positive.

    >>> operator = ScriptedOperator(BallWorld())
    >>> operator.act(None)
    light_on(3)

    Source: the paper, section 3.2 (the comparison trials).
    """

    def __init__(
        self, world: BallWorld, dt: float = 0.5, *, dwell: float = 4.0, reaction: float = 1.0
    ) -> None:
        if not isinstance(world, BallWorld):
            raise ValueError(f"ScriptedOperator: plays in a BallWorld only, not in {world!r}")
        for name, value in (("dt", dt), ("dwell", dwell), ("reaction", reaction)):
            if not 0 < value < float("inf"):
                raise ValueError(f"{name}: must be above 0 s, not {value!r}")
        self.world, self.dt, self.dwell, self.reaction = world, dt, dwell, reaction
        self.reset()

    @property
    def description(self) -> dict[str, Any]:
        """What a log says of this operator."""
        return {"condition": "operator", "robot_model": None, "planner": None}

    def reset(self, rng: np.random.Generator | None = None) -> None:
        """Ready for the next trial."""
        self._rng = np.random.default_rng(0) if rng is None else rng
        self._pace = float(np.exp(0.2 * self._rng.standard_normal()))
        self._wanted = 1 if self._rng.random() < 0.15 else 2
        self.state = self.world.start()
        self.source = "operator"
        self._script: Script | None = None
        self._over = False

    def act(self, pressed: bool | None) -> Any:
        """The next action, or Final; `pressed` is None at the first call of a trial."""
        if self._over or (pressed is None) != (self._script is None):
            raise ValueError("a trial begins with act(None), goes on with act(pressed) and ends with Final")
        if self._script is None:
            self._script = self._trial()
            return next(self._script)
        action = self._script.send(bool(pressed))
        self._over = isinstance(action, Final)
        return action

    def _trial(self) -> Script:
        suspect: int | None = None  # a ball that led nowhere is questioned last
        while True:
            mov = yield from self._find_mov(last=suspect)
            yield from self._do(Action("pick_up", mov))
            wrt = None
            for _ in range(2):
                wrt = yield from self._find_wrt(mov, last=wrt)
                if wrt is None:
                    break
                distance = yield from self._find_distance(mov, wrt)
                if distance is not None:
                    yield Final(Task(mov, wrt, distance))
            yield from self._do(Action("release", mov))
            suspect = mov

    def _find_mov(self, last: int | None) -> Script:
        balls = range(1, self.world.num_balls + 1)
        while True:
            ball = yield from self._question(self._shuffled(balls, last))
            if ball is not None:
                return ball
            last = None

    def _find_wrt(self, mov: int, last: int | None) -> Script:
        balls = [ball for ball in range(1, self.world.num_balls + 1) if ball != mov]
        for _ in range(2):
            ball = yield from self._question(self._shuffled(balls, last))
            if ball is not None or len(balls) == 1:  # one ball alone is shown, but needs no approval
                return balls[0] if ball is None else ball
        return None

    def _question(self, balls: Iterable[int]) -> Script:
        """Light each ball in turn; the one approved, or None."""
        for ball in balls:
            approved = yield from self._do(Action("light_on", ball))
            if not approved:
                approved = yield from self._pause(self._dwell())
            late = yield from self._do(Action("light_off", ball))
            if not (approved or late):
                late = yield from self._pause(self.reaction - self.dt)
            if approved or late:
                return ball
        return None

    def _find_distance(self, mov: int, wrt: int) -> Script:
        """Slide down to 1 and up to the furthest, pausing at each; the distance approved, or None."""
        furthest = self.world.num_distances
        at = self.world.distance(self.state, mov, wrt)
        goals, doubted = [*range(at - 1, 0, -1), *range(2, furthest + 1)], set()
        while goals:
            goal = goals.pop(0)
            before = min(self.world.distance(self.state, mov, wrt), furthest)
            late = yield from self._slide(mov, wrt, goal)
            if not late:
                late = yield from self._pause(self.reaction - self.dt)
            if late and before != goal and goal not in doubted:  # it may have meant the distance before
                yield from self._slide(mov, wrt, before)
                goals.insert(0, goal)
                doubted.add(goal)
            approvals = 0
            while approvals < self._wanted:
                patience = 2 if approvals or late else 1
                if not (yield from self._pause(patience * self._dwell())):
                    break
                approvals += 1
            else:
                return self.world.distance(self.state, mov, wrt)
        return None

    def _slide(self, mov: int, wrt: int, goal: int) -> Script:
        pressed = False
        while (at := self.world.distance(self.state, mov, wrt)) != goal:
            step = 1 if goal > at else -1
            pressed = (yield from self._do(Action("slide", mov, at + step, wrt))) or pressed
        return pressed

    def _do(self, action: Action) -> Script:
        self.state = self.world.step(self.state, action)
        self.source = "operator"
        pressed: bool = yield action
        return pressed

    def _pause(self, seconds: float) -> Script:
        """Do nothing for so long, or until a press; whether there was one."""
        for _ in range(round(seconds / self.dt)):
            self.source = "default"
            self.state = self.world.step(self.state, NOA)
            if (yield NOA):
                return True
        return False

    def _dwell(self) -> float:
        return self.dwell * self._pace * float(np.exp(0.25 * self._rng.standard_normal()))

    def _shuffled(self, balls: Iterable[int], last: int | None) -> list[int]:
        order = [int(ball) for ball in self._rng.permutation(list(balls))]
        return sorted(order, key=lambda ball: ball == last)
