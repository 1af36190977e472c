"""Determinacy of the unknowns: which combinations a campaign determines (SVD of the Jacobian)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.linalg import svd

F64 = NDArray[np.float64]

LEAST_INFORMATION = 1.0
"""A combination of unknowns counts as determined when moving it by a believable amount (its scale)
changes the measured values, all together, by more than this many standard uncertainties. Below, the
measurement's own estimate would be less certain than what anyone knew beforehand."""


DEMANDED = 5.0
"""Standard deviations of the residuals by which they ask for a move along a combination that no
believable amount of it would make: it is followed all the same, or a model with one more effect
could fit worse than without."""


MOST_FOLLOWED = 1e4
"""Believable amounts of a combination up to which it is followed. More of it no machine has, and
where the campaign shows nothing of a combination but rounding, any residual asks for more."""


_NO_SURER = 0.02
"""Part of an unknown's believable variance that a campaign must take away to show it."""


class Decomposition:
    """Singular value decomposition of a weighted Jacobian in units of the unknowns' scales.

    Parameters
    ----------
    triangle
        Shape (k, m): the triangular factor of the Jacobian, nuisances projected out.
    scale
        Shape (m,): believable size of each unknown.
    rows
        Number of rows of the Jacobian, for the rounding limit.

    Attributes
    ----------
    singular
        Shape (m,): how many standard uncertainties a move by one scale makes along each direction.
    directions
        Shape (m, m): columns are the directions, in units of the scales, best determined first.
    rank
        How many are determined.
    """

    def __init__(self, triangle: F64, scale: F64, rows: int) -> None:
        m = scale.shape[0]
        self.scale = scale
        u, s, vt = svd(triangle * scale, full=True)
        self.singular = np.concatenate([s, np.zeros(m - s.shape[0])])
        self.directions = vt.T
        self._left = u
        rounding = np.finfo(np.float64).eps * max(rows, m) * float(s[0] if m else 0.0)
        self._rounding = rounding
        self.rank = int((self.singular > max(LEAST_INFORMATION, rounding)).sum())

    def follow(self, projected: F64, apart: F64, spread: float) -> None:
        """Count as determined also combinations that the residuals demand beyond doubt.

        They come behind the others in `directions`.

        Parameters
        ----------
        projected
            Qᵀr as for `solve`, shape (k,).
        apart
            How far the unknowns are from where a combination that is not determined would stay,
            shape (m,).
        spread
            Standard deviation of what is left over, in units of the weights.
        """
        count = min(len(self._left.T), len(self.singular))
        asked = np.zeros(len(self.singular))
        asked[:count] = self._left.T[:count] @ projected
        asked += self.singular * (self.directions.T @ (apart / self.scale))
        beyond = np.abs(asked) > DEMANDED * max(spread, 1.0)
        beyond &= self.singular > self._rounding
        beyond &= np.abs(asked) <= MOST_FOLLOWED * self.singular
        more = np.flatnonzero(beyond[self.rank :]) + self.rank
        if not len(more):
            return
        rest = np.setdiff1d(np.arange(self.rank, len(self.singular)), more)
        order = np.concatenate([np.arange(self.rank), more, rest])
        self.singular, self.directions = self.singular[order], self.directions[:, order]
        left = np.zeros((len(self._left), len(self.singular)))
        left[:, :count] = self._left[:, :count]
        self._left = left[:, order]
        self.rank += len(more)

    @property
    def determined(self) -> F64:
        """Orthonormal directions (scaled) that the data determine, shape (m, rank)."""
        return self.directions[:, : self.rank]

    @property
    def null(self) -> F64:
        """Orthonormal directions (scaled) that the data do not determine, shape (m, m − rank)."""
        return self.directions[:, self.rank :]

    def shown(self) -> NDArray[np.bool_]:
        """Which unknowns the campaign shows at all, shape (m,).

        Of the others it makes the uncertainty smaller than what anyone knew beforehand by no more
        than `_NO_SURER`: their column is zero, or the set-ups' nuisances imitate it.
        """
        return np.asarray((self.determined**2).sum(axis=1) > _NO_SURER)

    def solve(self, projected: F64, damping: float = 0.0) -> F64:
        """The least-squares solution of least norm in units of the scales, shape (m,).

        Parameters
        ----------
        projected
            Qᵀr with Q the orthogonal factor that belongs to the triangle, shape (k,).
        damping
            Singular value below which combinations are held back (Levenberg and Marquardt).
        """
        r = self.rank
        singular = self.singular[:r]
        along = (self._left[:, :r].T @ projected) * singular / (singular**2 + damping**2)
        return np.asarray(self.scale * (self.determined @ along))

    def minimum_norm(self, theta: F64, reference: F64) -> F64:
        """θ with its undetermined part taken from `reference`, shape (m,)."""
        apart = (theta - reference) / self.scale
        return theta - self.scale * (self.null @ (self.null.T @ apart))

    def covariance(self) -> F64:
        """Covariance of the least-norm solution, shape (m, m), for weights that are right."""
        half = self.scale[:, None] * self.determined / self.singular[: self.rank]
        return np.asarray(half @ half.T)
