"""Where things are drawn: laws of layout.js, run in the browser over states that the ball world reaches."""

from collections.abc import Iterator
from typing import Any

import msgspec
import numpy as np
import pytest
from playwright.sync_api import Browser, Page
from web.pages.stage import Stage, opened, served

from taskcomm.web.frames import frame
from taskcomm.world import BallState, BallWorld

# For each frame {ball: least gap between two balls or a ball and the robot, mark: the same for a ball that
# would stand on a mark, marks: between marks, and between a mark and the held ball, off: greatest error of a
# distance, seen: whether the view has it all, at: where each ball is}.
MEASURE = """async ({frames, carried}) => {
  const { arrange } = await import('/layout.js');
  const far = (p, q) => Math.hypot(p.x - q.x, p.y - q.y);
  let before = null;
  return frames.map((frame) => {
    const { size, at, placed, rays, view } = (before = arrange(frame, carried ? before : null));
    const balls = [...at];
    const robot = (p) => far(p, {x: 0, y: 0}) - size.radius - size.free;
    const gaps = balls.flatMap(([ball, p]) => [robot(p), ...balls.filter(([other]) => other > ball)
      .map(([, q]) => far(p, q) - 2 * size.radius)]);
    const free = balls.filter(([ball]) => ball !== frame.held).map(([, p]) => p);
    const onMarks = rays.flatMap(({points}) => points.flatMap((p) =>
      [robot(p), ...free.map((q) => far(p, q) - 2 * size.radius)]));
    const between = rays.flatMap((one) => rays.filter((other) => other.reference > one.reference)
      .flatMap((other) => one.points.flatMap((p) => other.points.map((q) => far(p, q) - 2 * size.mark))));
    const hidden = rays.flatMap(({reference, points}) => points.filter((_, k) => !placed.some((one) =>
      one.ball === frame.held && one.reference === reference && one.distance === k + 1)))
      .map((p) => far(p, at.get(frame.held)) - size.radius - size.mark);
    const off = placed.map(({ball, reference, distance}) =>
      Math.abs(far(at.get(ball), at.get(reference)) - size.first - (distance - 1) * size.step));
    const seen = [...free, ...rays.flatMap(({points}) => points)].every((p) =>
      p.x - size.radius >= view.left && p.x + size.radius <= view.right &&
      p.y - size.radius >= view.top && p.y + size.radius <= view.bottom);
    return {ball: Math.min(...gaps), mark: Math.min(99, ...onMarks),
            marks: Math.min(99, ...between, ...hidden),
            off: Math.max(0, ...off), seen, at: Object.fromEntries(balls)};
  });
}"""


@pytest.fixture(scope="module")
def page(browser: Browser) -> Iterator[Page]:
    with served(Stage("teacher")) as stage, opened(browser, stage) as page:
        yield page


def measured(page: Page, states: list[BallState], world: BallWorld, *, carried: bool) -> list[dict[str, Any]]:
    frames = msgspec.to_builtins([frame(world, state, t=0) for state in states])
    found: list[dict[str, Any]] = page.evaluate(MEASURE, {"frames": frames, "carried": carried})
    return found


def reachable(world: BallWorld) -> list[BallState]:
    """Every state but for lights and the last slide, which move nothing."""
    found, new = {world.start()}, [world.start()]
    while new:
        state = new.pop()
        for action in world.actions(state):
            if not action.name.startswith("light"):
                after = world.step(state, action)._replace(slid=None)
                if after not in found:
                    found.add(after)
                    new.append(after)
    return sorted(found, key=str)


def walk(world: BallWorld, steps: int, rng: np.random.Generator) -> list[BallState]:
    """Hands that are never still: picking up, sliding, putting down."""
    state, states = world.start(), [world.start()]
    while len(states) < steps:
        actions = [one for one in world.actions(state) if one.name in ("pick_up", "release", "slide")]
        state = world.step(state, actions[rng.integers(len(actions))])
        states.append(state)
    return states


@pytest.mark.parametrize("distances", [1, 4])
def test_three_balls_never_overlap_and_every_distance_is_free(page: Page, distances: int) -> None:
    world = BallWorld(3, distances)
    states = reachable(world)
    for state, found in zip(states, measured(page, states, world, carried=False), strict=True):
        assert found["ball"] > 0, state
        assert found["mark"] > 0, state
        assert found["marks"] > 0, state
        assert found["off"] < 1e-9, state
        assert found["seen"], state


def assert_apart(page: Page, world: BallWorld, carried: bool, steps: int) -> None:
    states = walk(world, steps, np.random.default_rng(steps))
    for state, found in zip(states, measured(page, states, world, carried=carried), strict=True):
        assert found["ball"] > 0, state
        assert found["off"] < 1e-9, state
        assert found["seen"], state
        if world.num_balls <= 4 and not carried:  # with more, a crowd may leave no room for a distance
            assert min(found["mark"], found["marks"]) > 0, state


SIZES = [(2, 6), (3, 6), (4, 4), (5, 4), (6, 1), (6, 6)]


@pytest.mark.parametrize("carried", [False, True], ids=["anew", "from before"])
@pytest.mark.parametrize(("balls", "distances"), SIZES[2::3])
def test_balls_never_overlap(page: Page, balls: int, distances: int, carried: bool) -> None:
    assert_apart(page, BallWorld(balls, distances), carried, steps=60)


@pytest.mark.verify
@pytest.mark.parametrize("carried", [False, True], ids=["anew", "from before"])
@pytest.mark.parametrize(("balls", "distances"), SIZES)
def test_balls_never_overlap_on_long_walks(page: Page, balls: int, distances: int, carried: bool) -> None:
    assert_apart(page, BallWorld(balls, distances), carried, steps=1500)


def test_what_an_action_does_not_touch_stays_where_it_is(page: Page) -> None:
    world = BallWorld(3, 4)
    states = walk(world, 300, np.random.default_rng(3))
    moved = kept = 0
    shown = measured(page, states, world, carried=True)
    for before, after, old, new in zip(states, states[1:], shown, shown[1:], strict=False):
        if before.placements == after.placements:  # picked up or put down
            same = all(
                np.allclose(list(old["at"][ball].values()), list(new["at"][ball].values())) for ball in "123"
            )
            moved, kept = moved + (not same), kept + same
    assert kept > 50
    assert moved <= 0.02 * kept  # a ball may have to make way for the distances
