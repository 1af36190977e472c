"""What is evaluated of a part's features: lengths, diameters, form, angles, places."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.virtual_cmm.elements import AssociatedElements, associated
from abbe.compcore.virtual_cmm.features import FORM, PartCharacteristic
from abbe.compcore.virtual_cmm.part_program import PartProgram

F64 = NDArray[np.float64]
Elements = Mapping[str, AssociatedElements]

_ALONG = 0.999
"""Cosine from which an axis lies along another."""


def evaluated(program: PartProgram, points: F64) -> F64:
    """Every characteristic of d sets of points.

    Parameters
    ----------
    points
        Surface points of all features one after the other, shape (d, n, 3), mm.

    Returns
    -------
    Shape (d, c), mm (angles: rad).
    """
    split = program.split(points)
    used = {name for one in program.characteristics for name in (*one.of, *one.datums)}
    found = {f.name: associated(f, split[f.name]) for f in program.features if f.name in used}
    nominal = program.split(program.points[None])
    ideal = {f.name: associated(f, nominal[f.name]) for f in program.features if f.name in used}
    return np.stack([_figure(one, found, ideal) for one in program.characteristics], axis=1)


def _figure(one: PartCharacteristic, found: Elements, ideal: Elements) -> F64:
    first = found[one.of[0]]
    if one.quantity == "diameter":
        return 2.0 * first.radius
    if one.quantity in FORM:
        return first.form
    if one.quantity == "angle":
        return _angle(first.axis, found[one.of[1]].axis)
    if one.quantity == "distance":
        return _distance(one, first, found[one.of[1]])
    here = _in_datums(one.datums, found, first.centre)
    if one.quantity in ("x", "y", "z"):
        return np.asarray(here["xyz".index(one.quantity)])
    ideally = ideal[one.of[0]]
    off = here - _in_datums(one.datums, ideal, ideally.centre)
    if first.kind in ("circle", "cylinder") and one.datums:
        # a hole's place is that of its axis
        along = float(ideally.axis[0] @ ideal[one.datums[0]].axis[0])
        off = off[:2] if abs(along) > _ALONG else off
    return np.asarray(2.0 * np.sqrt((off**2).sum(axis=0)))


def _distance(
    one: PartCharacteristic, first: AssociatedElements, second: AssociatedElements
) -> F64:
    way = second.centre - first.centre
    if one.along is not None:
        return np.asarray(np.abs(way @ one.along))
    for plane in (first, second):
        if plane.kind == "plane":
            return np.asarray(np.abs(np.einsum("di,di->d", way, plane.axis)))
    return np.asarray(np.sqrt((way**2).sum(axis=1)))


def _angle(first: F64, second: F64) -> F64:
    across = np.sqrt((np.cross(first, second) ** 2).sum(axis=1))
    return np.asarray(np.arctan2(across, np.einsum("di,di->d", first, second)))


def _in_datums(names: Sequence[str], found: Elements, place: F64) -> F64:
    """Coordinates in the system that datums make, shape (3, d), mm; none: the machine's.

    The first datum is a plane (z = 0, its normal z) or a cylinder (its axis z, x = y = 0). A second
    plane is x = 0; a second centre is the origin of what is still free, or with a cylinder the
    direction of x. A third plane is y = 0; a third centre is where x goes to from the second.
    """
    if not names:
        return place.T
    first, *others = (found[name] for name in names)
    z = first.axis
    origin = first.centre.copy()
    second = others[0]
    if second.kind == "plane":
        x = _across(second.axis, z)
        origin = origin + np.einsum("di,di->d", second.centre - origin, x)[:, None] * x
        y = np.cross(z, x)
        if len(others) > 1:
            origin = origin + np.einsum("di,di->d", others[1].centre - origin, y)[:, None] * y
    else:
        if first.kind == "cylinder":
            x = _across(second.centre - origin, z)
        else:
            way = second.centre - origin
            origin = origin + way - np.einsum("di,di->d", way, z)[:, None] * z
            towards = others[1].centre - origin if len(others) > 1 else np.zeros_like(origin)
            x = _across(towards, z) if len(others) > 1 else _across(np.eye(3)[:1] + 0.0 * z, z)
        y = np.cross(z, x)
    own = place - origin
    return np.stack([np.einsum("di,di->d", own, axis) for axis in (x, y, z)])


def _across(way: F64, z: F64) -> F64:
    """What of directions lies across z, unit vectors (d, 3)."""
    rest = way - np.einsum("di,di->d", way, z)[:, None] * z
    return np.asarray(rest / np.sqrt((rest**2).sum(axis=1))[:, None])
