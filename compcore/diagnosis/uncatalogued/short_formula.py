"""A short formula for what was found: the few monomials that say most of it.

A smooth function of one or two recorded quantities is found as a polynomial with many coefficients.
Written down as it is, nobody could read it, and it would run away outside the campaign. Monomials
are taken one by one, each time the one that lowers χ² most, as long as it is worth its coefficient.
A product is found with its quantities counted from the middle of what was recorded; nature counts
from elsewhere, so that its lower products are tried beside it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.diagnosis.screening.projection.bank import Trial, screen
from abbe.compcore.diagnosis.screening.projection.basis import Basis
from abbe.compcore.diagnosis.uncatalogued.patterns.pattern import CandidatePattern
from abbe.compcore.diagnosis.uncatalogued.patterns.variables import PatternVariable, term_of

F64 = NDArray[np.float64]

DEGREE = 4
"""Highest power of one quantity."""
MOST = 8
"""Most terms of a formula that is still short."""
ENOUGH = 0.9
"""Part of the fall of χ² that the short formula must keep."""
_WORTH = 6.0
"""Fall of χ² beyond the price of a coefficient that a further term must bring, in its units."""


def shortened(
    basis: Basis,
    pattern: CandidatePattern,
    quantities: Sequence[PatternVariable],
    seen: F64,
    drop: float,
) -> CandidatePattern:
    """The pattern with the formula terms that say it, where few do; else as it is.

    Parameters
    ----------
    basis
        What the model leaves.
    pattern
        A smooth function, or a product with its term.
    quantities
        The recorded quantities.
    seen
        Weighted part of the pattern's error motion in each row, shape (n,).
    drop
        Fall of χ² by the whole pattern.
    """
    chosen = list(pattern.terms)
    left = _lower(pattern, quantities) if chosen else _monomials(pattern, quantities)
    current, kept = basis, 0.0
    if chosen:
        current, kept = basis.extended(seen[:, None] * pattern.basis), drop
    while left and len(chosen) < MOST:
        names = list(left)
        trials: list[Trial] = [
            (i, {}, lambda name=name: (seen * left[name])[:, None])  # type: ignore[misc]
            for i, name in enumerate(names)
        ]
        best = max(screen(current, trials), key=lambda s: s.drop)
        scale = current.variance
        if not best.rank or best.drop < scale * (math.log(basis.n) + _WORTH):
            break
        name = names[best.key]
        chosen.append(name)
        current = current.extended((seen * left.pop(name))[:, None])
        kept += best.drop
    if not chosen or kept < ENOUGH * drop:
        return pattern
    return replace(pattern, terms=tuple(chosen))


def _monomials(pattern: CandidatePattern, quantities: Sequence[PatternVariable]) -> dict[str, F64]:
    """Term → column, shape (n,), of products of powers.

    What the description is proportional to stands once in each of them: as another power it would
    say something else, and run away in warmer hours than those recorded.
    """
    names = pattern.made_of or pattern.depends_on
    own = [q for q in quantities if q.name in names]
    once = [q for q in own if q.name in pattern.once]
    smooth = [q for q in own if q.name not in pattern.once]
    found: dict[str, F64] = {}
    for powers in product(range(DEGREE + 1), repeat=len(smooth)):
        if not any(powers) and not once:
            continue
        factors = [q for q, p in zip(smooth, powers, strict=True) for _ in range(p)] + once
        found[term_of(factors)] = np.asarray(np.prod([q.value for q in factors], axis=0))
    return found


def _lower(pattern: CandidatePattern, quantities: Sequence[PatternVariable]) -> dict[str, F64]:
    """Term → column, shape (n,), of all products of some of a product's factors."""
    by_name = {q.name: q for q in quantities}
    factors = [by_name[name] for name in pattern.factors]
    found: dict[str, F64] = {}
    for count in range(len(factors) - 1, 0, -1):
        for some in combinations(factors, count):
            found[term_of(some)] = np.asarray(np.prod([q.value for q in some], axis=0))
    return found
