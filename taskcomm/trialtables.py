"""Trials as tables: trials, steps, presses, labels, ratings, events."""

import json
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from typing import Any

from taskcomm.tables import Column, Table
from taskcomm.trials import Trial
from taskcomm.world import BallWorld

TRIAL = Column("trial_id", "string", "Id of the trial")
PARTICIPANT = Column("participant_id", "string", "Id of the participant, who was the teacher")
OPERATOR = Column(
    "operator_id", "string", "Id of the operator seated in the trial, whoever controlled the robot"
)
T = Column("t", "integer", "Step of the trial, from 0; in events before the first step it is missing")
TIME = Column(
    "time", "number", "Time since the first step was due, at the start of this one; pauses not counted", "s"
)
SOURCE = Column(
    "source", "string", "Whether the teacher was a person or a program", values=("human", "simulated")
)
REASON = "Reason of the press (mistake, that_mov, that_wrt, that_dist, ...)"


def trial_tables(trials: Sequence[Trial], practice: Sequence[str] = ()) -> list[Table]:
    """Every table of these trials; `practice` are the ids of those that do not count."""
    return [
        _trials(trials, frozenset(practice)),
        _steps(trials),
        _presses(trials),
        _labels(trials),
        _ratings(trials),
        _events(trials),
    ]


def _trials(trials: Sequence[Trial], practice: frozenset[str]) -> Table:
    columns = (
        TRIAL,
        PARTICIPANT,
        OPERATOR,
        Column("study", "string", "Name of the study"),
        Column("practice", "boolean", "Whether the trial was practice, which no analysis should count"),
        Column("trial_index", "integer", "Place of the trial among those of the participant, from 0"),
        Column("condition", "string", "Condition of the trial"),
        Column("controller", "string", "Who controlled the robot", values=("planner", "operator")),
        Column("mov", "integer", "Task on the teacher's card: ball to move"),
        Column("wrt", "integer", "Task on the teacher's card: ball that it is moved with respect to"),
        Column(
            "dist", "integer", "Task on the teacher's card: distance between the two, in places of the scale"
        ),
        Column("shown_mov", "integer", "Task displayed with Final: ball to move"),
        Column("shown_wrt", "integer", "Task displayed with Final: ball that it is moved with respect to"),
        Column("shown_dist", "integer", "Task displayed with Final: distance between the two"),
        Column(
            "end",
            "string",
            "How the trial ended; missing where its log broke off",
            values=("final", "timeout", "aborted"),
        ),
        Column("correct", "boolean", "Whether Final displayed the task of the card; false after a timeout"),
        Column("num_steps", "integer", "Number of steps"),
        Column("duration", "number", "Time from the first step to the end, pauses not counted", "s"),
        Column("dt", "number", "Length of a step", "s"),
        Column("num_balls", "integer", "Balls in the world"),
        Column("num_distances", "integer", "Distances on the scale"),
        Column("num_presses", "integer", "Steps in which the teacher pressed the spacebar"),
        Column("num_defaults", "integer", "Steps with no action since none was chosen in time"),
        Column("num_unrecorded", "integer", "Steps whose key was not recorded, the connection being lost"),
        Column("num_resumed", "integer", "How often the trial went on after a crash of the server"),
        Column("robot_model", "string", "Name of the robot's teacher model"),
        Column("robot_model_sha256", "string", "Hash of the robot's teacher model"),
        Column("horizon", "integer", "Horizon of the planner", "steps"),
        Column("threshold", "number", "Probability of a task above which the robot displays Final"),
        Column("started_utc", "datetime", "When the trial was opened, in UTC"),
        SOURCE,
        Column("taskcomm_version", "string", "Version of the software that ran the trial"),
    )
    rows = [_trial(trial, trial.trial_id in practice) for trial in trials]
    title = "One row for each trial, practice included"
    return Table("trials", title, columns, rows, ("trial_id",), {"participant_id": "participants"})


def _trial(trial: Trial, practice: bool) -> dict[str, Any]:
    world, model, planner = trial.world, trial.robot_model or {}, trial.planner or {}
    row: dict[str, Any] = {
        name: getattr(trial, name)
        for name in ("trial_id", "participant_id", "operator_id", "trial_index", "condition", "correct")
    }
    row |= {name: getattr(trial, name) for name in ("num_steps", "dt", "source", "taskcomm_version")}
    row |= {"study": trial.session, "practice": practice, "end": trial.reason, "duration": trial.duration}
    row |= {"controller": "planner" if planner or model else "operator"}
    row |= {name: getattr(trial.task, name, None) for name in ("mov", "wrt", "dist")}
    row |= {f"shown_{name}": getattr(trial.displayed, name, None) for name in ("mov", "wrt", "dist")}
    if isinstance(world, BallWorld):
        row |= {"num_balls": world.num_balls, "num_distances": world.num_distances}
    return row | {
        "num_presses": int(trial.presses.sum()),
        "num_defaults": sum(step.action_source == "default" for step in trial.steps),
        "num_unrecorded": int((~trial.recorded).sum()) if trial.steps else 0,
        "num_resumed": sum(event.get("type") == "resume" for event in trial.events),
        "robot_model": model.get("name"),
        "robot_model_sha256": model.get("sha256"),
        "horizon": planner.get("horizon"),
        "threshold": planner.get("threshold"),
        "started_utc": trial.started_utc,
    }


def _steps(trials: Sequence[Trial]) -> Table:
    columns = (
        TRIAL,
        T,
        TIME,
        Column("action", "string", "Action of the robot at the start of the step, as it is written"),
        Column("action_name", "string", "Kind of the action: noa (none), light_on, light_off, pick_up, ..."),
        Column("ball", "integer", "Ball that the action is of"),
        Column("distance", "integer", "Distance that the ball slides to"),
        Column("reference", "integer", "Ball that the distance is from"),
        Column(
            "action_source",
            "string",
            "Who chose the action; default: nobody in time, hence no action",
            values=("planner", "operator", "default"),
        ),
        Column("lit", "string", "Balls that are lit during the step, with blanks between"),
        Column("held", "integer", "Ball that the robot holds during the step; missing: none"),
        Column("press", "boolean", "Whether the spacebar went down in the step; missing: not recorded"),
        Column("late", "number", "How late the step began", "ms"),
        Column("plan_time", "number", "How long the planner took for the action", "ms"),
        Column("true_state", "string", "Mental state of a simulated teacher; people have none here"),
    )
    rows = [row for trial in trials for row in _steps_of(trial)]
    return Table(
        "steps",
        "One row for each step of each trial",
        columns,
        rows,
        ("trial_id", "t"),
        {"trial_id": "trials"},
    )


def _steps_of(trial: Trial) -> list[dict[str, Any]]:
    rows = []
    for t, (step, state) in enumerate(zip(trial.steps, trial.states, strict=True)):
        timing, action = step.timing or {}, step.action
        row = {"trial_id": trial.trial_id, "t": t, "time": _rounded(t * trial.dt), "action": str(action)}
        row |= {"action_name": getattr(action, "name", str(action)), "action_source": step.action_source}
        row |= {name: getattr(action, name, None) for name in ("ball", "distance", "reference")}
        if isinstance(trial.world, BallWorld):
            row |= {"lit": " ".join(map(str, sorted(state.lit))), "held": state.held}  # type: ignore[attr-defined]
        row |= {"press": step.pressed, "true_state": step.mental_state}
        rows.append(row | {"late": timing.get("late_ms"), "plan_time": timing.get("plan_ms")})
    return rows


def _presses(trials: Sequence[Trial]) -> Table:
    columns = (
        TRIAL,
        T,
        TIME,
        Column("key_events", "integer", "How often the spacebar went down in the step, as received"),
        Column(
            "client_time", "number", "Browser's time of the first of these, since 1970 by its own clock", "ms"
        ),
        Column("true_state", "string", "Mental state of a simulated teacher; people have none here"),
        Column("label", "string", f"{REASON} that most annotators gave; missing where as many gave another"),
        Column("num_annotators", "integer", "How many annotators labelled the press"),
    )
    rows = []
    for trial in trials:
        keys = _keys(trial)
        labelled, reasons = trial.labelled, trial.reasons
        for t, step in enumerate(trial.steps):
            if not step.pressed:
                continue
            row: dict[str, Any] = {"trial_id": trial.trial_id, "t": t, "time": _rounded(t * trial.dt)}
            row |= (
                {"key_events": len(keys[t]), "client_time": _number(keys[t][0].get("at"))}
                if t in keys
                else {}
            )
            row |= {"true_state": step.mental_state, "num_annotators": len(labelled.get(t, ()))}
            rows.append(row | {"label": reasons.get(t) if t in labelled else None})
    title = "One row for each step in which the spacebar was pressed"
    return Table("presses", title, columns, rows, ("trial_id", "t"), {"trial_id": "trials"})


def _keys(trial: Trial) -> dict[Any, list[Mapping[str, Any]]]:
    """The events of the key by step: as they say, or, where none does, by their place among the steps."""
    events = [event for event in trial.events if event.get("kind") == "press"]
    said = any("t" in event for event in events)
    found: dict[Any, list[Mapping[str, Any]]] = {}
    for event in events:
        t = event.get("t") if said else bisect_left(trial.step_seqs, event.get("seq", 0))
        found.setdefault(_whole(t), []).append(event)
    return found


def _labels(trials: Sequence[Trial]) -> Table:
    columns = (
        TRIAL,
        T,
        Column("annotator_id", "string", "Id of the annotator, who was shown no belief of the robot"),
        Column("mental_state", "string", f"{REASON}, as this annotator judged last"),
    )
    rows = [
        {"trial_id": trial.trial_id, "t": t, "annotator_id": who or "unnamed", "mental_state": state}
        for trial in trials
        for t, said in sorted(trial.labelled.items())
        for who, state in said.items()
    ]
    title = "One row for each press and annotator who labelled it by hand"
    return Table("labels", title, columns, rows, ("trial_id", "t", "annotator_id"), {"trial_id": "trials"})


def _ratings(trials: Sequence[Trial]) -> Table:
    columns = (
        TRIAL,
        PARTICIPANT,
        Column("item", "string", "Question that was answered"),
        Column("value", "string", "Answer as given"),
        Column("number", "number", "Answer, where it is a number"),
        Column("low", "integer", "Lowest answer on the scale"),
        Column("high", "integer", "Highest answer on the scale"),
    )
    rows = []
    for trial in trials:
        for line in {line["item"]: line for line in trial.ratings}.values():
            scale = line.get("scale")
            ends = scale if isinstance(scale, dict) else {}
            if isinstance(scale, list | tuple) and len(scale) == 2:
                ends = {"low": scale[0], "high": scale[1]}
            row = {"trial_id": trial.trial_id, "participant_id": trial.participant_id, "item": line["item"]}
            row |= answer(line["value"])
            rows.append(row | {end: ends[end] for end in ("low", "high") if isinstance(ends.get(end), int)})
    title = "One row for each question answered after a trial"
    refers = {"trial_id": "trials", "participant_id": "participants"}
    return Table("ratings", title, columns, rows, ("trial_id", "item"), refers)


def _events(trials: Sequence[Trial]) -> Table:
    columns = (
        TRIAL,
        Column("seq", "integer", "Place of the event among the lines of the trial's log"),
        Column(
            "kind", "string", "What happened: press, away, back, pause, go_on, focus, resume, timing, ..."
        ),
        T,
        Column("server_time", "number", "Server's time of the event since the first step was due", "ms"),
        Column("details", "string", "Everything else that was noted of it, as a JSON object"),
    )
    rows = []
    for trial in trials:
        for event in trial.events:
            rest = {k: v for k, v in event.items() if k not in ("type", "kind", "seq", "t", "server_ms")}
            row = {"trial_id": trial.trial_id, "seq": event.get("seq"), "t": _whole(event.get("t"))}
            row |= {"kind": str(event.get("kind", event.get("type", "event")))}
            details = json.dumps(rest, ensure_ascii=False, sort_keys=True) if rest else None
            rows.append(row | {"server_time": _number(event.get("server_ms")), "details": details})
    title = "One row for everything noted beside the steps: keys, connections, pauses, timing"
    return Table("events", title, columns, rows, ("trial_id", "seq"), {"trial_id": "trials"})


def answer(value: Any) -> dict[str, Any]:
    """An answer in the columns `value` and `number`."""
    return {"value": value, "number": _number(value)}


def _number(value: Any) -> float | int | None:
    return value if isinstance(value, int | float) and not isinstance(value, bool) else None


def _whole(value: Any) -> int | None:
    return value if isinstance(value, int) and not isinstance(value, bool) else None


def _rounded(seconds: float) -> float:
    return round(seconds, 9)
