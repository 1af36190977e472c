"""Spheres through touched points, against closed forms; ways about them."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from abbe.compcore.artefacts.sphere import fit_sphere
from abbe.compcore.errors import InputError
from abbe.compcore.planning.probing.touches import Stylus, about, directions, farthest_three

UP = np.array([0.0, 0.0, 1.0])
CENTRE = np.array([310.0, -40.0, 812.5])


def test_a_sphere_through_exact_points_is_that_sphere() -> None:
    ways = directions(UP, Stylus(2.0, (0.0, 0.0, 1.0)), 5)
    found = fit_sphere(CENTRE + 13.0 * ways)
    assert found.centre == pytest.approx(CENTRE, abs=1e-9)
    assert found.radius == pytest.approx(13.0, abs=1e-9)
    assert found.form < 1e-9


def test_form_is_the_range_of_the_distances_and_a_held_radius_shifts_along_the_pole() -> None:
    """Six ends of the axes, two of them 6 µm out: the best sphere is 2 µm larger."""
    ends = np.vstack([np.eye(3), -np.eye(3)])
    reach = np.array([10.0, 10.0, 10.006, 10.0, 10.0, 10.006])
    found = fit_sphere(CENTRE + ends * reach[:, None])
    assert found.radius == pytest.approx(10.002, abs=1e-9)
    assert found.form == pytest.approx(0.006, abs=1e-9)
    ways = directions(UP, Stylus(2.0, (0.0, 0.0, 1.0)), 5)
    held = fit_sphere(CENTRE + 13.0 * ways, 12.999)
    shift = held.centre - CENTRE
    assert shift[:2] == pytest.approx([0.0, 0.0], abs=1e-9)
    # normal equation along the pole: (1 + 4 cos² 60°) s = 0.001 (1 + 4 cos 60°)
    assert shift[2] == pytest.approx(0.001 * 3.0 / 2.0, rel=1e-3)


def test_points_that_are_no_sphere_are_refused() -> None:
    with pytest.raises(ValueError, match="a sphere takes 5"):
        fit_sphere(np.eye(4, 3))
    ring = np.linspace(0.0, 6.0, 8)
    with pytest.raises(ValueError, match="one plane"):
        fit_sphere(np.stack([np.cos(ring), np.sin(ring), 0.0 * ring], axis=1))


@pytest.mark.parametrize("lean", [0.0, 30.0, 45.0, 60.0])
def test_touches_keep_off_the_body_and_the_shaft_off_the_ball(lean: float) -> None:
    normal = np.array([math.sin(math.radians(lean)), 0.0, math.cos(math.radians(lean))])
    ways = directions(normal, Stylus(2.0, (0.0, 0.0, 1.0)), 9)
    assert np.linalg.norm(ways, axis=1) == pytest.approx(np.ones(9))
    assert (ways @ normal).min() >= math.cos(math.radians(65.0)) - 1e-9
    assert (ways @ UP).min() >= -1e-9


def test_a_ball_that_the_stylus_cannot_reach_is_refused() -> None:
    with pytest.raises(InputError, match="cannot reach"):
        directions(np.array([1.0, 0.0, 0.0]), Stylus(2.0, (0.0, 0.0, 1.0)), 5)


def test_ways_about_a_sphere_keep_their_distance() -> None:
    ways = directions(UP, Stylus(2.0, (0.0, 0.0, 1.0)), 9)
    for start in ways:
        for end in ways:
            stops = [CENTRE + 16.0 * start, *about(CENTRE, start, end, 16.0, 14.5)]
            assert stops[-1] == pytest.approx(CENTRE + 16.0 * end)
            for a, b in pairwise(stops):
                line = a + np.linspace(0.0, 1.0, 101)[:, None] * (b - a)
                assert np.linalg.norm(line - CENTRE, axis=1).min() >= 14.5 - 1e-9


def test_three_that_span_a_plate() -> None:
    grid = np.array([[x, y, 0.0] for y in (0.0, 60.0, 120.0) for x in (0.0, 60.0, 120.0)])
    assert farthest_three(grid)[:2] == (0, 8)
    assert farthest_three(grid)[2] in (2, 6)
    with pytest.raises(ValueError, match="one line"):
        farthest_three(np.array([[0.0, 0, 0], [1.0, 1, 1], [2.0, 2, 2]]))
