"""Growth of a process's memory over the longest life of a soak."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

SETTLED = 600.0
"""s after which memory should not grow any more; in a short life half of it."""


@dataclass
class MemoryCurve:
    """Resident memory over the lives of a process.

    Attributes
    ----------
    lives
        For each life (age in s, MB) as it was looked at.
    """

    lives: list[list[tuple[float, float]]] = field(default_factory=list)

    def begin(self) -> None:
        """Another life."""
        self.lives.append([])

    def note(self, age: float, megabytes: float) -> None:
        """One look."""
        if megabytes == megabytes:
            self.lives[-1].append((age, megabytes))

    @property
    def longest(self) -> list[tuple[float, float]]:
        """The longest life."""
        return max(self.lives, key=lambda life: life[-1][0] if life else 0.0, default=[])

    @property
    def growth(self) -> float:
        """MB an hour in the longest life, after it has settled; NaN where too little was seen.

        A straight line by least squares through what was seen.
        """
        life = self.longest
        if len(life) < 10:
            return float("nan")
        settled = min(SETTLED, life[-1][0] / 2)
        age, megabytes = np.array([look for look in life if look[0] >= settled]).T
        return float(np.polyfit(age - age[0], megabytes, 1)[0] * 3600.0)
