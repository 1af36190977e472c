"""The evidence for sets of knots: what each leaves of χ², and what its knots cost."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.effects.shapes import CUBIC
from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.fitting.determinacy import LEAST_INFORMATION
from abbe.compcore.fitting.knots.raster import RasterCurve, finds_knots
from abbe.compcore.fitting.reduction import triangle
from abbe.compcore.linalg import svd
from abbe.compcore.model.model import Model

F64 = NDArray[np.float64]
KnotSet = tuple[tuple[int, ...], ...]
"""For each curve the places of its knots, ascending."""

_UNKNOWNS = 4
"""As many unknowns a knot counts."""
_END, _APART = 0.134, 0.1
"""Part of the travel from its end to a knot, and between two knots, at least: what is measured
there says little of so short a piece, and a cubic would run away."""
_LEAST_DOF = 10
_ROUNDING = 1e-8


class KnotEvidence:
    """The evidence of every set of knots, from the triangular factor of the fit on the raster.

    Parameters
    ----------
    curves
        Effects on the raster.
    columns
        (k, E·J): what each knot does, in units of the noise, without what the rest can imitate.
    left
        (k,): what is left without any knot, in the same units.
    rows, beside
        Number of rows, set-ups' unknowns taken off, and of other unknowns that they determine.
    back
        From the knots' coefficients, (E·J,), to the coefficients of each curve's cubic, (E, 4).
    """

    def __init__(
        self, curves: Sequence[RasterCurve], columns: F64, left: F64, rows: int, beside: int,
        back: tuple[F64, F64],
    ) -> None:  # fmt: skip
        self.curves = curves
        self.columns = columns
        self.left = left
        self.rows = rows
        self.beside = beside
        self.back = back
        counts = [len(c.places) for c in curves]
        self.first = np.concatenate([[0], np.cumsum(counts)])
        self.curve_of = np.repeat(np.arange(len(curves)), counts)
        self.size = np.einsum("ij,ij->j", columns, columns)

    @classmethod
    def of(cls, model: Model, problem: Problem, theta: F64, chi2: float, dof: int) -> KnotEvidence:
        """From the fit on the raster: its unknowns, what it leaves, its degrees of freedom."""
        layout, machine = problem.layout, model.machine
        m = layout.size
        reduced = triangle(problem, theta)
        factor, left = reduced[:m, :m], reduced[:m, m]
        noise = np.sqrt(chi2 / dof) if dof >= _LEAST_DOF and chi2 > 0.0 else 1.0
        target = (factor @ theta + left) / noise
        curves, rest = [], np.ones(m, dtype=np.bool_)
        for i, effect in enumerate(model.effects):
            if finds_knots(effect):
                where = layout.linear_of(i)
                unknown = layout.unknowns[where.start]
                fine = problem.model.effects[i]
                axis = machine.axis(str(getattr(effect, "axis", "")))
                curves.append(RasterCurve.of(i, fine, axis, unknown.unit, unknown.scale))
                rest[where] = False
        factor = factor / noise
        cubic = [factor[:, layout.linear_of(c.term)] @ c.cubic * c.scale for c in curves]
        base = np.column_stack([factor[:, rest] * layout.scale[rest], *cubic])
        powers = np.column_stack(
            [factor[:, layout.linear_of(c.term)] @ c.powers * c.scale for c in curves]
        )
        u, s, vt = svd(base)
        rank = int((s > LEAST_INFORMATION).sum())
        u, back = u[:, :rank], vt[:rank].T / s[:rank]
        beside = u.T @ powers
        whole = np.column_stack([powers - u @ beside, target - u @ (u.T @ target)])
        small = triangular(whole)
        own = back[-(CUBIC + 1) * len(curves) :]
        rows = int((problem.weight > 0.0).sum()) - problem.eliminator(theta).rank
        return cls(
            curves, small[:, :-1], small[:, -1], rows, rank, (own @ (u.T @ target), own @ beside)
        )

    def cost(self, knots: int) -> float:
        """What so many knots cost, in units of χ²: all unknowns, corrected for few rows."""
        unknowns = self.beside + _UNKNOWNS * knots
        spare = self.rows - unknowns - 1
        few = unknowns * (unknowns + 1) / spare if spare > 0 else np.inf
        return 2.0 * (unknowns + few)

    def indices(self, chosen: KnotSet) -> list[int]:
        """Columns of a set."""
        return [int(self.first[e]) + j for e, own in enumerate(chosen) for j in own]

    def score(self, chosen: KnotSet) -> float:
        """χ² and cost of a set: less is better."""
        left, _ = self.beyond(self.indices(chosen), np.zeros(0, dtype=np.int64))
        return float(left @ left) + self.cost(sum(map(len, chosen)))

    def beyond(self, used: Sequence[int], asked: NDArray[np.int64]) -> tuple[F64, F64]:
        """What is left, and of some columns what is left of them, beside a set."""
        left, columns = self.left, self.columns[:, asked]
        if used:
            q = np.linalg.qr(self.columns[:, list(used)])[0]
            left = left - q @ (q.T @ left)
            columns = columns - q @ (q.T @ columns)
        return left, columns

    def gains(self, chosen: KnotSet, curve: int | None = None) -> F64:
        """By how much χ² falls with each further knot, of one curve or of all; −1: not seen."""
        own = slice(None) if curve is None else slice(self.first[curve], self.first[curve + 1])
        asked = np.arange(self.columns.shape[1])[own]
        left, columns = self.beyond(self.indices(chosen), asked)
        gains = self.gains_of(left, columns, self.size[asked])
        gains[self.barred(chosen)[own]] = -1.0
        return gains

    @staticmethod
    def gains_of(left: F64, columns: F64, size: F64) -> F64:
        """By how much χ² falls with each of some columns; −1 where too little of it is left.

        Parameters
        ----------
        left, columns
            As `beyond` returns them.
        size
            The columns' squares, (columns,), before anything was taken off.
        """
        own = np.einsum("ij,ij->j", columns, columns)
        seen = own > np.maximum(LEAST_INFORMATION, _ROUNDING * size)
        return np.where(seen, (columns.T @ left) ** 2 / np.where(seen, own, 1.0), -1.0)

    def barred(self, chosen: KnotSet) -> NDArray[np.bool_]:
        """Columns of places that are too near to a knot of a set, or to an end of the travel."""
        barred = np.zeros(self.columns.shape[1], dtype=np.bool_)
        for e, own in enumerate(chosen):
            first, last = int(self.first[e]), int(self.first[e + 1])
            parts = last - first + 1
            end, apart = round(_END * parts), round(_APART * parts)
            barred[first : first + end - 1] = barred[last - end + 1 : last] = True
            for j in own:
                barred[max(first + j - apart + 1, first) : min(first + j + apart, last)] = True
        return barred

    def losses(self, chosen: KnotSet) -> F64:
        """By how much χ² rises without each knot of a set, in the order of `indices`."""
        used = self.indices(chosen)
        whole = triangular(np.column_stack([self.columns[:, used], self.left]))
        return losses_of(whole, list(range(len(used))))

    def with_one_more(self, chosen: KnotSet, column: int) -> KnotSet:
        """A set and the knot of one more column."""
        e = int(self.curve_of[column])
        own = tuple(sorted((*chosen[e], column - int(self.first[e]))))
        return (*chosen[:e], own, *chosen[e + 1 :])

    def with_one_less(self, chosen: KnotSet, column: int) -> KnotSet:
        """A set without the knot of one of its columns."""
        e, j = int(self.curve_of[column]), column - int(self.first[self.curve_of[column]])
        own = tuple(i for i in chosen[e] if i != j)
        return (*chosen[:e], own, *chosen[e + 1 :])


def triangular(matrix: F64) -> F64:
    """The triangular factor of a matrix."""
    return np.asarray(np.linalg.qr(matrix, mode="r"))


def losses_of(whole: F64, kept: list[int]) -> F64:
    """By how much χ² rises without each of the columns that are kept; the last is what is left."""
    k = len(kept)
    r = triangular(whole[:, [*kept, whole.shape[1] - 1]])
    inverse = np.linalg.pinv(r[:k, :k])
    values = inverse @ r[:k, k]
    return np.asarray(values**2 / np.maximum(np.einsum("ij,ij->i", inverse, inverse), 1e-300))
