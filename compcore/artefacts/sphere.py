"""A sphere through touched points: its centre by least squares, its radius, its form deviation."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

F64 = NDArray[np.float64]

FEWEST = 5
"""Points of a sphere: with four a form deviation could not show."""


@dataclass(frozen=True, eq=False)
class FittedSphere:
    """A sphere as it was touched.

    Attributes
    ----------
    centre
        Shape (3,), mm.
    radius
        Found, or as it was held, mm: of the tip's centre about the sphere's.
    form
        Farthest less nearest point from the centre, mm.
    covariance
        Of the centre, (3, 3), mm², for points of standard uncertainty `scatter` each.
    scatter
        Standard deviation of a point about the sphere, mm; 0 without a degree of freedom.
    """

    centre: F64
    radius: float
    form: float
    covariance: F64
    scatter: float

    def sd(self, u: F64) -> float:
        """Standard uncertainty of the centre along a unit vector by its points' scatter, mm."""
        return math.sqrt(max(0.0, float(u @ self.covariance @ u)))


def fit_sphere(points: F64, radius: float | None = None) -> FittedSphere:
    """The sphere next to some points: least squares of their distances from it (ISO 10360-5).

    Parameters
    ----------
    points
        Shape (n, 3), mm; at least `FEWEST`.
    radius
        Held, mm; None: found along.

    Raises
    ------
    ValueError
        For too few points, and for points that determine no sphere.
    """
    if len(points) < FEWEST:
        raise ValueError(f"{len(points)} points; a sphere takes {FEWEST}")
    middle = points.mean(axis=0)
    own = points - middle
    # the sphere |p|² = 2 c·p + k, linear in c and k, to begin with
    linear = np.column_stack([2.0 * own, np.ones(len(own))])
    start, *_, singular = np.linalg.lstsq(linear, (own**2).sum(axis=1), rcond=None)
    if singular[-1] < 1e-6 * singular[0]:
        raise ValueError("the points lie in one plane")
    first = math.sqrt(max(float(start[3] + start[:3] @ start[:3]), 0.0))

    def distances(unknown: F64) -> F64:
        own_radius = radius if radius is not None else unknown[3]
        return np.asarray(np.linalg.norm(own - unknown[:3], axis=1) - own_radius)

    free = start[:3] if radius is not None else np.append(start[:3], first)
    found = least_squares(distances, free, xtol=1e-15, ftol=1e-15, gtol=1e-15)
    residual = distances(found.x)
    freedom = len(points) - len(free)
    scatter = float(np.sqrt(residual @ residual / freedom)) if freedom > 0 else 0.0
    slopes = np.asarray(found.jac, dtype=np.float64)
    covariance = np.linalg.pinv(slopes.T @ slopes)[:3, :3] * scatter**2
    return FittedSphere(
        np.asarray(middle + found.x[:3]),
        float(radius if radius is not None else found.x[3]),
        float(np.ptp(residual)),
        np.asarray(covariance),
        scatter,
    )
