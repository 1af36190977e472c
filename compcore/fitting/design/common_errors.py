"""Errors that many rows have in common: what a gauge really is, against what its certificate says.

All rows measured against one gauge share the error of its calibration, of which only the standard
uncertainty is known. So the rows' covariance is ``Σ = I + C Cᵀ`` in units of their own
uncertainties, C one column a gauge; least squares with it is least squares on whitened rows.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign

F64 = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class CommonErrors:
    """The common errors of a campaign's gauges, each in units of its standard uncertainty.

    Attributes
    ----------
    names
        The gauges.
    number
        Shape (n,): each row's gauge, −1 for rows without one.
    size
        Shape (n,): what one standard uncertainty of the gauge changes the row by, mm or rad.
    weighted
        Shape (n,): the same over the row's own standard uncertainty.
    """

    names: tuple[str, ...]
    number: Index
    size: F64
    weighted: F64

    @classmethod
    def of(cls, campaign: Campaign, weight: F64) -> CommonErrors | None:
        """Those of a campaign; None without gauges.

        Parameters
        ----------
        weight
            Shape (n,): 1/sd of each row.
        """
        if campaign.gauge is None or campaign.gauge_sd is None or not (campaign.gauge != "").any():
            return None
        unique, number = np.unique(campaign.gauge, return_inverse=True)
        number = number.reshape(-1).astype(np.int64)
        if unique[0] == "":
            unique, number = unique[1:], number - 1
        size = np.where(number >= 0, campaign.gauge_sd, 0.0)
        return cls(tuple(unique.tolist()), number, size, size * weight)

    @property
    def count(self) -> int:
        """Number of gauges, k."""
        return len(self.names)

    def times(self, amounts: F64, rows: Index | slice = slice(None)) -> F64:
        """``C a`` of some rows, weighted: (m,) or (m, j) for amounts (k,) or (k, j)."""
        return self._of(self.weighted[rows], self.number[rows], amounts)

    def unweighted(self, amounts: F64) -> F64:
        """The rows' part of the gauges' errors, shape (n,), mm or rad, for amounts (k,)."""
        return self._of(self.size, self.number, amounts)

    @staticmethod
    def _of(size: F64, number: Index, amounts: F64) -> F64:
        # rows without a gauge take any gauge's amount, times 0
        taken = amounts[number]
        return np.asarray(size * taken if amounts.ndim == 1 else size[:, None] * taken)

    def sums(self, values: F64, rows: Index | None = None) -> F64:
        """``Cᵀ v`` over all or some rows, weighted: (k,) or (k, j) for values (m,) or (m, j)."""
        number = self.number if rows is None else self.number[rows]
        size = self.weighted if rows is None else self.weighted[rows]
        out = np.zeros((self.count, *values.shape[1:]))
        order = self._order if rows is None else np.argsort(number, kind="stable")
        order = order[number[order] >= 0]
        if len(order):
            sorted_ = number[order]
            starts = np.flatnonzero(np.diff(sorted_, prepend=-1))
            weights = size[order] if values.ndim == 1 else size[order][:, None]
            out[sorted_[starts]] = np.add.reduceat(weights * values[order], starts, axis=0)
        return out

    @cached_property
    def _order(self) -> Index:
        """All rows, those of one gauge together."""
        return np.argsort(self.number, kind="stable")


@dataclass(frozen=True, eq=False)
class Whitening:
    """Whitening of rows whose set-ups' nuisances are projected out: ``W = P − P C K Cᵀ P``.

    With ``G = Cᵀ P C``: ``W W = P (I + C Cᵀ)⁻¹ P`` on what the nuisances leave.

    Attributes
    ----------
    common
        C.
    root
        K, shape (k, k).
    inverse
        ``(I + G)⁻¹``: what the rows leave open of the gauges' errors, were the model known.
    half
        A matrix H with ``H Hᵀ = (I + G)⁻¹``, shape (k, k).
    """

    common: CommonErrors
    root: F64
    inverse: F64
    half: F64

    @classmethod
    def of(cls, common: CommonErrors, bases: Iterable[tuple[Index, F64]]) -> Whitening:
        """The whitening of rows with given nuisances.

        Parameters
        ----------
        bases
            Of each set-up with nuisances: rows, orthonormal basis (m, q).
        """
        gram = np.diag(common.sums(common.weighted))
        for rows, basis in bases:
            local, place = np.unique(common.number[rows], return_inverse=True)
            seen = np.zeros((basis.shape[1], len(local)))
            np.add.at(seen.T, place.reshape(-1), common.weighted[rows][:, None] * basis)
            seen, local = seen[:, local >= 0], local[local >= 0]
            gram[np.ix_(local, local)] -= seen.T @ seen
        values, vectors = np.linalg.eigh(0.5 * (gram + gram.T))
        after = 1.0 + np.maximum(values, 0.0)
        spread = np.sqrt(after)
        return cls(
            common,
            (vectors / (spread * (spread + 1.0))) @ vectors.T,
            (vectors / after) @ vectors.T,
            vectors / spread,
        )

    def amounts(self, projected: F64) -> F64:
        """The gauges' errors that explain projected residuals (n,) best, (k,), in their sds."""
        return np.asarray(self.inverse @ self.common.sums(projected))
