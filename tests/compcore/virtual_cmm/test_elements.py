"""Elements by Gauss–Newton in one go are those of SciPy's least squares, one by one."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

from abbe.compcore.virtual_cmm.elements import associated
from abbe.compcore.virtual_cmm.features import TouchedFeature

AXIS = np.array([0.36, 0.48, 0.8])
CENTRE = np.array([120.0, -40.0, 300.0])
RADIUS = 25.0
FRAME = np.linalg.qr(np.column_stack([AXIS, np.eye(3)[:, :2]]))[0]


def nominal(kind: str, arc: float = 2.0 * np.pi) -> TouchedFeature:
    rng = np.random.default_rng(5)
    across = FRAME[:, 1:]
    angle = np.linspace(0.0, arc, 12, endpoint=False)
    out = (across @ np.stack([np.cos(angle), np.sin(angle)])).T
    if kind == "plane":
        own = (across @ rng.uniform(-80, 80, (2, 12))).T
        return TouchedFeature("f", "plane", CENTRE + own, np.tile(AXIS, (12, 1)), "1", CENTRE, AXIS)
    if kind == "sphere":
        out = rng.normal(size=(12, 3))
        out /= np.linalg.norm(out, axis=1)[:, None]
    points = CENTRE + RADIUS * out
    if kind == "cylinder":
        points = points + np.outer(np.tile([-30.0, 10.0, 45.0], 4), AXIS)
    return TouchedFeature("f", kind, points, out, "1", CENTRE, AXIS, RADIUS)


def by_scipy(kind: str, points: np.ndarray) -> tuple[float, float]:
    """Radius (of a plane 0) and form deviation, from a start that is far off."""
    across = FRAME[:, 1:]
    if kind == "plane":

        def away(p):
            n = AXIS + across @ p[:2]
            return (points - CENTRE) @ (n / np.linalg.norm(n)) - p[2]

        start = [0.1, -0.1, 1.0]
    elif kind == "circle":
        flat = (points - CENTRE) @ across

        def away(p):
            return np.linalg.norm(flat - p[:2], axis=1) - p[2]

        start = [1.0, 1.0, 20.0]
    elif kind == "sphere":

        def away(p):
            return np.linalg.norm(points - CENTRE - p[:3], axis=1) - p[3]

        start = [1.0, 1.0, 1.0, 20.0]
    else:

        def away(p):
            d = AXIS + across @ p[2:4]
            return (
                np.linalg.norm(
                    np.cross(points - CENTRE - across @ p[:2], d / np.linalg.norm(d)), axis=1
                )
                - p[4]
            )

        start = [1.0, 1.0, 0.01, 0.01, 20.0]
    found = least_squares(away, start, xtol=1e-15, ftol=1e-15, gtol=1e-15)
    rest = away(found.x)
    return (0.0 if kind == "plane" else float(found.x[-1])), float(np.ptp(rest))


@pytest.mark.parametrize("kind", ["plane", "circle", "sphere", "cylinder"])
@pytest.mark.parametrize("noise", [1e-3, 0.5])
def test_elements_are_those_of_scipy(kind: str, noise: float) -> None:
    feature = nominal(kind)
    sets = feature.points + np.random.default_rng(2).normal(0.0, noise, (6, 12, 3))
    found = associated(feature, sets)
    for i, points in enumerate(sets):
        radius, form = by_scipy(kind, points)
        # SciPy's cost ends at rounding of the sum of squares
        assert abs(found.radius[i] - radius) < 1e-7
        assert abs(found.form[i] - form) < 1e-6


def test_a_short_arc_is_evaluated_as_well() -> None:
    feature = nominal("circle", np.radians(40.0))
    sets = feature.points + np.random.default_rng(4).normal(0.0, 1e-3, (20, 12, 3))
    found = associated(feature, sets)
    expected = [by_scipy("circle", points)[0] for points in sets]
    np.testing.assert_allclose(found.radius, expected, atol=1e-6)
    assert np.std(expected) > 5e-3  # the arc makes it unsure: not the nominal radius handed back
