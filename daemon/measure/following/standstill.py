"""Standstill: whether a machine stands, told from its positions, against their noise."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence


class Standstill:
    """Follows positions and tells since when they have not changed.

    Parameters
    ----------
    noise
        For each axis, by how much positions may vary at rest, mm (rotary: rad).
    lasting
        s without motion after which the machine counts as standing.
    """

    def __init__(self, noise: Sequence[float], lasting: float) -> None:
        self._noise = tuple(noise)
        self._lasting = lasting
        self._rest: Sequence[float] = ()
        self._seen: deque[tuple[float, Sequence[float]]] = deque()
        self.since = float("nan")
        """Monotonic time from which on it stands, s; NaN while it moves."""

    def step(self, time: float, positions: Sequence[float]) -> bool:
        """Take in positions of a moment (monotonic, s); whether the machine stands.

        A machine that stands is only taken for moving once it has left by more than its noise: a
        slow creep is motion too, because the place where it came to rest is remembered.
        """
        if self.since == self.since:
            if all(abs(q - r) <= n for q, r, n in zip(positions, self._rest, self._noise,
                                                      strict=True)):  # fmt: skip
                return True
            self.forget()
        self._seen.append((time, positions))
        low = list(positions)
        high = list(positions)
        keep = 0
        for k in range(len(self._seen) - 1, -1, -1):
            there = self._seen[k][1]
            low = [min(a, b) for a, b in zip(low, there, strict=True)]
            high = [max(a, b) for a, b in zip(high, there, strict=True)]
            if any(h - b > n for h, b, n in zip(high, low, self._noise, strict=True)):
                keep = k + 1
                break
        for _ in range(keep):
            self._seen.popleft()
        if time - self._seen[0][0] < self._lasting:
            return False
        self.since = time
        count = len(self._seen)
        self._rest = [sum(p[1][i] for p in self._seen) / count for i in range(len(positions))]
        self._seen.clear()
        return True

    def forget(self) -> None:
        """Begin anew: positions were missing, or the machine moves."""
        self.since = float("nan")
        self._seen.clear()
