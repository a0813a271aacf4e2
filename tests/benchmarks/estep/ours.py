"""The E-step of this package, timed as the peers are (see `with_pomegranate.py` for the protocol).

python ours.py PROBLEM.npz ANSWER.npz
"""

import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from benchmarks.estep.answering import serve
from benchmarks.estep.problem import MODEL, WORLD, simulated

from learn.em import prepare
from learn.estep import Evidence
from learn.exposure import expose
from learn.settings import Settings
from taskcomm.trials import Trial

PARAMETERS = MODEL.parameters(WORLD.cue_names)


def evidence(trials: Sequence[Trial]) -> Evidence:
    return Evidence(expose(trials, WORLD, MODEL))


def main(problem: str, answer: str) -> None:
    presses = np.load(problem)["presses"]
    trials = simulated(*presses.shape)
    if not np.array_equal([trial.presses for trial in trials], presses):
        raise ValueError(f"{problem}: other presses than those simulated here")
    built = evidence(trials)
    for_fit = prepare(trials, WORLD, MODEL, Settings()).evidence
    some = [evidence([trial]) for trial in trials[:50]]

    def each() -> None:
        for one in some:
            one.expect(PARAMETERS)

    one_each = np.ones(len(trials))

    def same_answer() -> None:
        built.chain.run(PARAMETERS)
        built.chain.smooth(one_each)

    forms: dict[str, tuple[int, Callable[[], object]]] = {
        "forward and backward": (len(trials), same_answer),
        "E-step": (len(trials), lambda: built.expect(PARAMETERS)),
        "E-step, lattice of a fit": (len(trials), lambda: for_fit.expect(PARAMETERS)),
        "E-step, trial by trial": (len(some), each),
        "E-step, the lattice built too": (len(trials), lambda: evidence(trials).expect(PARAMETERS)),
    }
    found = built.expect(PARAMETERS)
    reasons = np.concatenate([built.chain.reasons(unit) for unit in range(built.chain.units)])
    for other in (for_fit.expect(PARAMETERS), evidence(trials).expect(PARAMETERS)):
        np.testing.assert_allclose(other.log_likelihood, found.log_likelihood, atol=1e-9)
    np.savez(Path(answer), log_likelihood=found.log_likelihood, at_presses=reasons)
    serve("taskcomm", forms, time.process_time)


if __name__ == "__main__":
    main(*sys.argv[1:])
