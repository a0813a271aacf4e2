# mypy: disable-error-code="import-not-found"
"""The E-step through dynamax's HMM inference on the expanded chain; run in an environment that has dynamax.

    python with_dynamax.py PROBLEM.npz ANSWER.npz

As `with_pomegranate.py`. Double precision, compiled, one thread; compilation is not timed.
"""

import sys
import time
from collections.abc import Callable
from functools import partial
from importlib.metadata import version
from typing import Any

import numpy as np
from answering import serve


def each(run: Callable[[Any], Any], given: list[Any]) -> list[Any]:
    return [run(one) for one in given]


def main(problem: str, answer: str) -> None:
    import jax
    import jax.numpy as jnp
    from dynamax.hidden_markov_model.inference import hmm_smoother, hmm_two_filter_smoother

    jax.config.update("jax_enable_x64", True)
    given = np.load(problem)
    presses, mental = given["presses"], given["mental"]
    start, matrix = jnp.array(given["start"]), jnp.array(given["matrix"])
    with np.errstate(divide="ignore"):
        emissions = jnp.array(np.log(given["press"])[presses.astype(np.int64)])
    alone = [emissions[n] for n in range(50)]

    def smoothing(smoother: Any, counts: bool) -> Any:
        plain = smoother.__wrapped__  # compiled within what is compiled here, where `counts` can be said

        def one(log_likelihoods: Any) -> tuple[Any, ...]:
            found = plain(start, matrix, log_likelihoods, compute_trans_probs=counts)
            return (found.marginal_loglik, found.smoothed_probs, *([found.trans_probs] if counts else []))

        return one

    forms: dict[str, tuple[int, Callable[[], object]]] = {}

    def add(name: str, trials: int, run: Callable[[Any], object], given: Any) -> None:
        forms[name] = (trials, lambda: jax.block_until_ready(run(given)))

    found: Any = None
    for name, smoother in (("two-filter smoother", hmm_two_filter_smoother), ("smoother", hmm_smoother)):
        one = smoothing(smoother, counts=False)
        together, single = jax.jit(jax.vmap(one)), jax.jit(one)
        add(f"{name}, all at once", len(presses), together, emissions)
        in_turn = jax.jit(partial(jax.lax.map, one))
        add(f"{name}, one after another in one call", len(presses), in_turn, emissions)
        add(f"{name}, trial by trial", len(alone), partial(each, single), alone)
        total, smoothed = (np.asarray(x) for x in together(emissions))
        if found is not None:
            np.testing.assert_allclose(total, found[0], atol=1e-9)
            np.testing.assert_allclose(smoothed, found[1], atol=1e-9)
        found = (total, smoothed)
    by_hundreds = jax.jit(jax.vmap(smoothing(hmm_two_filter_smoother, counts=False)))
    chunks = jnp.split(emissions, max(1, len(presses) // 100))
    add("two-filter smoother, by hundreds", len(presses), partial(each, by_hundreds), chunks)
    counted = jax.jit(jax.vmap(smoothing(hmm_two_filter_smoother, counts=True)))
    add("two-filter smoother with transitions, all at once", len(presses), counted, emissions)
    add("two-filter smoother with transitions, all at once", len(presses), counted, emissions)
    by_mental = np.stack([found[1][:, :, mental == m].sum(axis=2) for m in range(3)], axis=2)
    np.savez(answer, log_likelihood=found[0], at_presses=by_mental[presses])
    serve(f"dynamax {version('dynamax')}, jax {version('jax')}", forms, time.process_time)


if __name__ == "__main__":
    main(*sys.argv[1:])
