"""A step against a wander: what tells an event from a drift is that it is sudden.

Whatever wanders (a body that nobody measures, a mount that settles) stands elsewhere later than
before, and a step somewhere within its record halves what is left, also of blocks of time that were
left out: their neighbours know it. So a step is weighed beside a wander in the same direction: many
small steps, one at every moment at which the one might be (Brownian motion, of which the variance
grows with time). With V = I + λ·ZZᵀ, Z the columns of a step at each moment, and all that the model
imitates projected out,

    −2·ln L = dof·ln(rᵀV⁻¹r) + ln|V|

with λ ≥ 0 as what the step leaves asks for (generalized least squares): the step must stand out
from what happens elsewhere. Where nothing wanders λ is 0, and its evidence is that of any cause.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.diagnosis.screening.screening import Basis
from abbe.compcore.effects.base import Effect
from abbe.compcore.machine.machine import Machine

F64 = NDArray[np.float64]

_SEEN = 1e-12
"""Eigenvalues of ZᵀZ below this part of the greatest are rounding."""

_SIZES = np.concatenate([[0.0], np.logspace(-5.0, 7.0, 97)])
"""Sizes of the wander that are tried: λ in units of 1 / the greatest eigenvalue of ZZᵀ."""


def stepping(effect: Effect, machine: Machine) -> bool:
    """Whether an effect is a step at a moment that is searched for: an event."""
    return not all(p.smooth for p in effect.nonlinear(machine))


@dataclass(frozen=True, eq=False)
class Wander:
    """A wander in the direction of a step, beside what a model leaves.

    Attributes
    ----------
    basis
        What the model leaves.
    directions
        Orthonormal directions that the wander moves, shape (n, m).
    squares
        Their eigenvalues in ZZᵀ, shape (m,).
    """

    basis: Basis
    directions: F64
    squares: F64

    @classmethod
    def of(cls, basis: Basis, steps: F64) -> Wander:
        """A wander made of steps, weighted columns (n, moments), one for each moment."""
        projected = basis.project(steps)
        values, vectors = np.linalg.eigh(projected.T @ projected)
        kept = values > _SEEN * max(float(values.max(initial=0.0)), 1e-300)
        root = np.sqrt(values[kept])
        return cls(basis, projected @ (vectors[:, kept] / root), values[kept])

    def likelier_with(self, step: F64) -> float:
        """By how much −2·ln(likelihood) falls with a step, weighted columns (n, k), beside it.

        The wander is as large as is likeliest beside the step; 0 where that is not seen.
        """
        if not len(self.squares):
            return 0.0
        residual = self.basis.residual
        own = self.basis.project(step)
        both = np.column_stack([residual, own])
        along = self.directions.T @ both
        beside = both.T @ both - along.T @ along
        left = [self._left(along, beside, size) for size in _SIZES / self.squares.max()]
        alone, with_step = min(left, key=lambda pair: pair[1])
        return max(0.0, alone - with_step)

    def _left(self, along: F64, beside: F64, size: float) -> tuple[float, float]:
        """−2·ln(likelihood) with a wander of one size: without and with the step."""
        weight = 1.0 / (1.0 + size * self.squares)
        product = beside + along.T @ (weight[:, None] * along)
        volume = -float(np.log(weight).sum())
        least = 1e-12 * self.basis.chi2
        alone = float(product[0, 0])
        explained = float(
            product[0, 1:] @ np.linalg.lstsq(product[1:, 1:], product[1:, 0], rcond=1e-10)[0]
        )
        dof = self.basis.dof
        return (
            dof * np.log(max(alone, least)) + volume,
            dof * np.log(max(alone - explained, least)) + volume,
        )
