# mypy: disable-error-code="import-not-found"
"""The static decision by pymdp's sophisticated inference; run in an environment that has pymdp.

    python with_pymdp.py PROBLEM.npz

One JSON object a decision: the step chosen and the seconds of processor time, compilation apart.
Hidden factors: the task (nothing moves it) and the world (its actions known). One observation, the press.
No preferences: expected free energy is information gained about the task. Nothing is pruned.
"""

import json
import sys
import time
import warnings

import numpy as np


def main(problem: str) -> None:
    warnings.filterwarnings("ignore")
    import jax
    import jax.numpy as jnp
    from pymdp.agent import Agent
    from pymdp.planning.si import si_policy_search

    given = np.load(problem)
    successor, press, horizon = given["successor"], given["press"], int(given["horizon"])
    worlds, actions = successor.shape
    tasks = press.shape[1]
    move = np.zeros((worlds, worlds, actions))
    move[successor, np.arange(worlds)[:, None], np.arange(actions)] = 1.0
    agent = Agent(
        A=[jnp.array(np.stack([1 - press.T, press.T]))],
        B=[jnp.array(np.eye(tasks)[:, :, None]), jnp.array(move)],
        C=[jnp.zeros(2)],
        D=[jnp.ones(tasks) / tasks, jnp.eye(worlds)[0]],
        A_dependencies=[[0, 1]],
        B_dependencies=[[0], [1]],
        num_controls=[1, actions],
        control_fac_idx=[1],
        policy_len=1,
        batch_size=1,
    )
    nodes = 2 + sum((2 * actions) ** (depth + 1) * 3 // 2 for depth in range(horizon))
    plan = si_policy_search(
        horizon=horizon,
        max_nodes=nodes,
        max_branching=max(actions, 2),
        policy_prune_threshold=0.0,
        observation_prune_threshold=0.0,
        entropy_stop_threshold=-1.0,
        gamma=1e4,
    )
    for number, (node, belief) in enumerate(zip(given["node"], given["belief"], strict=True)):
        now = [jnp.array(belief)[None, None], jnp.eye(worlds)[int(node)][None, None]]
        if number == 0:
            jax.block_until_ready(plan(agent, now))  # this compiles
        started = time.process_time()
        likely, _ = jax.block_until_ready(plan(agent, now))
        seconds = time.process_time() - started
        print(json.dumps({"chosen": int(np.argmax(np.asarray(likely)[0])), "seconds": seconds}), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
