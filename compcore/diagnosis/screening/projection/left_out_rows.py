"""Rows that are left out of a fit: taken apart once for a model, whatever columns join it.

With the hat matrix ``H = QQᵀ`` the residuals of left-out rows B are ``(I − H_BB)⁺ r_B``: by the
small side, ``r + Q f(QᵀQ) Qᵀr`` with the rows of Q. What joins a model only borders QᵀQ.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]

ALONE = 0.02
"""Eigenvalues of I − H_BB below this: combinations that the left-out rows alone determine."""

_OUTSIDE = 1e-9
"""Eigenvalues of QᵀQ below this are zeros with rounding."""

_WHOLLY = 1e-12
"""Eigenvalues of I − H_BB up to this: no other row sees anything of the combination."""

_SURELY = 1e-6
"""Least eigenvalue of what tells whether rows alone determine more, to go by its sign."""


class LeftOutRows:
    """Rows that are left out of a model's fit, and of fits that columns joined.

    Parameters
    ----------
    q
        The rows, (b, m), of an orthonormal basis of all that the model has.
    """

    def __init__(self, q: F64) -> None:
        self._q = q

    def foretold(self, more: F64, residual: F64) -> tuple[F64, int]:
        """Residuals (b,) as the fit without these rows leaves them.

        And how many combinations of the columns the rows alone determine: these are fitted to them.

        Parameters
        ----------
        more
            These rows, (b, c), of columns that are orthonormal and orthogonal to the model's.
        residual
            What the model with all columns leaves of them, (b,).
        """
        bare = self._bare
        if not more.shape[1]:
            return bare.foretold(residual)
        return bare.beside(more, residual) or bare.bordered(more, residual)

    @cached_property
    def _bare(self) -> TakenApart:
        return TakenApart.of(self._q)


@dataclass(frozen=True, eq=False)
class TakenApart:
    """H_BB of left-out rows by its eigenvectors.

    Attributes
    ----------
    wholly
        Orthonormal directions (b, w) of which no other row sees anything.
    others
        Orthonormal directions (b, k) of all others with an eigenvalue that is not 0.
    hat
        Their eigenvalues of H_BB, (k,), ascending.
    """

    wholly: F64
    others: F64
    hat: F64

    @classmethod
    def of(cls, q: F64) -> TakenApart:
        """Of the left-out rows, (b, m), of orthonormal columns."""
        square, v = np.linalg.eigh(q.T @ q)
        # directions with an eigenvalue of nearly 0 are not in Q and stay as they are
        inside = square > _OUTSIDE
        square = square[inside]
        u = q @ (v[:, inside] / np.sqrt(square))
        shared = int((1.0 - square > _WHOLLY).sum())
        return cls(u[:, shared:], u[:, :shared], square[:shared])

    @cached_property
    def _shared(self) -> int:
        """How many of the others the rows do not determine alone."""
        return int((1.0 - self.hat >= ALONE).sum())

    @property
    def _count(self) -> int:
        return int(self.wholly.shape[1]) + len(self.hat) - self._shared

    def foretold(self, residual: F64) -> tuple[F64, int]:
        """As `LeftOutRows.foretold`, without more columns."""
        left = self._beside(residual)
        alone = self.others[:, self._shared :]
        return self._solved(left - alone @ (alone.T @ left)), self._count

    def beside(self, more: F64, residual: F64) -> tuple[F64, int] | None:
        """As `LeftOutRows.foretold`, by Woodbury's formula.

        None where that does not say it: other rows hardly see something that these determine, or
        these alone determine more than before (Haynsworth's sum of inertias tells).
        """
        if self._shared < len(self.hat):
            return None
        more = self._beside(more)
        along = self.others.T @ more
        inside = 1.0 - ALONE
        lift = (1.0 / (inside - self.hat) - 1.0 / inside)[:, None] * along
        told = np.eye(more.shape[1]) - more.T @ more / inside - along.T @ lift
        if float(np.linalg.eigvalsh(told)[0]) < _SURELY:
            return None
        grown = self._solved(more)
        left = self._solved(self._beside(residual))
        inner = np.eye(more.shape[1]) - more.T @ grown
        return left + grown @ np.linalg.solve(inner, more.T @ left), self._count

    def bordered(self, more: F64, residual: F64) -> tuple[F64, int]:
        """As `LeftOutRows.foretold`, by eigenvectors of all but what no other row sees."""
        q = np.hstack([self.others * np.sqrt(self.hat), self._beside(more)])
        residual = self._beside(residual)
        square, v = np.linalg.eigh(q.T @ q)
        alone = 1.0 - square < ALONE
        # 1 / (1 − s) of what others see as well, nothing left of what they do not
        grown = 1.0 / np.where(alone, -square, 1.0 - square)
        along = v @ (grown * (v.T @ (q.T @ residual)))
        return residual + q @ along, self.wholly.shape[1] + int(alone.sum())

    def _beside(self, values: F64) -> F64:
        """Values, (b,) or (b, c), without what no other row sees anything of."""
        return np.asarray(values - self.wholly @ (self.wholly.T @ values))

    def _solved(self, values: F64) -> F64:
        """(I − H_BB)⁻¹ of values, (b,) or (b, c), free of what the rows alone determine."""
        others, hat = self.others[:, : self._shared], self.hat[: self._shared]
        along = others.T @ values
        along = (along.T * (hat / (1.0 - hat))).T
        return np.asarray(values + others @ along)
