"""A pattern: basis functions of recorded quantities on one error motion, and what it is called."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.diagnosis.uncatalogued.patterns.variables import PatternVariable
from abbe.compcore.effects.base import ErrorMotion

F64 = NDArray[np.float64]

Rows = NDArray[np.int64] | slice
Values = Callable[[Rows], F64]


class Wave(NamedTuple):
    """An oscillation in `v`, growing along an axis or not, with so many harmonics."""

    v: PatternVariable
    period: float
    along: PatternVariable | None
    harmonics: int


@dataclass(frozen=True, eq=False)
class CandidatePattern:
    """One candidate description of structure.

    Attributes
    ----------
    depends_on
        Names of the recorded quantities.
    form
        In words: 'product', 'smooth function', 'oscillation with a period of …'.
    error_motion
        The error motion on which it acts.
    width
        Number k of its coefficients.
    values
        Rows → its basis functions there, shape (rows, k), unit-free.
    terms
        Formula terms, one per column; empty where no short formula says it.
    factors
        Of a product: its factors' names, a squared one twice.
    wave
        Of an oscillation: what it is made of.
    made_of
        Names of the variables in it where they are not those of `depends_on`.
    once
        Names of the variables that stand in each of its functions as a plain factor.
    """

    depends_on: tuple[str, ...]
    form: str
    error_motion: ErrorMotion
    width: int
    values: Values
    terms: tuple[str, ...] = ()
    factors: tuple[str, ...] = ()
    wave: Wave | None = None
    made_of: tuple[str, ...] = ()
    once: tuple[str, ...] = ()

    @property
    def basis(self) -> F64:
        """Its basis functions on all rows, shape (n, k)."""
        return self.values(slice(None))

    def on(self, error_motion: ErrorMotion) -> CandidatePattern:
        """The same on another error motion."""
        return replace(self, error_motion=error_motion)


@dataclass(frozen=True, eq=False)
class PatternGroup:
    """Forms of one width, each of which is tried on several error motions.

    Attributes
    ----------
    count, width
        How many forms, and the number of coefficients of each.
    values
        (first, last) of the forms, and rows → their basis functions, (forms · width, rows).
    form
        Number of a form → the pattern on any error motion, put in words.
    of
        The recorded quantity on whose value alone all of them depend, where there is one.
    """

    count: int
    width: int
    values: Callable[[tuple[int, int], Rows], F64]
    form: Callable[[int], CandidatePattern]
    of: PatternVariable | None = None


def grouped(forms: Sequence[CandidatePattern]) -> list[PatternGroup]:
    """Forms by their width."""
    by_width: dict[int, list[CandidatePattern]] = {}
    for form in forms:
        by_width.setdefault(form.width, []).append(form)

    def values(mine: Sequence[CandidatePattern], which: tuple[int, int], rows: Rows) -> F64:
        return np.concatenate([form.values(rows).T for form in mine[slice(*which)]])

    return [
        PatternGroup(len(mine), width, partial(values, mine), mine.__getitem__)
        for width, mine in by_width.items()
    ]
