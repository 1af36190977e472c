"""How many of a campaign's rows are independent: neighbours in time say the same again.

Readings every few seconds of a body that warms for hours err together. What n of them say is what
``ν·n`` independent ones would, ``1/ν = 1 + 2·Σ ρ_k``, ρ_k the correlation of residuals k rows apart
within a set-up, in order of time (Bartlett's formula; the sum ends where two neighbouring terms are
together no longer positive, Geyer's rule, Statistical Science 7 (1992) 473). Without a clock, the
rows of one place that was read again are such neighbours.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.diagnosis.screening.left_out.crossvalidation import clock_order, setup_rows
from abbe.compcore.diagnosis.screening.left_out.repeated_places import rows_that_say_more
from abbe.compcore.machine.conditions import Conditions

F64 = NDArray[np.float64]

_FEWEST = 8
"""Set-ups with fewer rows say nothing of how residuals go on."""


def independent_share(residual: F64, conditions: Conditions) -> float:
    """Part of the rows that count as independent, above 0 and at most 1.

    Parameters
    ----------
    residual
        Weighted residuals, shape (n,).
    conditions
        Set-up, run and time of each row.
    """
    if not np.ptp(conditions.time) > 0.0:
        own = setup_rows(conditions)
        say = sum(rows_that_say_more(residual[r], conditions.rows(r)) for r in own)
        return say / len(residual)
    order = clock_order(conditions)
    series = [
        residual[rows[np.argsort(order[rows], kind="stable")]]
        for rows in setup_rows(conditions)
        if len(rows) >= _FEWEST and np.ptp(conditions.time[rows]) > 0.0
    ]
    total = sum(float(r @ r) for r in series)
    counted = sum(len(r) for r in series)
    if not series or total <= 0.0:
        return 1.0
    covariances = [_autocovariance(r) for r in series]
    rho = np.zeros(max(len(c) for c in covariances))
    for c in covariances:
        rho[: len(c)] += c / total
    pairs = rho[1 : 2 * ((len(rho) - 1) // 2) + 1].reshape(-1, 2).sum(axis=1)
    ends = np.flatnonzero(pairs <= 0.0)
    correlated = float(pairs[: ends[0] if len(ends) else len(pairs)].sum())
    rows_each = 1.0 + 2.0 * correlated
    share = 1.0 / max(1.0, rows_each)
    # rows of short set-ups stand for themselves
    return (share * counted + len(residual) - counted) / len(residual)


def _autocovariance(values: F64) -> F64:
    """Σ r_i·r_{i+k} for k = 0 … m/2, by the Fourier transform."""
    m = len(values)
    spectrum = np.fft.rfft(values, 2 * m)
    return np.asarray(np.fft.irfft(np.abs(spectrum) ** 2, 2 * m)[: m // 2 + 1])
