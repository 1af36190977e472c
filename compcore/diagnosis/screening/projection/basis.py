"""The basis: what a fitted model explains of a campaign, and what it leaves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.diagnosis.screening.projection.left_out_rows import LeftOutRows
from abbe.compcore.fitting.design.nuisance import Eliminator
from abbe.compcore.fitting.fit import FitResult
from abbe.compcore.linalg import svd

F64 = NDArray[np.float64]
Index = NDArray[np.int64]

SEEN = 1e-3
"""Least part of a candidate's column (norm) outside the model's span for it to be seen at all."""

_KEPT = 3
"""Divisions of the rows that are kept as they were taken apart."""


@dataclass(frozen=True, eq=False)
class Basis:
    """What the current model explains, and what it leaves.

    Attributes
    ----------
    q
        Orthonormal basis of the weighted Jacobian's columns, set-ups' nuisances projected out,
        shape (n, rank).
    residual
        Weighted residual, shape (n,), orthogonal to q, to `extra` and to the nuisances.
    eliminator
        What projects the set-ups' nuisances out.
    extra
        Orthonormal columns that joined the model since the fit, shape (n, m).
    observations
        Number of observations where rows are not the observations themselves, but a triangular
        factor of theirs; None where they are.
    share
        Part of the observations that count as independent (`independence`): neighbours in time
        whose residuals are alike say nothing new.
    """

    q: F64
    residual: F64
    eliminator: Eliminator
    extra: F64
    observations: int | None = None
    share: float = 1.0
    _left_out: dict[int, tuple[Sequence[Index], list[LeftOutRows]]] = field(
        default_factory=dict, repr=False
    )

    @classmethod
    def of(cls, result: FitResult) -> Basis:
        """The basis at the solution of a fit."""
        none = np.zeros((result.weighted.shape[0], 0))
        return cls(result.basis, result.weighted, result.eliminator, none)

    @property
    def n(self) -> int:
        """Number of observations."""
        return len(self.residual) if self.observations is None else self.observations

    @property
    def independent(self) -> float:
        """Number of observations that count as independent."""
        return max(2.0, self.share * self.n)

    @cached_property
    def dof(self) -> int:
        """Degrees of freedom left."""
        return self.n - int(self.q.shape[1] + self.extra.shape[1]) - self.eliminator.rank

    @cached_property
    def chi2(self) -> float:
        """Weighted sum of squares left."""
        return float(self.residual @ self.residual)

    @property
    def variance(self) -> float:
        """χ² per degree of freedom; where none is left, χ² itself, which is rounding."""
        return self.chi2 / max(1, self.dof)

    def project_fitted(self, columns: F64) -> F64:
        """The part of columns (n, k) that the fitted model cannot imitate, `extra` apart."""
        left = self.eliminator.project(columns)
        left -= self.q @ (self.q.T @ left)
        return left

    def project(self, columns: F64) -> F64:
        """The part of columns (n, k) that neither the model nor `extra` can imitate."""
        left = self.project_fitted(columns)
        if self.extra.shape[1]:
            left -= self.extra @ (self.extra.T @ left)
        return left

    @cached_property
    def imitable(self) -> F64:
        """A matrix N, (n, m), by which a column c is shortened: by ``‖Nᵀc‖²``, squared.

        An orthonormal basis of the model's columns and of the set-ups' nuisances; where gauges'
        errors are whitened their part besides. `extra` is left apart.
        """
        if self.eliminator.whitening is not None:
            return np.hstack(
                [self.eliminator.project(self.q), self._nuisances, self.eliminator.common_basis()]
            )
        return np.hstack([self.q, self._nuisances])

    def left_out(self, parts: Sequence[Index]) -> list[LeftOutRows]:
        """The model without `extra`, as each part of the rows that is left out sees it.

        Worked out once for the same list of parts: whatever joins the model, q stays.
        """
        kept = self._left_out.get(id(parts))
        if kept is None or kept[0] is not parts:
            while len(self._left_out) >= _KEPT:
                del self._left_out[next(iter(self._left_out))]
            nuisances = self._nuisances
            found = []
            for rows in parts:
                own = nuisances[rows]
                found.append(LeftOutRows(np.hstack([self.q[rows], own[:, own.any(axis=0)]])))
            kept = (parts, found)
            self._left_out[id(parts)] = kept
        return kept[1]

    @property
    def _nuisances(self) -> F64:
        """Orthonormal basis of the set-ups' nuisances, (n, rank)."""
        out = np.zeros((len(self.q), self.eliminator.rank))
        at = 0
        for rows, own in self.eliminator.bases():
            out[rows, at : at + own.shape[1]] = own
            at += own.shape[1]
        return out

    @cached_property
    def moments(self) -> F64:
        """Residual and `extra` side by side, (n, 1 + m), for inner products with bare columns.

        Bare: neither projected nor whitened.
        """
        stacked = np.column_stack([self.residual, self.extra])
        return stacked if self.eliminator.whitening is None else self.eliminator.project(stacked)

    def with_residual(self, residual: F64) -> Basis:
        """The same model beside other residuals, (n,), weighted and projected: a signature."""
        return replace(self, residual=residual)

    def extended(self, columns: F64) -> Basis:
        """The basis after columns (n, k) were added to the model."""
        return self.extended_by(self.project(columns), np.linalg.norm(columns, axis=0))

    def extended_by(self, projected: F64, original: F64) -> Basis:
        """As `extended`, by columns (n, k) that are projected already; `original` their norms."""
        new = orthonormal(projected, original)
        if not new.shape[1]:
            return self
        residual = self.residual - new @ (new.T @ self.residual)
        return replace(self, residual=residual, extra=np.hstack([self.extra, new]))


def orthonormal(projected: F64, original: F64) -> F64:
    """Orthonormal basis of projected columns (n, k) that are seen, shape (n, rank).

    `original` holds the columns' norms before the projection, shape (k,).
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        scaled = np.where(original > 0.0, projected / np.where(original > 0, original, 1.0), 0.0)
    u, s, _ = svd(scaled)
    return np.asarray(u[:, s > SEEN])
