"""Growth of a process's memory over the lives of a soak, with how sure it is."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.special import stdtrit

SETTLED = 600.0
"""s of a life after which memory should not grow any more."""
MOST = 2.0
"""MB an hour by which it may."""
_BLOCK = 60.0
"""s over which looks are averaged: what is taken and given back within them is no growth."""
_FEWEST = 10
"""Averages below which nothing is said."""
_LEVEL = 0.975
"""Quantile of the uncertainty: 95 % on both sides."""


@dataclass(frozen=True)
class Growth:
    """How fast memory grew.

    Attributes
    ----------
    slope, uncertainty
        MB an hour; ± with 95 %.
    watched
        s, of all lives together.
    """

    slope: float
    uncertainty: float
    watched: float

    @property
    def shown(self) -> bool:
        """Whether it is certain that it grew faster than `MOST`."""
        return self.slope - self.uncertainty > MOST

    def __str__(self) -> str:
        """In words, for a report."""
        if self.shown:
            verdict = f"it grows by more than {MOST:g}"
        elif self.slope + self.uncertainty <= MOST:
            verdict = f"it does not grow by more than {MOST:g}"
        else:
            verdict = f"whether it grows by more than {MOST:g} cannot be told from this"
        slope = f"{self.slope:+.2f} ± {self.uncertainty:.2f} MB an hour"
        return f"{slope} in {self.watched:.0f} s: {verdict}"


@dataclass
class MemoryCurve:
    """Memory over the lives of a process.

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
    def growth(self) -> Growth | None:
        """Slope of all lives after they have settled; None where too little was seen.

        One straight line by least squares, of which each life has its own height. What is left
        hangs together from one minute to the next, so that it counts for fewer looks than there
        are: n (1 − r) / (1 + r) with its autocorrelation r, as for trends of the climate
        (Santer et al., J. Geophys. Res. 105 (2000) 7337, doi:10.1029/1999JD901105).
        """
        lives = [blocks for life in self.lives if len(blocks := _blocks(life)) > 2]
        count = sum(map(len, lives))
        if count < _FEWEST:
            return None
        times, sizes = zip(*((life - life.mean(axis=0)).T for life in lives), strict=True)
        squares = sum(float(t @ t) for t in times)
        slope = sum(float(t @ s) for t, s in zip(times, sizes, strict=True)) / squares
        left = [s - slope * t for t, s in zip(times, sizes, strict=True)]
        rest = sum(float(e @ e) for e in left)
        alike = sum(float(e[1:] @ e[:-1]) for e in left) / rest if rest else 0.0
        worth = count * (1.0 - alike) / (1.0 + alike) if alike > 0.0 else float(count)
        # heights and the slope were taken from the same looks
        free = worth - len(lives) - 1
        unsure = math.inf
        if free > 0.0:
            unsure = float(stdtrit(free, _LEVEL)) * math.sqrt(rest / free / squares)
        return Growth(3600.0 * slope, 3600.0 * unsure, _BLOCK * count)


def _blocks(life: list[tuple[float, float]]) -> np.ndarray:
    """Mean age (s) and size (MB) of each whole block of a life that has settled, as rows."""
    settled = np.array([look for look in life if look[0] >= SETTLED]).reshape(-1, 2)
    number = ((settled[:, 0] - SETTLED) // _BLOCK).astype(int)
    # the last one is not whole
    means = [settled[number == n].mean(axis=0) for n in np.unique(number)[:-1]]
    return np.array(means).reshape(-1, 2)
