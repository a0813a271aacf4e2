# mypy: ignore-errors
"""The static decision by pomdp-py's POUCT; run in an environment that has pomdp-py.

    python with_pomdp_py.py PROBLEM.npz SIMULATIONS

One JSON object a decision: the step chosen and the seconds of processor time.
Rewards are of states and actions there, not of beliefs: instead of lowering the entropy, the robot may
name the task at any time, rewarded with 1 if it is right, after at most `horizon` steps of asking.
"""

import json
import random
import sys
import time

import numpy as np


def main(problem: str, simulations: str) -> None:
    import pomdp_py

    given = np.load(problem)
    successor, press, count = given["successor"].tolist(), given["press"].tolist(), given["count"].tolist()
    horizon, tasks = int(given["horizon"]), len(press[0])
    named = -1  # the world after a task was named

    steps = [pomdp_py.SimpleAction(f"step {a}") for a in range(max(count))]
    names = [pomdp_py.SimpleAction(f"name {task}") for task in range(tasks)]
    stepping = {action.name: a for a, action in enumerate(steps)}
    naming = {action.name: task for task, action in enumerate(names)}

    class Transition(pomdp_py.TransitionModel):
        def sample(self, state, action):
            task, world = state.data
            at = named if world == named or action.name in naming else successor[world][stepping[action.name]]
            return pomdp_py.SimpleState((task, at))

    class Observation(pomdp_py.ObservationModel):
        def sample(self, next_state, action):
            task, world = next_state.data
            return pomdp_py.SimpleObservation(world != named and random.random() < press[world][task])

    class Reward(pomdp_py.RewardModel):
        def sample(self, state, action, next_state):
            task, world = state.data
            return float(world != named and naming.get(action.name) == task)

    class Policy(pomdp_py.RolloutPolicy):
        def get_all_actions(self, state=None, history=None):
            return steps[: count[state.data[1]]] + names if state.data[1] != named else steps[:1]

        def rollout(self, state, history=None):
            return random.choice(self.get_all_actions(state))

    random.seed(1)
    for node, belief in zip(given["node"].tolist(), given["belief"].tolist(), strict=True):
        start = {pomdp_py.SimpleState((task, node)): p for task, p in enumerate(belief)}
        agent = pomdp_py.Agent(
            pomdp_py.Histogram(start), Policy(), Transition(), Observation(), Reward()
        )  # fmt: skip
        planner = pomdp_py.POUCT(
            max_depth=horizon + 1,
            discount_factor=1.0,
            num_sims=int(simulations),
            exploration_const=0.5,
            rollout_policy=agent.policy_model,
        )
        started = time.process_time()
        planner.plan(agent)
        seconds = time.process_time() - started
        values = [agent.tree[action].value for action in steps[: count[node]]]
        print(json.dumps({"chosen": values.index(max(values)), "seconds": seconds}), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
