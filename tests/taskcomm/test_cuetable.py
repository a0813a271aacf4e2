"""Cue tables become trials, and whatever is amiss in them gets one clear error."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from learn import log_likelihood
from taskcomm.belief import Belief
from taskcomm.cuetable import read_cue_tables, read_with_places, validate_cue_tables
from taskcomm.cueworld import CueWorld, Show, intuitive_for
from taskcomm.logs import LogError
from taskcomm.teacher import TableTop, TeacherModel
from taskcomm.trials import Step, Trial
from taskcomm.world import InvalidAction, World

GOOD = """trial_id,participant_id,t,press,light,tone
a,p1,0,0,0,0
a,p1,1,1,1,0
b,p1,0,0,1,1
c,p2,0,1,0,1
"""


@pytest.fixture
def table(tmp_path: Path) -> Callable[..., Path]:
    def write(text: str, name: str = "cues.csv") -> Path:
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write


def as_parquet(path: Path) -> Path:
    """The same table in Parquet, its columns of the types that they look like."""
    from pyarrow import csv, parquet

    out = path.with_suffix(".parquet")
    parquet.write_table(csv.read_csv(path), out)
    return out


def test_a_cue_table_is_read_as_trials_of_a_world_of_its_cues(table: Callable[..., Path]) -> None:
    trials, places = read_with_places(table(GOOD), dt=0.1)
    world = CueWorld(("light", "tone"))
    assert isinstance(world, World)
    assert [(trial.trial_id, trial.participant_id, trial.trial_index) for trial in trials] == [
        ("a", "p1", 0),
        ("b", "p1", 1),
        ("c", "p2", 0),
    ]
    assert all(trial.world == world and trial.dt == 0.1 and trial.source == "cue table" for trial in trials)
    assert trials[0].states == (frozenset(), frozenset({"light"}))
    assert trials[0].presses.tolist() == [False, True]
    assert places["c"].endswith("cues.csv:5")


def test_parquet_and_csv_hold_the_same_trials(table: Callable[..., Path]) -> None:
    path = table(
        GOOD.replace("press", "press,dt")
        .replace(",0,0,0\n", ",0,0.25,0,0\n")
        .replace(",1,1,0\n", ",1,0.25,1,0\n")
        .replace(",0,1,1\n", ",0,0.25,1,1\n")
        .replace(",1,0,1\n", ",1,0.25,0,1\n")
    )
    trials = read_cue_tables(path)
    assert trials[0].dt == 0.25
    assert read_cue_tables(as_parquet(path)) == trials


def test_values_may_be_written_as_other_programs_write_them(table: Callable[..., Path]) -> None:
    plain = read_cue_tables(table(GOOD), dt=0.1)
    other = GOOD.replace(",1,1,1,0", ",1,1.0,TRUE,False").replace("trial_id", "\ufefftrial_id")
    assert read_cue_tables(table(other.replace("\n", "\r\n"), "other.csv"), dt=0.1) == plain


@pytest.mark.parametrize("nothing", ["", "NA", "nan"])
def test_a_press_that_was_not_recorded_is_unknown_and_not_absent(
    table: Callable[..., Path], nothing: str
) -> None:
    trial = read_cue_tables(table(GOOD.replace("a,p1,1,1,1,0", f"a,p1,1,{nothing},1,0")), dt=0.5)[0]
    assert [step.pressed for step in trial.steps] == [False, None]
    model = intuitive_for(CueWorld(("light", "tone")), 0.5)
    first = Belief.initial(trial.world, model).press_probability(trial.states[0])
    assert log_likelihood([trial], trial.world, model) == pytest.approx(np.log1p(-first))


def test_rows_of_trials_may_alternate_and_columns_stand_anywhere(table: Callable[..., Path]) -> None:
    mixed = "tone,press,t,trial_id\n0,0,0,a\n1,0,0,b\n1,1,1,a\n"
    first, second = read_cue_tables(table(mixed), dt=1.0)
    assert (first.num_steps, second.num_steps) == (2, 1)
    assert first.states[1] == frozenset({"tone"})


def test_the_order_of_columns_and_trials_changes_no_likelihood(table: Callable[..., Path]) -> None:
    head, *rows = [line.split(",") for line in GOOD.splitlines()]
    order = [5, 2, 0, 4, 3, 1]
    turned = [[row[at] for at in order] for row in (head, *rows[2:], *rows[:2])]
    values = []
    for path in (table(GOOD), table("\n".join(map(",".join, turned)), "turned.csv")):
        trials = read_cue_tables(path, dt=0.5)
        model = TeacherModel(
            0.01, {"a": TableTop("tone", 0.2, 1.0, 2.0), "b": TableTop("light", 0.1, 0.5, 1.0)}
        )
        values.append(log_likelihood(trials, trials[0].world, model))
    assert values[0] == pytest.approx(values[1], rel=1e-12)


def test_several_tables_are_one_study(table: Callable[..., Path]) -> None:
    more = "trial_id,t,press,tone,light\nd,0,0,1,0\n"
    trials = read_cue_tables([table(GOOD), table(more, "more.csv")], dt=0.5)
    assert len(trials) == 4
    assert trials[3].states[0] == frozenset({"tone"})
    assert trials[3].world == trials[0].world


@pytest.mark.parametrize(
    ("change", "line", "reason"),
    [
        (("a,p1,1,1,1,0", "a,p1,2,1,1,0"), 3, "column 't': trial 'a' has 2 here, where 1 is due"),
        (("a,p1,1,1,1,0", "a,p1,0.5,1,1,0"), 3, "column 't': must count the steps .* not be '0.5'"),
        (("a,p1,1,1,1,0", "a,p1,-1,1,1,0"), 3, "column 't': must count"),
        (("a,p1,1,1,1,0", "a,p1,x,1,1,0"), 3, "column 't': must count"),
        (("a,p1,1,1,1,0", "a,p1,inf,1,1,0"), 3, "column 't': must count"),
        (("a,p1,1,1,1,0", "a,p1,nan,1,1,0"), 3, "column 't': must count"),
        (("a,p1,1,1,1,0", "a,p2,1,1,1,0"), 3, "column 'participant_id': trial 'a' has 'p2' here"),
        (("b,p1,0,0,1,1", "b,,0,0,1,1"), 4, "column 'participant_id': empty"),
        (("b,p1,0,0,1,1", ",p1,0,0,1,1"), 4, "column 'trial_id': empty"),
        (("b,p1,0,0,1,1", "b,p1,0,2,1,1"), 4, "column 'press': must be 0 or 1, not '2'"),
        (("b,p1,0,0,1,1", "b,p1,0,0,0.5,1"), 4, "column 'light': must be 0 or 1, not '0.5'; every column"),
        (("b,p1,0,0,1,1", "b,p1,0,0,,1"), 4, "column 'light': must be 0 or 1, not ''"),
    ],
)
def test_a_bad_cell_is_named_with_file_line_and_column(
    table: Callable[..., Path], change: tuple[str, str], line: int, reason: str
) -> None:
    path = table(GOOD.replace(*change))
    with pytest.raises(LogError, match=rf"cues\.csv:{line}: {reason}"):
        read_cue_tables(path, dt=0.1)
    report = validate_cue_tables(path, dt=0.1)
    assert not report.ok
    assert len(report.problems) == 1
    assert report.trials == 2  # the others are read all the same


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "empty: a cue table begins with the names"),
        ("trial_id,t,press,light\n", "no rows"),
        ("trial_id,t,light\na,0,1\n", "column 'press' is missing; there are trial_id, t, light"),
        ("trial_id,t,press\na,0,1\n", "no cue: every column but"),
        ("trial_id,t,press,light,light\na,0,1,1,1\n", "column 'light' is there twice"),
        (",trial_id,t,press,light\n0,a,0,1,1\n", "column 1 has no name"),
        ("trial_id;t;press;light\na;0;1;1\n", "its columns must be separated by commas"),
        ('trial_id,t,press,"a,b"\na,0,1,1\n', "cue_names: 'a,b' cannot name a cue"),
        ("trial_id,t,press,light\na,0,1\n", "line 2 has 3 cells, the first line has 4"),
        ('trial_id,t,press,light\n"a"b,0,1,1\n', "line 2 is not CSV"),
    ],
)
def test_a_table_of_the_wrong_form_gets_one_error(table: Callable[..., Path], text: str, reason: str) -> None:
    path = table(text)
    with pytest.raises(LogError, match=rf"cues\.csv: {reason}"):
        read_cue_tables(path, dt=0.1)
    (problem,) = validate_cue_tables(path, dt=0.1).problems
    assert reason.split(";")[0] in str(problem)


def test_what_cannot_be_a_table_is_named(tmp_path: Path, table: Callable[..., Path]) -> None:
    (tmp_path / "bytes.csv").write_bytes(b"trial_id\xff")
    (tmp_path / "bytes.parquet").write_bytes(b"trial_id,t,press,light\n")
    with pytest.raises(LogError, match=r"bytes\.csv: not UTF-8"):
        read_cue_tables(tmp_path / "bytes.csv", dt=0.1)
    with pytest.raises(LogError, match=r"bytes\.parquet: not a Parquet file"):
        read_cue_tables(tmp_path / "bytes.parquet", dt=0.1)
    for name in ("none.csv", "none.parquet"):
        with pytest.raises(LogError, match=f"{name}: no such file"):
            read_cue_tables(tmp_path / name, dt=0.1)
    with pytest.raises(LogError, match="no cue table was given"):
        read_cue_tables([])
    other = table("trial_id,t,press,smell\nz,0,0,1\n", "other.csv")
    with pytest.raises(LogError, match=r"other\.csv: its cues are smell, those of .*cues\.csv light, tone"):
        read_cue_tables([table(GOOD), other], dt=0.1)
    with pytest.raises(LogError, match=r"again\.csv:2: trial 'a' is there twice, first in .*cues\.csv:2"):
        read_cue_tables([table(GOOD), table(GOOD, "again.csv")], dt=0.1)


def test_parquet_without_pyarrow_is_one_clear_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    with pytest.raises(LogError, match=r"a\.parquet: Parquet files need pyarrow: pip install"):
        read_cue_tables(tmp_path / "a.parquet", dt=0.1)


def test_the_length_of_a_step_must_be_known_and_one(table: Callable[..., Path]) -> None:
    with pytest.raises(LogError, match=r"cues\.csv: the length of a step is not known: give it in seconds"):
        read_cue_tables(table(GOOD))
    with pytest.raises(LogError, match="dt: must be a positive number of seconds, not 0"):
        read_cue_tables(table(GOOD), dt=0)
    column = "trial_id,t,press,light,dt\na,0,0,1,0.1\na,1,0,1,{}\n"
    assert read_cue_tables(table(column.format("0.1")))[0].dt == 0.1
    with pytest.raises(LogError, match=r"cues\.csv:3: column 'dt': 0.2 s, where 0.1 s came before"):
        read_cue_tables(table(column.format("0.2")))
    with pytest.raises(LogError, match=r"cues\.csv:3: column 'dt': must be a positive number"):
        read_cue_tables(table(column.format("-1")))
    with pytest.raises(LogError, match=r"cues\.csv:2: column 'dt': 0.1 s, where 0.5 s was given"):
        read_cue_tables(table(column.format("0.1")), dt=0.5)


def test_a_world_of_cues_takes_any_combination_and_no_other() -> None:
    world = CueWorld(("light", "tone"))
    assert len(world.actions(world.start())) == len(set(map(str, world.actions(world.start())))) == 4
    for action in world.actions(world.start()):
        state = world.step(frozenset({"tone"}), action)
        assert world.cues(state).ravel().tolist() == ["light" in action.cues, "tone" in action.cues]
    with pytest.raises(InvalidAction, match=r"show\(smell\) is not valid in a world of the cues light, tone"):
        world.step(world.start(), Show(frozenset({"smell"})))
    with pytest.raises(ValueError, match="too many combinations"):
        CueWorld(tuple(f"cue{n}" for n in range(13))).actions(frozenset())


@pytest.mark.parametrize("names", [(), ("a", "a"), ("a,b",), ("",), (" a",), ("a(b",)])
def test_cue_names_that_actions_cannot_be_written_with_are_refused(names: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match="cue_names: "):
        CueWorld(names)


@given(dt=st.floats(0.01, 30.0), cues=st.integers(1, 30))
def test_there_is_an_intuitive_model_for_any_step_and_number_of_cues(dt: float, cues: int) -> None:
    model = intuitive_for(CueWorld(tuple(f"cue{n}" for n in range(cues))), dt)
    total = model.mistake + sum(top.peak for top in model.approvals.values())
    half_second = 0.005 + min(0.1 * cues, 0.3)
    assert model.dt == dt
    assert np.log1p(-total) / dt == pytest.approx(np.log1p(-half_second) / 0.5)


@st.composite
def shown(draw: st.DrawFn) -> tuple[Trial, TeacherModel]:
    """A trial of up to four cues and 26 steps of any length, some not recorded, and a model for it."""
    dt = draw(st.sampled_from([0.05, 0.5, 5.0]))
    world = CueWorld(tuple(f"cue{n}" for n in range(draw(st.integers(1, 4)))))
    table = draw(
        st.lists(
            st.tuples(st.sets(st.sampled_from(world.cue_names)), st.sampled_from([True, False, False, None])),
            max_size=25,
        )
    )
    steps = [Step(world.show(on), pressed) for on, pressed in [(set[str](), None), *table]]
    times = st.floats(dt, 8 * dt)
    tops = {
        f"that_{name}": TableTop(
            name,
            peak=draw(st.floats(0.01, 0.2)),
            rise=draw(times),
            fall=draw(times),
            delay=draw(st.floats(0, 2 * dt)),
            decay=draw(st.one_of(st.none(), times)),
        )
        for name in world.cue_names
    }
    return Trial("t", world, world.tasks[0], tuple(steps), dt=dt), TeacherModel(0.01, tops, dt=dt)


@given(shown(), st.integers(0, 25))
def test_nothing_is_assumed_of_what_came_after_the_last_row(
    case: tuple[Trial, TeacherModel], length: int
) -> None:
    """A trial that ends early has the likelihood of the steps that were seen, whatever came after."""
    from dataclasses import replace

    trial, model = case
    belief, value = Belief.initial(trial.world, model), 0.0
    kept = replace(trial, steps=trial.steps[: length + 1])
    for state, step in zip(trial.states, kept.steps, strict=False):
        press = belief.press_probability(state)
        if step.pressed is not None:
            value += np.log(press if step.pressed else 1 - press)
        belief = belief.update(state, step.pressed)
    assert log_likelihood([kept], trial.world, model) == pytest.approx(value, rel=1e-9, abs=1e-9)
