"""Times of two sides that take turns at the same work."""

from __future__ import annotations

import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field

Cycle = Callable[[], Awaitable[object]]


@dataclass
class Side:
    """One side's times.

    Attributes
    ----------
    durations
        Of all cycles, s.
    cpu, wall
        Processor and elapsed time of all turns, s.
    """

    durations: list[float] = field(default_factory=list)
    cpu: float = 0.0
    wall: float = 0.0

    async def turn(self, cycle: Cycle, count: int) -> None:
        """Run `count` cycles one after the other."""
        cpu, began = time.process_time(), time.perf_counter()
        for _ in range(count):
            start = time.perf_counter()
            await cycle()
            self.durations.append(time.perf_counter() - start)
        self.cpu += time.process_time() - cpu
        self.wall += time.perf_counter() - began

    def us(self, share: float) -> float:
        """A quantile, µs."""
        ordered = sorted(self.durations)
        return 1e6 * ordered[min(len(ordered) - 1, int(share * len(ordered)))]


@dataclass
class Pair:
    """Abbe and the bare loop, under the same conditions.

    Attributes
    ----------
    abbe, bare
        Their times.
    ratios
        Of the medians of each two turns.
    """

    abbe: Side = field(default_factory=Side)
    bare: Side = field(default_factory=Side)
    ratios: list[float] = field(default_factory=list)

    @property
    def ratio(self) -> float:
        """Of the medians of all cycles."""
        return self.abbe.us(0.5) / self.bare.us(0.5)
