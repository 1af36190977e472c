"""Ideal elements through touched points, by least squares of the distances (Gauss), many at once.

What ISO 10360-6 tests: plane, circle, sphere, cylinder. Every draw of a Monte-Carlo is one set of
points; Gauss–Newton from the nominal element takes all of them at once. A circle is that of the
points as they are seen along its nominal axis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.virtual_cmm.features import ElementKind, TouchedFeature

F64 = NDArray[np.float64]

_ROUNDS = 8
"""Of Gauss–Newton, whatever the draws: from µm or mm off each squares what is left over radius."""


@dataclass(frozen=True, eq=False)
class AssociatedElements:
    """The ideal elements of d sets of points.

    Attributes
    ----------
    kind
        What they are.
    centre
        Shape (d, 3), mm: a point, a circle's or sphere's centre, the middle of a plane's points, of
        a cylinder the point of its axis beside the middle of its points.
    axis
        Shape (d, 3): a plane's normal, a cylinder's axis, a circle's nominal axis.
    radius
        Shape (d,), mm; 0 of points and planes.
    form
        Shape (d,), mm: the farthest less the nearest point.
    """

    kind: ElementKind
    centre: F64
    axis: F64
    radius: F64
    form: F64


def associated(feature: TouchedFeature, points: F64) -> AssociatedElements:
    """Fit a feature's element to points of shape (d, n, 3), mm."""
    if feature.kind == "point":
        return _points(feature, points)
    if feature.kind == "plane":
        return _planes(feature, points)
    if feature.kind == "cylinder":
        return _cylinders(feature, points)
    return _round(feature, points)


def basis(axis: F64) -> F64:
    """Two unit vectors across an axis and the axis itself as rows, right-handed, (3, 3).

    The first is the direction of X seen along the axis, or of Y where that is nearly along it.
    """
    start = np.eye(3)[0 if abs(axis[0]) < 0.9 else 1]
    first = start - (start @ axis) * axis
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first), axis])


def _axes(feature: TouchedFeature, count: int) -> F64:
    return np.broadcast_to(feature.axis, (count, 3))


def _points(feature: TouchedFeature, points: F64) -> AssociatedElements:
    none = np.zeros(len(points))
    return AssociatedElements("point", points.mean(axis=1), _axes(feature, len(points)), none, none)


def _planes(feature: TouchedFeature, points: F64) -> AssociatedElements:
    centre = points.mean(axis=1)
    own = points - centre[:, None, :]
    _, vectors = np.linalg.eigh(np.einsum("dni,dnj->dij", own, own))
    normal = vectors[:, :, 0]
    normal = normal * np.where(normal @ feature.axis < 0.0, -1.0, 1.0)[:, None]
    away = np.einsum("dni,di->dn", own, normal)
    return AssociatedElements("plane", centre, normal, np.zeros(len(points)), np.ptp(away, axis=1))


def _round(feature: TouchedFeature, points: F64) -> AssociatedElements:
    """Circles seen along their axis, spheres."""
    frame = basis(feature.axis)
    own = (points - feature.centre) @ frame.T
    k = 2 if feature.kind == "circle" else 3
    across = own[:, :, :k]
    middle = np.zeros((len(points), k))
    radius = np.full(len(points), feature.radius)
    for _ in range(_ROUNDS):
        away = across - middle[:, None, :]
        far = np.sqrt((away**2).sum(axis=2))
        slopes = np.concatenate([-away / far[:, :, None], -np.ones((*far.shape, 1))], axis=2)
        step = _step(slopes, far - radius[:, None])
        middle, radius = middle + step[:, :k], radius + step[:, k]
    far = np.sqrt(((across - middle[:, None, :]) ** 2).sum(axis=2))
    if k == 2:
        middle = np.concatenate([middle, own[:, :, 2].mean(axis=1)[:, None]], axis=1)
    centre = feature.centre + middle @ frame
    return AssociatedElements(
        feature.kind, centre, _axes(feature, len(points)), radius, np.ptp(far, axis=1)
    )


def _cylinders(feature: TouchedFeature, points: F64) -> AssociatedElements:
    """A cylinder's axis goes through (x, y, 0) along (a, b, 1) of its nominal frame."""
    frame = basis(feature.axis)
    own = (points - feature.centre) @ frame.T
    beside = own[:, :, 2].mean(axis=1)
    own = own - np.stack([np.zeros_like(beside), np.zeros_like(beside), beside], axis=1)[:, None, :]
    unknown = np.zeros((len(points), 5))
    unknown[:, 4] = feature.radius
    size = float(np.abs(own[:, :, 2]).max()) or 1.0
    for _ in range(_ROUNDS):
        far, slopes = _from_axis(own, unknown, size)
        unknown = unknown + _step(slopes, far - unknown[:, None, 4])
    far, _ = _from_axis(own, unknown, size)
    ones = np.ones(len(points))
    axis = np.stack([unknown[:, 2] / size, unknown[:, 3] / size, ones], axis=1)
    axis /= np.sqrt((axis**2).sum(axis=1))[:, None]
    place = np.stack([unknown[:, 0], unknown[:, 1], beside], axis=1)
    return AssociatedElements(
        "cylinder", feature.centre + place @ frame, axis @ frame, unknown[:, 4], np.ptp(far, axis=1)
    )


def _from_axis(own: F64, unknown: F64, size: float) -> tuple[F64, F64]:
    """Distances from the axes, (d, n), and how distance − radius changes, (d, n, 5)."""
    x, y, a, b = (unknown[:, None, i] for i in range(4))
    a, b = a / size, b / size
    px, py, pz = own[:, :, 0] - x, own[:, :, 1] - y, own[:, :, 2]
    along = (a * px + b * py + pz) / (1.0 + a**2 + b**2)
    dx, dy, dz = px - along * a, py - along * b, pz - along
    far = np.sqrt(dx**2 + dy**2 + dz**2)
    ux, uy = dx / far, dy / far
    return far, np.stack([-ux, -uy, -ux * along / size, -uy * along / size, -np.ones_like(far)], 2)


def _step(slopes: F64, residual: F64) -> F64:
    """The step of Gauss–Newton, (d, k)."""
    normal = np.einsum("dni,dnj->dij", slopes, slopes)
    right = np.einsum("dni,dn->di", slopes, residual)
    return np.asarray(-np.linalg.solve(normal, right[:, :, None])[:, :, 0])
