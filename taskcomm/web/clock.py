"""The clock of a trial: every step at its own time from the start, so that lateness does not add up."""

import asyncio
import time
from dataclasses import dataclass, field

_STALL = 0.25  # seconds that a tick must be late to be a stall, however short the steps
_READ = 0.01  # seconds, after a stall, for what came in it: it belongs to the step that the stall lengthened


@dataclass
class Clock:
    """Deadlines `step` seconds apart, on the monotonic clock of the machine.

    A pause moves all that comes after it, and so does a tick that is late by half a step: what follows a
    stall of the machine is no burst of short steps. `late` keeps by how much each tick came too late, in ms.
    """

    step: float
    origin: float = 0.0
    late: list[float] = field(default_factory=list)

    def start(self, ticks: int = 0) -> None:
        """Tick `ticks` is due now."""
        self.origin = time.monotonic() - ticks * self.step

    @property
    def elapsed_ms(self) -> float:
        """Time since tick 0 was due, in ms, pauses and stalls left out."""
        return 1e3 * (time.monotonic() - self.origin)

    def due(self, tick: int) -> float:
        """When a tick is due, on the monotonic clock."""
        return self.origin + tick * self.step

    async def until(self, tick: int) -> float:
        """Wait for a tick; by how many ms it came late. Later ones are moved by a stall."""
        await asyncio.sleep(max(0.0, self.due(tick) - time.monotonic()))
        late = 1e3 * (time.monotonic() - self.due(tick))
        self.late.append(late)
        if self.stalled(late):
            await asyncio.sleep(_READ)
            self.start(tick)
        return late

    def stalled(self, late: float) -> bool:
        """Whether a tick so many ms late moves the clock."""
        return late >= 1e3 * max(self.step / 2, _STALL)

    def summary(self) -> dict[str, float]:
        """Ticks, and their lateness in ms: median, 99th percentile, greatest; missed: late by a step."""
        late = sorted(self.late) or [0.0]
        at = [late[min(len(late) - 1, int(share * len(late)))] for share in (0.5, 0.99)]
        missed = sum(ms >= 1e3 * self.step for ms in self.late)
        return {
            "ticks": len(self.late),
            "late_ms_median": round(at[0], 3),
            "late_ms_p99": round(at[1], 3),
            "late_ms_max": round(late[-1], 3),
            "missed": missed,
        }
