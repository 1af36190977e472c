"""Circular tests by ISO 230-4: circular deviation G, hysteresis H, radial deviation F and D.

What a ball bar or a grid encoder sees while two axes contour a circle. The centre at which the
instrument stood is no property of the machine: on full circles the deviations count from the
least-squares centre of both paths (for G: the centre that makes it least), on arcs from the
instrument's own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.errors import AbbeError

F64 = NDArray[np.float64]

PLANES = (("X", "Y"), ("Y", "Z"), ("Z", "X"))
DIRECTIONS: Mapping[str, int] = {"ccw": 1, "cw": -1}
_ROUND = 1e-3
"""Part of the radius by which points may miss the circle, and u the radius's direction."""
_FULL = np.radians(15.0)
"""Widest gap between readings that still counts as a full circle."""
_FEWEST = 8


@dataclass(frozen=True, eq=False)
class MeasuredCircle:
    """The readings of one circular path, in the order of angle.

    Attributes
    ----------
    angle
        From the plane's first axis to its second, (n,), rad, 0 … 2π.
    deviation
        Radius measured minus nominal, (n,), mm.
    """

    angle: F64
    deviation: F64


@dataclass(frozen=True, eq=False)
class CircularResult:
    """The results of a circular test by ISO 230-4; lengths mm, None for what was not measured.

    Attributes
    ----------
    setup, plane, radius, centre
        Where: the plane's two axes, nominal radius and centre.
    paths
        ``ccw`` and ``cw``, those that were measured.
    full
        Whether all of the circle was measured.
    eccentricity
        Of the instrument, by least squares over both paths; (0, 0) on arcs.
    G
        Circular deviation of each direction (3.5): least distance of two concentric circles that
        hold the path (roundness; minimum zone), about that zone's own centre.
    G_both
        The same of both paths together, bi-directional.
    H
        Circular hysteresis (3.4): greatest distance between the two paths at one angle.
    F_max, F_min
        Radial deviation of each direction (3.6): greatest and least distance from the nominal
        circle. They need an instrument of calibrated length.
    D
        Mean bi-directional radial deviation: radius of the least-squares circle minus nominal.
    notes
        What is not as the standard asks for.
    """

    setup: str
    plane: tuple[str, str]
    radius: float
    centre: tuple[float, float]
    paths: Mapping[str, MeasuredCircle]
    full: bool
    eccentricity: tuple[float, float]
    G: Mapping[str, float]
    G_both: float | None
    H: float | None
    F_max: Mapping[str, float]
    F_min: Mapping[str, float]
    D: float | None
    notes: tuple[str, ...]

    def centred(self, name: str) -> F64:
        """A path's radial deviations without the instrument's eccentricity, (n,), mm."""
        path = self.paths[name]
        return path.deviation - _shift(path.angle, self.eccentricity)


def evaluate_circles(campaign: Campaign) -> tuple[CircularResult, ...]:
    """Circular tests of a campaign: every set-up along a circle with u along its radius."""
    setup = campaign.conditions.setup
    found = []
    for name in campaign.setups if setup is not None else ():
        result = _circle(campaign, name, np.flatnonzero(setup == name))
        if result is not None:
            found.append(result)
    return tuple(found)


def evaluate_circle(
    setup: str,
    plane: tuple[str, str],
    centre: tuple[float, float],
    radius: float,
    paths: Mapping[str, MeasuredCircle],
) -> CircularResult:
    """Evaluate the paths of one circular test by ISO 230-4."""
    full = all(_gap(path.angle) <= _FULL for path in paths.values())
    angle = np.concatenate([p.angle for p in paths.values()])
    deviation = np.concatenate([p.deviation for p in paths.values()])
    eccentricity, mean = (0.0, 0.0), None
    notes = []
    if full:
        columns = np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)], axis=1)
        # each direction counts alike, however many readings it has
        share = np.concatenate(
            [np.full(len(p.angle), len(p.angle) ** -0.5) for p in paths.values()]
        )
        own = np.linalg.lstsq(columns * share[:, None], deviation * share, rcond=None)[0]
        mean, eccentricity = float(own[0]), (float(own[1]), float(own[2]))
    else:
        notes.append("not a full circle: counted from the instrument's own centre, no D")
    if len(paths) < len(DIRECTIONS):
        notes.append(f"only {next(iter(paths))} was measured: no H, no bi-directional G, no D")
    both = len(paths) == len(DIRECTIONS)
    left = {n: p.deviation - _shift(p.angle, eccentricity) for n, p in paths.items()}
    return CircularResult(
        setup,
        plane,
        radius,
        centre,
        paths,
        full,
        eccentricity,
        {n: _zone(p.angle, p.deviation, full) for n, p in paths.items()},
        _zone(angle, deviation, full) if both else None,
        _apart(paths, left) if both else None,
        {n: float(v.max()) for n, v in left.items()},
        {n: float(v.min()) for n, v in left.items()},
        mean if both else None,
        tuple(notes),
    )


def _shift(angle: F64, eccentricity: tuple[float, float]) -> F64:
    return eccentricity[0] * np.cos(angle) + eccentricity[1] * np.sin(angle)


def _gap(angle: F64) -> float:
    """The widest gap between neighbouring readings, round the circle, rad."""
    return float(np.diff(np.append(angle, angle[0] + 2.0 * np.pi)).max())


def _zone(angle: F64, deviation: F64, full: bool) -> float:
    """Least distance of two concentric circles that hold all points, mm.

    To first order in the deviations a moved centre takes ``a·cos θ + b·sin θ`` off them; the
    least range of what is left is a linear programme in a, b and the two radii.
    """
    if not full:
        return float(np.ptp(deviation))
    # SciPy's solver takes half a second to import
    from scipy.optimize import linprog

    scale = max(float(np.ptp(deviation)), 1e-12)
    ones, zero = np.ones_like(angle), np.zeros_like(angle)
    c, s, d = np.cos(angle), np.sin(angle), deviation / scale
    # low ≤ d − a·c − b·s ≤ high
    above = np.stack([-c, -s, zero, -ones], axis=1)
    below = np.stack([c, s, ones, zero], axis=1)
    solved = linprog(
        [0.0, 0.0, -1.0, 1.0],
        A_ub=np.concatenate([above, below]),
        b_ub=np.concatenate([-d, d]),
        bounds=[(None, None)] * 4,
    )
    if solved.fun is None:
        raise AbbeError(f"the least zone of a circle was not found: {solved.message}")
    return float(solved.fun) * scale


def _apart(paths: Mapping[str, MeasuredCircle], left: Mapping[str, F64]) -> float:
    """Greatest distance of two paths at one angle; between readings straight lines, mm."""
    every = np.unique(np.concatenate([p.angle for p in paths.values()]))
    low = max(p.angle[0] for p in paths.values())
    high = min(p.angle[-1] for p in paths.values())
    if all(_gap(p.angle) <= _FULL for p in paths.values()):
        low, high = 0.0, 2.0 * np.pi
    every = every[(every >= low) & (every <= high)]
    if not len(every):
        return float("nan")
    one, two = (np.interp(every, p.angle, left[n], period=2.0 * np.pi) for n, p in paths.items())
    return float(np.abs(one - two).max())


def _circle(campaign: Campaign, name: str, rows: NDArray[np.int64]) -> CircularResult | None:
    conditions = campaign.conditions
    if len(rows) < _FEWEST or conditions.u is None:
        return None
    if (campaign.kind[rows] != Kind.DISPLACEMENT).any():
        return None
    moving = [a for a, q in conditions.positions.items() if np.ptp(q[rows]) > 0.0]
    plane = next((p for p in PLANES if set(p) == set(moving)), None)
    if plane is None:
        return None
    points = np.stack([conditions.position(a)[rows] for a in plane], axis=1)
    centre, radius = _fitted(points)
    out = points - centre
    if np.abs(np.linalg.norm(out, axis=1) - radius).max() > _ROUND * radius:
        return None
    u = conditions.u[rows][:, ["XYZ".index(a) for a in plane]]
    outward = np.einsum("ni,ni->n", u, out) / radius
    if np.abs(outward - 1.0).max() > _ROUND:
        return None
    way = np.stack([conditions.direction(a)[rows] for a in plane], axis=1)
    turning = np.sign(out[:, 0] * way[:, 1] - out[:, 1] * way[:, 0])
    angle = np.mod(np.arctan2(out[:, 1], out[:, 0]), 2.0 * np.pi)
    paths = {}
    for label, sense in DIRECTIONS.items():
        mine = np.flatnonzero(turning == sense)
        if len(mine) >= _FEWEST:
            paths[label] = _path(angle[mine], campaign.value[rows][mine])
    if not paths:
        return None
    middle = (float(centre[0]), float(centre[1]))
    return evaluate_circle(name, plane, middle, radius, paths)


def _path(angle: F64, deviation: F64) -> MeasuredCircle:
    order = np.argsort(angle, kind="stable")
    return MeasuredCircle(angle[order], deviation[order])


def _fitted(points: F64) -> tuple[F64, float]:
    """Centre and radius of the circle nearest to points (n, 2), mm."""
    columns = np.column_stack([2.0 * points, np.ones(len(points))])
    a, b, c = np.linalg.lstsq(columns, (points**2).sum(axis=1), rcond=None)[0]
    return np.array([a, b]), float(np.sqrt(max(c + a * a + b * b, 1e-30)))
