"""What was known before decides between causes that a campaign cannot tell apart.

A thermometer of a pair reads differences 8 % too large. On the campaign alone that is one more tilt
by one temperature, with another coefficient of the tilt by the difference; but the model as it was
given knows that coefficient, and beside the thermometer's gain it still holds.
"""

from __future__ import annotations

from collections.abc import Sequence

from abbe.compcore.diagnosis.changed import standing
from abbe.compcore.diagnosis.findings import Established
from abbe.compcore.diagnosis.screening.pool import Pool, WeighedCandidate
from abbe.compcore.diagnosis.screening.projection.basis import Basis
from abbe.compcore.fitting.fit import FitResult
from abbe.compcore.model.model import Model

_MOST = 8
"""Aliases of a cause that are tried in its place, the likeliest first."""


def beside_which_it_holds(
    given: Model,
    result: FitResult,
    pool: Pool,
    background: Basis,
    established: Sequence[Established],
) -> list[WeighedCandidate] | None:
    """The causes with one exchanged for an alias beside which the model as given holds.

    None where it holds beside the causes as they are, or beside none of their aliases.

    Parameters
    ----------
    given, result
        The model with values and covariance, and the same effects fitted to the campaign.
    pool, background
        The candidates, and what the model leaves beside structure that is only described.
    established
        The causes that the campaign establishes.
    """
    found = [e.found for e in established]
    columns = [pool.found_columns(f) for f in found]
    holds = standing(given, result, columns)
    if holds is None or not holds.changes or holds.suspicions:
        return None
    for i, cause in enumerate(established):
        others = found[:i] + found[i + 1 :]
        beside = pool.joined(background, others)
        for alias in pool.weighed(beside, [a.found for a in cause.aliases[:_MOST]]):
            if not alias.established(background.n):
                continue
            own = [*columns[:i], *columns[i + 1 :], pool.found_columns(alias)]
            instead = standing(given, result, own)
            if instead is not None and not instead.changes and not instead.suspicions:
                return [*found[:i], alias, *found[i + 1 :]]
    return None
