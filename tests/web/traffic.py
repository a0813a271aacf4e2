"""What a teacher's browser receives during a trial, and whether that tells who controls the robot."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass
class Wire:
    """Every message that came to one teacher: seconds, content."""

    messages: list[tuple[float, bytes]] = field(default_factory=list)

    def __call__(self, seconds: float, content: bytes) -> None:
        self.messages.append((seconds, content))

    def trials(self) -> list[list[tuple[float, bytes]]]:
        """What came from each card to the page after the trial."""
        parts: list[list[tuple[float, bytes]]] = []
        inside = False
        for seconds, content in self.messages:
            message = json.loads(content)
            if message["type"] == "page":
                inside = message["kind"] in ("card", "wait", "trial")
                if message["kind"] == "card":
                    parts.append([])
            if inside:
                parts[-1].append((seconds, content))
        return parts


def form(trial: Sequence[tuple[float, bytes]]) -> set[tuple[Any, ...]]:
    """What kinds of messages a trial has: type, fields with their types, and the size of a frame."""
    found = set()
    for _, content in trial:
        message = json.loads(content)
        fields = tuple((name, _kind(value)) for name, value in message.items())
        size = len(content) if message["type"] == "frame" else 0
        found.add((message["type"], message.get("kind"), fields, size))
    return found


def _kind(value: Any) -> Any:
    if isinstance(value, dict):
        return tuple((name, _kind(part)) for name, part in value.items())
    return type(value).__name__


def order(trial: Sequence[tuple[float, bytes]]) -> set[tuple[str, ...]]:
    """What may come between two frames, pings left out: types in their order, equal ones in a row once."""
    types = [json.loads(content)["type"] for _, content in trial]
    types = [kind for kind in types if kind != "ping"]
    marks = [" ".join(kind for kind, _ in groupby(types))]
    return {tuple(part.split()) for part in marks[0].split("frame")}


def offsets(trial: Sequence[tuple[float, bytes]], step: float) -> Floats:
    """Milliseconds by which each frame of a step came behind the beat of the quickest."""
    at = [
        seconds for seconds, content in trial if b'"type":"frame"' in content and b'"state":"run"' in content
    ]
    behind = np.array(at) - step * np.arange(len(at))
    return np.asarray(1e3 * (behind - behind.min()))


def beginning(trial: Sequence[tuple[float, bytes]], steps: int) -> list[tuple[float, bytes]] | None:
    """What came before the frame of step `steps`; None where the trial was over by then."""
    frames = [place for place, (_, content) in enumerate(trial) if b'"state":"run"' in content]
    return list(trial[: frames[steps]]) if len(frames) > steps else None


def features(trial: Sequence[tuple[float, bytes]], step: float) -> Floats:
    """Numbers of a trial that its actions and presses do not decide: sizes and moments of what came."""
    messages = [(seconds, json.loads(content), len(content)) for seconds, content in trial]
    frames = [(seconds, size) for seconds, message, size in messages if message["type"] == "frame"]
    counted = [seconds for seconds, message, _ in messages if message["type"] == "frame" and message["count"]]
    waits = [seconds for seconds, message, _ in messages if message.get("kind") == "wait"]
    begins = [seconds for seconds, message, _ in messages if message.get("kind") == "trial"]
    pages = [size for _, message, size in messages if message["type"] == "page"]
    late = offsets(trial, step)
    gaps = np.diff([seconds for seconds, _ in frames])
    return np.array(
        [
            *np.quantile(late, [0.1, 0.5, 0.9]),
            late.std(),
            np.abs(np.diff(late)).mean(),
            np.median(gaps),
            np.mean([size for _, size in frames]),
            np.mean(pages),
            len(pages),
            len(counted),
            begins[0] - waits[0] if waits else 0.0,
            frames[0][0] - begins[0],
        ]
    )


def told_apart(
    pairs: Sequence[tuple[Floats, Floats]], rng: np.random.Generator, exchanges: int = 2000
) -> tuple[float, float]:
    """How well a classifier tells which trial of a pair is which, and how often chance does as well.

    A pair is held out; the others give the direction in which the first of a pair differs from the second;
    the member of the pair further that way is said to be the first. The share right is compared with that
    under random exchanges within pairs.
    """
    differences = np.array([first - second for first, second in pairs])
    spread = differences.std(axis=0)
    scaled = differences[:, spread > 0] / spread[spread > 0]
    scaled = np.concatenate([scaled, 1.0 * (differences[:, spread == 0] != 0)], axis=1)
    alike = scaled @ scaled.T
    np.fill_diagonal(alike, 0.0)

    def share(signs: Floats) -> float:
        votes = signs * (alike @ signs)
        return float(np.mean(np.where(votes == 0, 0.5, votes > 0)))

    found = share(np.ones(len(pairs)))
    chance = [share(rng.choice([-1.0, 1.0], len(pairs))) for _ in range(exchanges)]
    return found, (1 + sum(other >= found - 1e-12 for other in chance)) / (exchanges + 1)
