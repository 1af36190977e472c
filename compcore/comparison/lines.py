"""Lines: each one's error split into its linear part and the non-linear rest (Zhang et al., 1985).

What is linear in length comes from temperature, expansion coefficients, scales and squareness; the
rest from the shape of guideways and scales. Seen before and after a model, that says where to look.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.fitting.design.nuisance import Eliminator

F64 = NDArray[np.float64]

_FEWEST = 4
_SHORTEST = 1.0
"""Fewer rows, or a shorter path (mm), do not make a line."""
_STRAIGHT = 1e-3
"""Rows further beside the line than this part of its length do not make a line."""


@dataclass(frozen=True, slots=True)
class MeasuredLine:
    """One set-up along a straight line, before and after the model.

    Attributes
    ----------
    setup, n
        Name and number of rows.
    length
        From end to end, mm.
    linear_before, linear_after
        What the best-fitting straight line of the error gains from end to end, mm; None where the
        set-up leaves the slope unknown.
    rest_before, rest_after
        Peak to valley of what is left of the error's mean course, mm.
    """

    setup: str
    n: int
    length: float
    linear_before: float | None
    linear_after: float | None
    rest_before: float
    rest_after: float


def lines(campaign: Campaign, residual: F64, eliminator: Eliminator) -> list[MeasuredLine]:
    """Every set-up of a campaign whose displacements lie along a straight line.

    Parameters
    ----------
    residual
        Measured − predicted − nuisances, shape (n,), mm.
    eliminator
        The set-ups' nuisances, for the errors before the model.
    """
    found = []
    point = campaign.functional_moves()
    for block in eliminator.blocks:
        rows = block.rows
        if len(rows) < _FEWEST or (campaign.kind[rows] != Kind.DISPLACEMENT).any():
            continue
        centred = point[rows] - point[rows].mean(axis=0)
        _, size, directions = np.linalg.svd(centred, full_matrices=False)
        along = centred @ directions[0]
        length = float(np.ptp(along))
        if length < _SHORTEST or size[1] > _STRAIGHT * size[0] or len(np.unique(along)) < _FEWEST:
            continue
        u = campaign.conditions.u
        if u is not None and np.ptp(u[rows], axis=0).max() > 1e-9:
            continue  # one line holds one component
        slope_free = "slope" in campaign.setups[block.setup].free
        before, rest_before = split(along, campaign.value[rows])
        after, rest_after = split(along, residual[rows])
        found.append(
            MeasuredLine(
                block.setup,
                len(rows),
                length,
                None if slope_free else before * length,
                None if slope_free else after * length,
                rest_before,
                rest_after,
            )
        )
    return found


def split(along: F64, error: F64) -> tuple[float, float]:
    """Slope of the best-fitting line (mm/mm), and peak to valley (mm) of the rest's mean course.

    Rows at one place are averaged first: their scatter is noise and no form.
    """
    place, number = np.unique(np.round(along, 3), return_inverse=True)
    count = np.bincount(number.reshape(-1))
    mean = np.bincount(number.reshape(-1), weights=error) / count
    fitted = np.polynomial.Polynomial.fit(along, error, 1)
    slope = float(fitted.deriv()(0.0))
    return slope, float(np.ptp(mean - fitted(place)))
