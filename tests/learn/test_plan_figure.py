"""The drawing of a plan: what it shows, and that it can be read."""

from collections.abc import Callable
from itertools import combinations

import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from tinyworld import menu

from learn.plan_figure import plan_figure, plan_tree
from learn.plots import COLOURS
from taskcomm.belief import Belief
from taskcomm.explain import Explanation
from taskcomm.planner import EntropyPlanner
from taskcomm.teacher import TeacherModel
from taskcomm.world import Action, BallWorld


def of_balls(horizon: int) -> Explanation:
    """The second question of a trial, after two presses."""
    world, model = BallWorld(), TeacherModel.intuitive()
    belief, state = Belief.initial(world, model), world.start()
    for text in ("light_on(1)", "noa!", "noa!", "pick_up(1)", "light_on(2)"):
        state = world.step(state, Action.parse(text.rstrip("!")))
        belief = belief.update(state, text.endswith("!"))
    return EntropyPlanner(world, model, horizon).plan(belief, state).explain()


def of_dishes(horizon: int) -> Explanation:
    """A teacher who presses often, and long names."""
    world, model = menu(3)
    state = world.step(world.start(), "point at paella")
    belief = Belief.initial(world, model).update(state, True)
    return EntropyPlanner(world, model, horizon).plan(belief, state).explain()


def texts(ax: Axes) -> list[str]:
    return [text.get_text() for text in ax.texts]


@pytest.mark.parametrize("horizon", [1, 2, 3, 5])
@pytest.mark.parametrize("explained", [of_balls, of_dishes])
def test_no_text_lies_over_another_or_beyond_the_figure(
    explained: Callable[[int], Explanation], horizon: int
) -> None:
    figure = plan_figure(explained(horizon), "A title")
    figure.draw_without_rendering()
    (ax,) = figure.axes
    boxes = [(text.get_text(), text.get_window_extent()) for text in ax.texts]
    for (one, its), (other, others) in combinations(boxes, 2):
        assert not its.padded(-1).overlaps(others.padded(-1)), (one, other)
    for text, box in boxes:
        assert figure.bbox.padded(1).contains(box.x0, box.y0), text
        assert figure.bbox.padded(1).contains(box.x1, box.y1), text


def test_a_tree_shows_every_likely_press_with_its_reason_and_every_ending() -> None:
    why = of_balls(4)
    for least, most in ((0.0, 99), (0.01, 5), (1.0, 99)):
        presses = why.root.likely_presses(least, most)
        ax = plan_tree(why, least=least, most=most)
        pressed = [text for text in texts(ax) if text.startswith("pressed")]
        assert len(pressed) == len(presses)
        assert sum(text.endswith("nats") for text in texts(ax)) == len(presses) + 1
        solid = [line for line in ax.lines if line.get_color() == COLOURS[1] and line.get_linestyle() == "-"]
        widths = [line.get_linewidth() for line in solid]
        assert sorted(widths) == pytest.approx(sorted(0.9 + 4 * branch.reach for branch in presses))
    assert texts(ax).count(str(why.root.action)) >= 1
    assert ax.get_title(loc="left").startswith(f"{why.root.action}: {why.root.value:.3f} nats over 2 s")


def test_a_tree_is_drawn_where_it_is_asked_for() -> None:
    figure = Figure()
    ax = figure.add_subplot()
    assert plan_tree(of_dishes(2), ax) is ax
    assert ax.get_figure() is figure
