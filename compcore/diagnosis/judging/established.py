"""What is to be said of an established cause: values, what it leaves, what else it could be."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.diagnosis.findings import Established, measured_kinds
from abbe.compcore.diagnosis.judging.aliases import aliases
from abbe.compcore.diagnosis.judging.foretelling import foretold
from abbe.compcore.diagnosis.screening.all_rows import measured
from abbe.compcore.diagnosis.screening.left_out.blocks import Blocks
from abbe.compcore.diagnosis.screening.pool import Pool, WeighedCandidate
from abbe.compcore.diagnosis.screening.projection.basis import Basis
from abbe.compcore.diagnosis.screening.tried import Tried
from abbe.compcore.fitting.fit import FitResult

F64 = NDArray[np.float64]


def on_all_rows(
    whole: FitResult, result: FitResult, established: Sequence[Established], tried: Tried
) -> tuple[tuple[Established, ...], float]:
    """Causes with what all rows say of them; those that all rows do not establish are left out.

    Also χ² per degree of freedom with all of them.
    """
    kept = list(established)
    while kept:
        seen, left = measured(whole, [e.found for e in kept], tried)
        standing = [m.found.established(whole.problem.n) for m in seen]
        if all(standing):
            grown = whole.rms(*measured_kinds(whole)) / result.rms(*measured_kinds(whole))
            described = [
                replace(e, found=m.found, estimates=m.estimates, rms_after=e.rms_after * grown)
                for e, m in zip(kept, seen, strict=True)
            ]
            return tuple(described), left
        kept = [e for e, stands in zip(kept, standing, strict=True) if stands]
    return (), whole.chi2 / whole.dof


def standing_together(
    pool: Pool, background: Basis, chosen: Sequence[WeighedCandidate]
) -> list[WeighedCandidate]:
    """Those causes that are established beside all the others and what is described.

    As they are reported: each was found beside fewer, and may have needed what came later. The
    weakest goes first, and the others are weighed again without it.
    """
    kept = list(chosen)
    while kept:
        weak: list[WeighedCandidate] = []
        for f in kept:
            others = pool.joined(background, (g for g in kept if g.key != f.key))
            (beside,) = pool.weighed(others, [f])
            weak += [] if beside.established(background.n) else [beside]
        if not weak:
            break
        weakest = min(weak, key=lambda f: f.evidence.value).key
        kept = [f for f in kept if f.key != weakest]
    return kept


def _rms_of(result: FitResult, weighted: F64) -> float:
    """RMS of weighted residuals in mm, or in rad where a campaign has rotations only."""
    used = result.problem.weight > 0.0
    rows = np.isin(result.problem.campaign.kind, measured_kinds(result)) & used
    left = weighted[rows] / result.problem.weight[rows]
    return float(np.sqrt(np.mean(left**2))) if rows.any() else math.nan


def established_cause(
    pool: Pool,
    basis: Basis,
    background: Basis,
    result: FitResult,
    found: WeighedCandidate,
    chosen: Sequence[WeighedCandidate],
    blocks: Blocks,
    variance: float,
    share: float,
) -> Established:
    """Everything that is to be said of one established cause, beside the others.

    `share` is the part of the campaign's rows that were looked at.
    """
    others = pool.joined(background, (f for f in chosen if f.key != found.key))
    (beside,) = pool.weighed(others, [found])
    columns = pool.found_columns(found)
    projected = others.project(columns)
    coefficients = np.linalg.lstsq(projected, others.residual, rcond=1e-10)[0]
    signature = projected @ coefficients / result.problem.weight
    # what adding it alone leaves: descriptions of other structure are not added with it
    after = pool.joined(basis, [found]).residual
    rival = pool.ranked(others, frozenset(g.key for g in chosen))
    return Established(
        beside,
        pool.estimates(others, found, variance),
        _rms_of(result, after),
        foretold(pool, others, found, blocks, pool.joined(background, chosen)),
        tuple(aliases(pool, others, found, rival, variance * share)),
        np.asarray(signature),
        np.asarray(others.residual / result.problem.weight),
    )
