"""A step against a wander: what tells an event from a drift, a joint from a curve: it is sudden.

Whatever wanders (a body that nobody measures, a mount that settles) stands elsewhere later than
before, and a step somewhere within its record halves what is left, also of blocks of time that were
left out: their neighbours know it. So a step is weighed beside a wander in the same direction: many
small steps, one at every moment at which the one might be (Brownian motion, of which the variance
grows with time). With V = I + λ·ZZᵀ, Z the columns of a step at each moment, and all that the model
imitates projected out,

    −2·ln L = dof·ln(rᵀV⁻¹r) + ln|V|

with λ ≥ 0 as what the step leaves asks for (generalized least squares): the step must stand out
from what happens elsewhere. Where nothing wanders λ is 0, and its evidence is that of any cause.

A body that is heated or cooled from a moment on moves no more before and after than elsewhere, and
fast in between, but not at once. So the step is also weighed against the same change in a finite
time, ``1 − e^(−(t − t₁)/τ)`` for t ≥ t₁: where that is likelier by more than what a further
coefficient costs, nothing happened suddenly.

A joint of a scale is a step along an axis. What wanders there is the axis's error motion, and the
step must stand out from that as an event from a wander.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.diagnosis.screening.projection.basis import Basis
from abbe.compcore.effects.base import Effect
from abbe.compcore.machine.machine import Machine

F64 = NDArray[np.float64]

_SEEN = 1e-12
"""Eigenvalues of ZᵀZ below this part of the greatest are rounding."""

_SIZES = np.concatenate([[0.0], np.logspace(-5.0, 7.0, 97)])
"""Sizes of the wander that are tried: λ in units of 1 / the greatest eigenvalue of ZZᵀ."""


_TIME_CONSTANTS = 16
"""Time constants that are tried of a gradual change, from between two readings to the record."""

_BEGAN = np.log(2.0) * np.array([0.0, 0.5, 1.0, 1.5, 2.0])
"""How long before a step a gradual change may have begun, in time constants; with ln 2 it is half
done at the step."""


def stepping(effect: Effect, machine: Machine) -> bool:
    """Whether an effect is a step at a moment or a place that is searched: an event, a joint."""
    return not all(p.smooth for p in effect.nonlinear(machine))


def gradual(time: F64, moment: float) -> F64:
    """Changes in a finite time that a step at a moment may stand for, shape (n, changes).

    They begin at the step, some time before it, or with the record, as after switching on.

    Parameters
    ----------
    time
        Of each row, s, shape (n,).
    moment
        Of the step, s.
    """
    apart = np.diff(np.unique(time))
    shortest, longest = float(np.median(apart)), float(np.ptp(time))
    if not 0.0 < shortest < longest:
        return np.zeros((len(time), 0))
    tau = np.geomspace(shortest, longest, _TIME_CONSTANTS)
    began = np.column_stack([moment - np.outer(tau, _BEGAN), np.full(len(tau), time.min())])
    since = np.clip(time[:, None, None] - began, 0.0, None)
    return np.asarray(-np.expm1(-since / tau[:, None])).reshape(len(time), -1)


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
        """By how much −2·ln(likelihood) falls with a step, weighted column (n, 1), beside it.

        The wander is as large as is likeliest beside the step; 0 where that is not seen.
        """
        if not len(self.squares):
            return 0.0
        alone, with_step = self._left(step)
        at = int(with_step[:, 0].argmin())
        return max(0.0, float(alone[at] - with_step[at, 0]))

    def likelier_slowly(self, step: F64, slowly: F64) -> float:
        """By how much −2·ln(likelihood) is less of the likeliest gradual change than of a step.

        Weighted columns (n, 1) and (n, changes); beside each a wander as large as is likeliest.
        """
        if not len(self.squares) or not slowly.shape[1]:
            return 0.0
        _, left = self._left(np.hstack([step, slowly]))
        least = left.min(axis=0)
        return max(0.0, float(least[0] - least[1:].min()))

    def _left(self, columns: F64) -> tuple[F64, F64]:
        """−2·ln(likelihood) beside wanders of all sizes, without and with each of some columns.

        Shapes (sizes,) and (sizes, columns).
        """
        residual = self.basis.residual
        own = self.basis.project(columns)
        weight = 1.0 / (1.0 + np.outer(_SIZES / self.squares.max(), self.squares))
        volume = -np.log(weight).sum(axis=1)
        along, seen = self.directions.T @ own, self.directions.T @ residual
        # products by V⁻¹: beside the wander's directions as they are, along them less
        less = weight - 1.0
        alone = residual @ residual + less @ seen**2
        square = np.einsum("ij,ij->j", own, own) + less @ along**2
        product = own.T @ residual + less @ (along * seen[:, None])
        rounding = 1e-10 * np.einsum("ij,ij->j", columns, columns)
        explained = np.where(square > rounding, product**2 / np.maximum(square, rounding), 0.0)
        least = 1e-12 * self.basis.chi2
        dof = self.basis.dof
        without = np.maximum(alone, least)
        with_it = np.maximum(alone[:, None] - explained, least)
        return dof * np.log(without) + volume, dof * np.log(with_it) + volume[:, None]
