"""Shapes: how an error motion depends on its axis's position.

============== ======================================================================
``constant``    one value
``polynomial:N`` degree N, Legendre polynomials over the travel mapped to −1 … 1
``spline:N``    N clamped B-spline coefficients on uniform knots over the travel, cubic for
                N ≥ 4, else of degree N − 1
``spline:auto`` cubic B-splines whose inner knots are its positions, strictly inside the
                travel; `abbe.compcore.fitting.knots` finds how many and where
``table``       piecewise linear between given positions
============== ======================================================================

All shapes hold their end values outside the travel (a table: outside its positions), as
controllers do. Legendre and B-spline bases keep a fit well conditioned where powers of a
position in mm would not.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from abbe.compcore.errors import InputError
from abbe.compcore.machine.machine import Axis
from abbe.compcore.machine.plausible import POINT

F64 = NDArray[np.float64]

_CODE = re.compile(r"(constant|table)|(polynomial|spline):([0-9]{1,9})|(spline):auto")
_EXPECTED = "constant, polynomial:N (0 ≤ N ≤ 20), spline:N (1 ≤ N ≤ 200), spline:auto or table"
AUTO = "spline:auto"
"""The shape whose knots a fit finds."""
CUBIC = 3
_MOST_KNOTS = 196


@dataclass(frozen=True, slots=True)
class Shape:
    """A parsed shape.

    Attributes
    ----------
    family
        ``constant``, ``polynomial``, ``spline`` or ``table``.
    order
        Degree of a polynomial, number of coefficients of a spline; unused otherwise.
    nodes
        Positions of a table, or inner knots of ``spline:auto``, mm (rotary: rad), strictly
        increasing.
    placed
        Whether a spline's inner knots are `nodes`; else they are at equal distances.
    """

    family: str
    order: int = 0
    nodes: tuple[float, ...] = ()
    placed: bool = False

    @classmethod
    def parse(cls, code: str, nodes: Sequence[float] = ()) -> Shape:
        """Read a shape code; `nodes` (mm or rad) go with ``table`` and ``spline:auto`` only.

        Raises
        ------
        InputError
            For an unknown code, a table without positions, positions that do not increase.
        """
        match = _CODE.fullmatch(code)
        if match is None:
            raise InputError("unknown shape", field="shape", found=code, expected=_EXPECTED)
        if match[4]:
            _check_knots(nodes)
            return cls("spline", len(nodes) + CUBIC + 1, tuple(float(p) for p in nodes), True)
        family = match[1] or match[2]
        order = int(match[3] or 0)
        limits = {"polynomial": (0, 20), "spline": (1, 200)}
        if family in limits and not limits[family][0] <= order <= limits[family][1]:
            raise InputError("shape out of range", field="shape", found=code, expected=_EXPECTED)
        if family == "table":
            inside = all(POINT.holds(p) for p in nodes)
            if len(nodes) < 2 or not inside or any(b <= a for a, b in pairwise(nodes)):
                raise InputError(
                    "a table needs its positions",
                    field="positions",
                    found=list(nodes),
                    expected=f"at least two positions, strictly increasing, {POINT}",
                )
        elif nodes:
            raise InputError(
                "positions belong to shapes 'table' and 'spline:auto' only",
                field="positions",
                found=code,
                expected='shape = "table" or "spline:auto"',
            )
        return cls(family, order, tuple(float(p) for p in nodes))

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return {
            "constant": 1,
            "polynomial": self.order + 1,
            "spline": self.order,
            "table": len(self.nodes),
        }[self.family]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coefficients, in order."""
        if self.family == "constant":
            return ("value",)
        start = 0 if self.family == "polynomial" else 1
        letter = "v" if self.family == "table" else "c"
        return tuple(f"{letter}{i}" for i in range(start, start + self.size))

    def basis(self, position: F64, axis: Axis) -> F64:
        """Basis functions at positions of shape (n,), mm or rad → shape (n, size), unit-free."""
        n = position.shape[0]
        if self.family == "constant":
            return np.ones((n, 1))
        if self.family == "table":
            return _hat_functions(position, np.asarray(self.nodes))
        x = (axis.clamp(position) - axis.middle) / axis.half_travel
        if self.family == "polynomial":
            return np.asarray(legendre.legvander(x, self.order))
        if self.placed:
            inner = (np.asarray(self.nodes) - axis.travel[0]) / (2.0 * axis.half_travel)
            return _b_splines(0.5 * (x + 1.0), self.order, inner)
        return _b_splines(0.5 * (x + 1.0), self.order)

    def check(self, axis: Axis) -> None:
        """Refuse inner knots that an axis never passes.

        Raises
        ------
        InputError
            For a knot of ``spline:auto`` that is not strictly inside the travel.
        """
        low, high = axis.travel
        slack = 1e-9 * (high - low)
        if self.placed and any(not low + slack < q < high - slack for q in self.nodes):
            raise InputError(
                "a knot outside of the travel", field="positions", found=list(self.nodes),
                expected=f"knots between {low:g} and {high:g}",
            )  # fmt: skip

    def kinks(self, axis: Axis) -> tuple[float, ...]:
        """Positions where the slope may jump: a table's nodes; the ends where values are held."""
        return self.nodes if self.family == "table" else axis.travel


def _hat_functions(position: F64, nodes: F64) -> F64:
    """Piecewise linear interpolation as a matrix, shape (n, len(nodes)); ends held."""
    n = position.shape[0]
    held = np.clip(position, nodes[0], nodes[-1])
    left = np.clip(np.searchsorted(nodes, held, side="right") - 1, 0, len(nodes) - 2)
    part = (held - nodes[left]) / (nodes[left + 1] - nodes[left])
    basis = np.zeros((n, len(nodes)))
    rows = np.arange(n)
    basis[rows, left] = 1.0 - part
    basis[rows, left + 1] = part
    return basis


def _check_knots(nodes: Sequence[float]) -> None:
    inside = all(POINT.holds(p) for p in nodes)
    if len(nodes) > _MOST_KNOTS or not inside or any(b <= a for a, b in pairwise(nodes)):
        raise InputError(
            "not the inner knots of a spline",
            field="positions",
            found=list(nodes),
            expected=f"none, or up to {_MOST_KNOTS}, strictly increasing, {POINT}",
        )


def _b_splines(x: F64, count: int, inner: F64 | None = None) -> F64:
    """All `count` clamped B-splines at x in 0 … 1, shape (n, count).

    `inner` are the inner knots, strictly increasing in 0 … 1; None: at equal distances. De Boor's
    recurrence on the few functions that are not zero at each x (The NURBS Book, algorithm A2.2),
    vectorised over x. SciPy's would cost half of the start-up time.
    """
    degree = min(CUBIC, count - 1)
    parts = count - degree
    if inner is None:
        inner = np.linspace(0.0, 1.0, parts + 1)[1:-1]
        part_of = np.clip((x * parts).astype(np.int64), 0, parts - 1)
    else:
        part_of = np.searchsorted(inner, x, side="right")
    knots = np.concatenate([np.zeros(degree + 1), inner, np.ones(degree + 1)])
    span = degree + part_of
    local = np.zeros((x.shape[0], degree + 1))
    local[:, 0] = 1.0
    for k in range(1, degree + 1):
        saved = np.zeros_like(x)
        for r in range(k):
            right = knots[span + r + 1]
            left = knots[span + 1 - k + r]
            part = local[:, r] / (right - left)
            local[:, r] = saved + (right - x) * part
            saved = (x - left) * part
        local[:, k] = saved
    basis = np.zeros((x.shape[0], count))
    np.put_along_axis(basis, span[:, None] - degree + np.arange(degree + 1), local, axis=1)
    return basis
