"""Growth of a process's memory over the lives of a soak, with how sure it is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

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
_ALIKE = np.linspace(0.0, 0.995, 200)
"""How strongly what is left of one minute may hang together with what is left of the next."""
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

    def text(self) -> str:
        """All looks as CSV: number of the life, age in s, MB."""
        looks = (
            f"{number},{age:.1f},{size:.3f}"
            for number, life in enumerate(self.lives, 1)
            for age, size in life
        )
        return "\n".join(["life,age_s,memory_mb", *looks]) + "\n"

    @property
    def longest(self) -> list[tuple[float, float]]:
        """The longest life."""
        return max(self.lives, key=lambda life: life[-1][0] if life else 0.0, default=[])

    @property
    def growth(self) -> Growth | None:
        """Slope of all lives after they have settled; None where too little was seen.

        One straight line, of which each life has its own height. What is left of it hangs together
        from one minute to the next: an autoregressive process of first order, by generalized least
        squares (Prais & Winsten, Cowles Commission Discussion Paper 383, 1954). How strongly it
        hangs together is not known: every strength counts by how likely it makes the looks (the
        restricted likelihood, Harville, JASA 72 (1977) 320, doi:10.1080/01621459.1977.10480998).
        """
        lives = [blocks for life in self.lives if len(blocks := _blocks(life)) > 2]
        count = sum(map(len, lives))
        if count < _FEWEST:
            return None
        free = count - len(lives) - 1
        lines = [_line(lives, alike, free) for alike in _ALIKE]
        likely = np.array([line.likely for line in lines])
        weights = np.exp(likely - likely.max())
        weights /= weights.sum()
        slopes = np.array([line.slope for line in lines])
        slope = float(weights @ slopes)
        variances = np.array([line.variance for line in lines]) * free / (free - 2.0)
        variance = float(weights @ (variances + (slopes - slope) ** 2))
        # a Student's t of this variance
        spread = math.sqrt(variance * (free - 2.0) / free)
        unsure = float(stdtrit(free, _LEVEL)) * spread
        return Growth(3600.0 * slope, 3600.0 * unsure, _BLOCK * count)


class _Line(NamedTuple):
    """A straight line through all lives for one strength: slope, its variance, log likelihood."""

    slope: float
    variance: float
    likely: float


def _line(lives: Sequence[np.ndarray], alike: float, free: int) -> _Line:
    first = math.sqrt(1.0 - alike * alike)
    normal = np.zeros((len(lives) + 1, len(lives) + 1))
    right = np.zeros(len(lives) + 1)
    squares = 0.0
    for number, life in enumerate(lives):
        design = np.zeros((len(life), len(lives) + 1))
        design[:, 0] = life[:, 0] - life[:, 0].mean()
        design[:, number + 1] = 1.0
        size = life[:, 1] - life[:, 1].mean()
        design = np.vstack([first * design[:1], design[1:] - alike * design[:-1]])
        size = np.concatenate([first * size[:1], size[1:] - alike * size[:-1]])
        normal += design.T @ design
        right += design.T @ size
        squares += float(size @ size)
    inverse = np.linalg.inv(normal)
    found = inverse @ right
    # what was weighed is a multiple of kilobytes: nothing left at all is no certainty
    left = max(squares - float(right @ found), 1e-9)
    likely = (
        len(lives) * math.log(first)
        - 0.5 * float(np.linalg.slogdet(normal)[1])
        - 0.5 * free * math.log(left)
    )
    return _Line(float(found[0]), left / free * float(inverse[0, 0]), likely)


def _blocks(life: list[tuple[float, float]]) -> np.ndarray:
    """Mean age (s) and size (MB) of each whole block of a life that has settled, as rows."""
    settled = np.array([look for look in life if look[0] >= SETTLED]).reshape(-1, 2)
    number = ((settled[:, 0] - SETTLED) // _BLOCK).astype(int)
    # the last one is not whole
    means = [settled[number == n].mean(axis=0) for n in np.unique(number)[:-1]]
    return np.array(means).reshape(-1, 2)
