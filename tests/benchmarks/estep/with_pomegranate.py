"""The E-step through pomegranate's DenseHMM on the expanded chain.

    python with_pomegranate.py PROBLEM.npz ANSWER.npz

ANSWER gets the log-likelihood of every trial and P(mental state | trial) at every press, trials in order.
Then every line on stdin names a form, and is answered by the seconds of processor time that it takes a trial.
Emission probabilities are computed beforehand, as the cues are for the lattice.
"""

import sys
import time
from collections.abc import Callable
from importlib.metadata import version
from typing import Any

import numpy as np
from benchmarks.estep.answering import serve

from learn.without_jit import without_jit


def dense_hmm(given: Any) -> Any:
    """The chain as a DenseHMM in float64."""
    with without_jit():
        import torch
        from pomegranate.distributions import Categorical
        from pomegranate.hmm import DenseHMM
    torch.set_num_threads(1)
    states = [
        Categorical(probs=[[float(p) for p in given["press"][:, s]]]) for s in range(len(given["start"]))
    ]
    with np.errstate(divide="ignore"):
        model = DenseHMM(
            states, edges=given["matrix"].tolist(), starts=given["start"].tolist(), ends=[1.0] * len(states)
        ).double()
        # The numbers as given, not as they were when they had passed through single precision.
        for name, value in (("edges", given["matrix"]), ("starts", given["start"])):
            getattr(model, name).data = torch.tensor(np.log(value))
    return model


def main(problem: str, answer: str) -> None:
    given = np.load(problem)
    presses, mental = given["presses"], given["mental"]
    model = dense_hmm(given)
    import torch

    with np.errstate(divide="ignore"):
        emissions = torch.tensor(np.log(given["press"])[presses.astype(np.int64)])
    chunks = [emissions[n : n + 100] for n in range(0, len(emissions), 100)]
    alone = [emissions[n : n + 1] for n in range(20)]

    def passes(some: Any) -> tuple[Any, Any]:
        """Forward and backward, and what is made of them; no expected transitions."""
        f, b = model.forward(emissions=some), model.backward(emissions=some)
        total = torch.logsumexp(f[:, -1] + model.ends, dim=1)
        return total, torch.exp(f + b - total[:, None, None])

    forms: dict[str, tuple[int, Callable[[], object]]] = {
        "forward and backward, all at once": (len(presses), lambda: passes(emissions)),
        "forward and backward, by hundreds": (len(presses), lambda: [passes(some) for some in chunks]),
        "forward and backward, trial by trial": (len(alone), lambda: [passes(one) for one in alone]),
        "forward_backward, by hundreds": (
            len(presses),
            lambda: [model.forward_backward(emissions=some) for some in chunks],
        ),
        "forward_backward, trial by trial": (
            len(alone),
            lambda: [model.forward_backward(emissions=one) for one in alone],
        ),
    }
    with torch.no_grad():
        total, smoothed = passes(emissions)
        _, logs, _, _, whole = model.forward_backward(emissions=chunks[0])
        np.testing.assert_allclose(whole, total[:100], atol=1e-9)
        np.testing.assert_allclose(torch.exp(logs), smoothed[:100], atol=1e-9)
        by_mental = np.stack([smoothed.numpy()[:, :, mental == m].sum(axis=2) for m in range(3)], axis=2)
        np.savez(answer, log_likelihood=total.numpy(), at_presses=by_mental[presses])
        serve(f"pomegranate {version('pomegranate')}", forms, time.process_time)


if __name__ == "__main__":
    main(*sys.argv[1:])
