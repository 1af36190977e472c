"""Aliases: what this campaign cannot tell from the winner, and the measurement that would.

For a winner with signature ``v = C⊥·β`` in the residuals and another candidate with projected
columns D⊥, what of v the other cannot imitate is ``λ = ‖v − P_{D⊥}v‖²`` in units of the noise
variance: the χ² by which the two can be told apart. The cosine of the (principal) angle between v
and the other's span is ``√(1 − λ/‖v‖²)``. Below `CERTAINLY_APART` they are aliases for
this campaign. Another that it could tell from the winner, and that explains as much all the same,
is one too: then either may be part of the cause.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.diagnosis.screening.evidence import INDISTINCT
from abbe.compcore.diagnosis.screening.levers import shift_of
from abbe.compcore.diagnosis.screening.pool import Pool, WeighedCandidate
from abbe.compcore.diagnosis.screening.projection.basis import Basis, orthonormal

F64 = NDArray[np.float64]

CERTAINLY_APART = 14.0
"""χ² from which two causes are told apart with certainty (some 3.7 standard deviations)."""


@dataclass(frozen=True, eq=False)
class Alias:
    """A candidate that the campaign cannot tell from another, or that explains as much.

    Attributes
    ----------
    found
        The other candidate.
    separation
        χ² by which the campaign tells the two apart.
    cosine
        Cosine of the angle between the signature and the other's span.
    """

    found: WeighedCandidate
    separation: float
    cosine: float

    @property
    def told_apart(self) -> bool:
        """Whether the campaign could tell the two apart, were one of them the whole cause."""
        return self.separation >= CERTAINLY_APART


def aliases(
    pool: Pool,
    background: Basis,
    winner: WeighedCandidate,
    others: Sequence[WeighedCandidate],
    variance: float,
) -> list[Alias]:
    """Which of the others are aliases of the winner, the likeliest first.

    All of them say the same, as far as this campaign can tell: the commoner before the rarer.

    Parameters
    ----------
    background
        The model with every other established cause, without the winner.
    variance
        Noise variance in units of the weights (χ² per degree of freedom once all is explained).
    """
    columns = pool.found_columns(winner)
    own = orthonormal(background.project(columns), np.linalg.norm(columns, axis=0))
    signature = own @ (own.T @ background.residual)
    strength = float(signature @ signature)
    if strength <= 0.0:
        return []
    imitated = pool.imitated(background, signature)
    cause = winner.candidate.cause
    found: list[Alias] = []
    for each in others:
        other = _at_its_lag(pool, background, winner, each)
        if other is not each:
            (seen,) = pool.weighed(background.with_residual(signature), [other])
            imitated[other.key] = seen.screened.drop
        if other.key not in imitated or other.candidate.cause == cause:
            continue  # the same cause in other detail is no alias
        missed = max(0.0, strength - imitated[other.key])
        separation = missed / variance
        worse = winner.evidence.value - other.evidence.value
        if separation < CERTAINLY_APART or worse < INDISTINCT:
            found.append(Alias(other, separation, float(np.sqrt(1.0 - missed / strength))))
    found.sort(key=lambda a: (-a.found.evidence.value, a.separation))
    return found


def _at_its_lag(
    pool: Pool, background: Basis, winner: WeighedCandidate, other: WeighedCandidate
) -> WeighedCandidate:
    """What grows or leans by the signals of a shift that lags behind them, behind the same lag.

    It was tried at a few lags only, each some way off.
    """
    lag = winner.screened.nonlinear
    if not lag or lag.keys() != other.screened.nonlinear.keys():
        return other
    if not shift_of(winner.candidate.effect, other.candidate.effect):
        return other
    same = replace(other, screened=replace(other.screened, nonlinear=lag))
    (weighed,) = pool.weighed(background, [same])
    return weighed
