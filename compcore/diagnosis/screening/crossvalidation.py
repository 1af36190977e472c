"""Cross-validation by whole set-ups and blocks of time: does an added cause predict unseen data?

Residuals are correlated within a set-up and in time, so rows are never left out one by one. The
set-ups are dealt, in order of time, into folds; a set-up that runs through the day (a master point
revisited) is cut into as many blocks of time. Leaving a fold out is exact and needs no refit: with
H = QQᵀ the hat matrix, the residuals of left-out rows B are ``(I − H_BB)⁺ r_B``. What only the
left-out rows determine (their own zero, a line measured once) is fitted to them, as in use.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.diagnosis.screening.screening import Basis

F64 = NDArray[np.float64]

_OUTSIDE = 1e-9
"""Eigenvalues of QᵀQ below this are zeros with rounding."""

_ALONE = 0.02
"""Eigenvalues of I − H_BB below this: combinations that the left-out rows alone determine."""


def folds(
    setup: NDArray[np.str_] | None, time: F64, run: NDArray[np.int64] | None, count: int = 8
) -> list[NDArray[np.int64]]:
    """Row indices of each fold.

    Parameters
    ----------
    setup, time, run
        Set-up name, time (s) and run of each row, shape (n,); None where there is but one.
    count
        Number of folds; fewer where there are fewer blocks.
    """
    n = time.shape[0]
    clock = np.lexsort((time, np.zeros(n) if run is None else run))
    order = np.empty(n)
    order[clock] = np.arange(n)
    names = np.zeros(n, dtype="<U1") if setup is None else setup
    unique, inverse = np.unique(names, return_inverse=True)
    inverse = inverse.reshape(-1)
    blocks: list[tuple[float, NDArray[np.int64]]] = []
    for i in range(len(unique)):
        rows = np.flatnonzero(inverse == i)
        rows = rows[np.argsort(order[rows], kind="stable")]
        extent = np.ptp(order[rows]) + 1
        # a set-up spread over much more of the clock than its own rows is cut by time
        pieces = count if extent > 4 * len(rows) and len(rows) >= 2 * count else 1
        blocks += [(float(order[p].mean()), p) for p in np.array_split(rows, pieces)]
    blocks.sort(key=lambda block: block[0])
    used = min(count, len(blocks))
    dealt: list[list[NDArray[np.int64]]] = [[] for _ in range(used)]
    for i, (_, rows) in enumerate(blocks):
        dealt[i % used].append(rows)
    return [np.sort(np.concatenate(fold)) for fold in dealt]


def left_out(basis: Basis, rows: list[NDArray[np.int64]]) -> float:
    """Σ of squared residuals of left-out rows over all folds, in units of the weights."""
    total = 0.0
    nuisances = _nuisances(basis)
    for fold in rows:
        own = nuisances[fold]
        q = np.hstack([basis.q[fold], basis.extra[fold], own[:, own.any(axis=0)]])
        r = basis.residual[fold]
        # (I − QQᵀ)⁺ r by the small side: eigenvectors of QᵀQ; directions with an eigenvalue of
        # nearly 0 are not in Q and stay as they are
        square, v = np.linalg.eigh(q.T @ q)
        inside = square > _OUTSIDE
        u = q @ (v[:, inside] / np.sqrt(square[inside]))
        part = u.T @ r
        keep = 1.0 - square[inside]
        alone = keep < _ALONE
        grown = np.where(alone, 0.0, part / np.where(alone, 1.0, keep))
        outside = r - u @ part
        total += float(outside @ outside + grown @ grown)
    return total


def _nuisances(basis: Basis) -> F64:
    """Orthonormal basis of all set-ups' nuisances, shape (n, q)."""
    out = np.zeros((basis.n, basis.eliminator.rank))
    at = 0
    for rows, own in basis.eliminator.bases():
        out[rows, at : at + own.shape[1]] = own
        at += own.shape[1]
    return out


def gain(basis: Basis, columns: F64, rows: list[NDArray[np.int64]], before: float) -> float:
    """Part of the left-out residual variance that added columns (n, k) remove.

    0.3 means that unseen set-ups are predicted with 30 % less variance; negative: worse. `before`
    is `left_out` of the basis without the columns.
    """
    after = left_out(basis.extended(columns), rows)
    return 1.0 - after / before if before > 0.0 else 0.0
