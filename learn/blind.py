"""An HMM of the presses alone, blind to what the robot shows: what a learned teacher model must beat.

Source: pomegranate's DenseHMM, in float64.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from learn.without_jit import without_jit
from taskcomm.trials import Trial

Floats = NDArray[np.float64]
PAST_THE_END = -1.0


@dataclass(frozen=True)
class BlindModel:
    """Hidden states that differ in their press rate, whatever the robot does.

    `start` (S,), `transition` (S, S) and `press` (S,), probabilities per step; `log_likelihood` of
    the training trials in nats, `iterations` of EM, and whether it `converged`.
    """

    start: Floats
    transition: Floats
    press: Floats
    log_likelihood: float
    iterations: int
    converged: bool

    def score(self, trials: Sequence[Trial]) -> Floats:
        """Log-likelihood of the presses of each trial in nats, shape (trials,)."""
        return np.array([_forward(self, trial.presses) for trial in trials])


def _forward(model: BlindModel, presses: NDArray[np.bool_]) -> float:
    total, state = 0.0, model.start
    for pressed in presses:
        joint = state * (model.press if pressed else 1 - model.press)
        total += float(np.log(joint.sum()))
        state = joint / joint.sum() @ model.transition
    return total


def fit_blind(
    trials: Sequence[Trial], states: int = 2, *, max_iter: int = 100, rtol: float = 1e-5, seed: int = 0
) -> BlindModel:
    """Fit a press-rate HMM to the presses of `trials` by EM, with pomegranate.

    Press rates start spread around the mean rate, transitions mostly staying. One step's worth of
    pseudo-count at the mean rate keeps every press possible. Trials end at different steps: steps
    past a trial's end count as unseen. Raises ValueError for no trials or fewer than 1 state.
    """
    if not trials or states < 1:
        raise ValueError(f"an HMM of {states} states from {len(trials)} trials: both must be at least 1")
    lengths = [trial.num_steps for trial in trials]
    if not sum(lengths):
        raise ValueError("no steps to fit an HMM to")
    padded = np.full((len(trials), max(lengths) + 1, 1), PAST_THE_END)
    for row, trial in zip(padded, trials, strict=True):
        row[: trial.num_steps, 0] = trial.presses
    mean = (sum(float(trial.presses.sum()) for trial in trials) + 0.5) / (sum(lengths) + 1)
    return _em(padded, states, mean, max_iter, rtol, np.random.default_rng(seed))


def _em(
    padded: Floats, states: int, mean: float, max_iter: int, rtol: float, rng: np.random.Generator
) -> BlindModel:
    torch, dense_hmm, press_rate = _pomegranate()
    spread = np.array([1.0]) if states == 1 else np.geomspace(0.2, 4.0, states)
    rates = np.clip(mean * spread * rng.uniform(0.9, 1.1, states), 1e-4, 0.9)
    stay = np.full((states, states), 0.1 / max(states - 1, 1))
    np.fill_diagonal(stay, 0.9 if states > 1 else 1.0)
    model = dense_hmm(
        [press_rate(float(rate), mean) for rate in rates],
        edges=stay.tolist(),
        starts=[1 / states] * states,
        ends=[1.0] * states,
    ).double()
    with _one_thread(torch):
        kept, log_likelihood, iterations, converged = _iterate(torch, model, padded, max_iter, rtol)
    start, transition, press = kept
    order = np.argsort(press)
    return BlindModel(
        start=start[order] / start.sum(),
        transition=transition[np.ix_(order, order)],
        press=press[order],
        log_likelihood=log_likelihood,
        iterations=iterations,
        converged=converged,
    )


Numbers = tuple[Floats, Floats, Floats]


def _iterate(
    torch: Any, model: Any, padded: Floats, max_iter: int, rtol: float
) -> tuple[Numbers, float, int, bool]:
    data = torch.tensor(padded)
    before, now, iterations, converged = -np.inf, -np.inf, 0, False
    kept = _numbers(model)
    while iterations < max_iter and not converged:
        iterations += 1
        now = float(model.summarize(data).sum())
        if not np.isfinite(now):  # a state that nothing reaches has no transitions to learn
            return kept, before, iterations, False
        kept, converged = _numbers(model), now - before <= rtol * abs(now)
        before = now
        model.from_summaries()
        # A trial may end in any state: its length is the robot's doing, not the teacher's.
        model.ends.data.zero_()
        model.edges.data -= torch.logsumexp(model.edges.data, dim=1, keepdim=True)
    return kept, now, iterations, converged


@contextmanager
def _one_thread(torch: Any) -> Iterator[None]:
    """Tensors this small cost more to share out than to compute."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def _numbers(model: Any) -> Numbers:
    press = np.array([float(distribution.rate) for distribution in model.distributions])
    return model.starts.detach().exp().numpy().copy(), model.edges.detach().exp().numpy().copy(), press


@cache
def _pomegranate() -> tuple[Any, Any, Any]:
    """torch, DenseHMM, and the emission of a press. Loading takes seconds, fewer without the JIT."""
    with without_jit():
        import torch
        from pomegranate.distributions._distribution import Distribution
        from pomegranate.hmm import DenseHMM

    class PressRate(Distribution):  # type: ignore[misc]
        """P(press) of one hidden state; steps past a trial's end have probability 1 and no weight."""

        def __init__(self, rate: float, mean: float) -> None:
            super().__init__(inertia=0.0, frozen=False, check_data=False)
            self.rate = torch.nn.Parameter(torch.tensor(rate, dtype=torch.float64), requires_grad=False)
            self.mean, self._initialized, self.d = mean, True, 1
            self._reset_cache()

        def _reset_cache(self) -> None:
            self._sums = torch.tensor([self.mean, 1.0], dtype=torch.float64)  # one step at the mean rate

        def log_probability(self, X: Any) -> Any:
            pressed = X[:, 0]
            seen = torch.where(pressed > 0, self.rate, 1 - self.rate).log()
            return torch.where(pressed == PAST_THE_END, 0.0, seen)

        def summarize(self, X: Any, sample_weight: Any = None) -> None:
            weight = sample_weight[:, 0] * (X[:, 0] != PAST_THE_END)
            self._sums += torch.stack([(weight * X[:, 0]).sum(), weight.sum()])

        def from_summaries(self) -> None:
            self.rate.data = self._sums[0] / self._sums[1]
            self._reset_cache()

    return torch, DenseHMM, PressRate
