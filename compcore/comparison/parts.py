"""A comparison's rows of one kind: how large residuals are, where, and the worst of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.comparison.tabulate import ResidualTables

Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Point:
    """One of the worst rows.

    Attributes
    ----------
    row, line
        Index in the campaign and line in its file.
    setup
        Its set-up.
    residual, sd
        mm or rad.
    """

    row: int
    line: int
    setup: str
    residual: float
    sd: float


@dataclass(frozen=True, eq=False)
class ComparedRows:
    """The comparison of one kind of rows: lengths (mm, tables in µm) or rotations (rad, µrad).

    Attributes
    ----------
    rows
        Shape (n,): which rows.
    rms, max, p95
        Of the residuals, mm or rad; 95 % of the rows lie within ±p95. NaN without rows.
    chi2_per_dof
        χ² per degree of freedom; NaN where there is none.
    freedom
        Degrees of freedom: rows less what the placing of instruments (and the fit) absorbed.
    tables
        Residuals by group, in µm or µrad.
    worst
        The rows with the largest residuals.
    """

    rows: Mask
    rms: float
    max: float
    p95: float
    chi2_per_dof: float
    freedom: float
    tables: ResidualTables
    worst: tuple[Point, ...]

    @property
    def n(self) -> int:
        """Number of rows."""
        return int(self.rows.sum())
