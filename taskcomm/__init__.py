"""Human-robot task communication as a POMDP: world, teacher, belief, planner, robot, logs.

Names load when they are first used, so that `import taskcomm` stays as light as numpy.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_HOME = {
    "Action": "taskcomm.world",
    "BallState": "taskcomm.world",
    "BallWorld": "taskcomm.world",
    "Belief": "taskcomm.belief",
    "Certificate": "taskcomm.certificate",
    "Decision": "taskcomm.decision",
    "EntropyPlanner": "taskcomm.planner",
    "Explanation": "taskcomm.explain",
    "Final": "taskcomm.robot",
    "ImpossibleObservation": "taskcomm.belief",
    "InvalidAction": "taskcomm.world",
    "LogError": "taskcomm.logs",
    "ModelError": "taskcomm.teacher",
    "NormalChannel": "taskcomm.channels",
    "ObservationModel": "taskcomm.channels",
    "PlainChannel": "taskcomm.channels",
    "Robot": "taskcomm.robot",
    "ScriptedOperator": "taskcomm.operators",
    "SimulatedTeacher": "taskcomm.simulate",
    "TableTop": "taskcomm.teacher",
    "TargetChannel": "taskcomm.channels",
    "Task": "taskcomm.tasks",
    "TeacherModel": "taskcomm.teacher",
    "Trial": "taskcomm.trials",
    "World": "taskcomm.world",
    "read_trials": "taskcomm.logs",
    "run_trial": "taskcomm.simulate",
    "write_trials": "taskcomm.logs",
}
__all__ = [*sorted(_HOME)]

if TYPE_CHECKING:
    from taskcomm.belief import Belief as Belief
    from taskcomm.belief import ImpossibleObservation as ImpossibleObservation
    from taskcomm.certificate import Certificate as Certificate
    from taskcomm.channels import NormalChannel as NormalChannel
    from taskcomm.channels import ObservationModel as ObservationModel
    from taskcomm.channels import PlainChannel as PlainChannel
    from taskcomm.channels import TargetChannel as TargetChannel
    from taskcomm.decision import Decision as Decision
    from taskcomm.explain import Explanation as Explanation
    from taskcomm.logs import LogError as LogError
    from taskcomm.logs import read_trials as read_trials
    from taskcomm.logs import write_trials as write_trials
    from taskcomm.operators import ScriptedOperator as ScriptedOperator
    from taskcomm.planner import EntropyPlanner as EntropyPlanner
    from taskcomm.robot import Final as Final
    from taskcomm.robot import Robot as Robot
    from taskcomm.simulate import SimulatedTeacher as SimulatedTeacher
    from taskcomm.simulate import run_trial as run_trial
    from taskcomm.tasks import Task as Task
    from taskcomm.teacher import ModelError as ModelError
    from taskcomm.teacher import TableTop as TableTop
    from taskcomm.teacher import TeacherModel as TeacherModel
    from taskcomm.trials import Trial as Trial
    from taskcomm.world import Action as Action
    from taskcomm.world import BallState as BallState
    from taskcomm.world import BallWorld as BallWorld
    from taskcomm.world import InvalidAction as InvalidAction
    from taskcomm.world import World as World


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'taskcomm' has no attribute {name!r}")
    value = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
