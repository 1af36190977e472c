"""Features by their touched points, or by a pattern of points on an ideal element."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError
from abbe.compcore.units import in_digits
from abbe.compcore.virtual_cmm.elements import basis
from abbe.compcore.virtual_cmm.features import FEWEST, ElementKind, TouchedFeature

F64 = NDArray[np.float64]
Place = tuple[float, float, float]

_OFF = 1.0
"""mm by which a nominal point may lie beside the ideal element through all of them."""


@dataclass(frozen=True, slots=True)
class FeatureName:
    """A feature's name, the element that it is, its stylus, and its surface's scatter, mm."""

    name: str
    kind: ElementKind
    stylus: str
    surface: float


@dataclass(frozen=True, eq=False)
class PlacedPattern:
    """Where the part lies: its origin (3,), mm, and its axes as columns (3, 3), in the machine."""

    origin: F64
    turn: F64

    def feature(
        self,
        points: F64,
        normals: F64,
        centre: F64,
        axis: F64,
        radius: float,
        named: FeatureName,
    ) -> TouchedFeature:
        """A feature of the part in the machine's coordinates."""
        return TouchedFeature(
            named.name,
            named.kind,
            self.origin + points @ self.turn.T,
            normals @ self.turn.T,
            named.stylus,
            self.origin + self.turn @ centre,
            self.turn @ axis,
            radius,
            named.surface,
        )


def from_points(
    points: F64,
    normals: F64,
    placed: PlacedPattern,
    named: FeatureName,
) -> TouchedFeature:
    """A feature by its points and the directions out of the material at them, each (n, 3).

    Raises
    ------
    InputError
        For points that are not those of such an element.
    """
    kind = named.kind
    size = np.linalg.norm(normals, axis=1)
    if (size < 1e-9).any():
        zero = normals[int(size.argmin())].tolist()
        raise InputError("not a direction", field="normals", found=zero, expected="not all zero")
    normals = normals / size[:, None]
    middle = points.mean(axis=0)
    own = points - middle
    axis = normals.mean(axis=0) if kind in ("point", "plane") else np.array([0.0, 0.0, 1.0])
    centre, radius = middle, 0.0
    if len(points) < FEWEST[kind]:
        raise InputError(
            f"too few points of a {kind}", found=len(points), expected=f"{FEWEST[kind]} or more"
        )
    if kind in ("circle", "cylinder"):
        # the direction in which no normal looks is the axis
        axis = np.linalg.eigh(normals.T @ normals)[1][:, 0]
    if kind in ("circle", "cylinder", "sphere"):
        across = own if kind == "sphere" else own - np.outer(own @ axis, axis)
        columns = np.column_stack([2.0 * across, np.ones(len(own))])
        found, *_ = np.linalg.lstsq(columns, (across**2).sum(axis=1), rcond=None)
        radius = float(np.sqrt(max(found[3] + found[:3] @ found[:3], 0.0)))
        centre = middle + found[:3]
        away = np.linalg.norm(across - found[:3], axis=1) - radius
    else:
        axis = axis / max(float(np.linalg.norm(axis)), 1e-300)
        away = own @ axis if kind == "plane" else np.zeros(1)
    if float(np.ptp(away)) > _OFF or (kind in ("circle", "cylinder", "sphere") and radius <= 0.0):
        raise InputError(
            f"its points are not those of a {kind}",
            found=f"{in_digits(float(np.ptp(away)))} mm apart",
            expected="nominal points, and directions out of the material",
        )  # fmt: skip
    return placed.feature(points, normals, centre, axis, radius, named)


def from_pattern(
    placed: PlacedPattern,
    named: FeatureName,
    *,
    at: Place | None,
    axis: Place,
    diameter: float | None,
    inside: bool,
    count: int | None,
    start: float,
    span: float,
    length: float | None,
    levels: int,
    size: tuple[float, float] | None,
    grid: tuple[int, int],
) -> TouchedFeature:
    """A feature by a pattern: `at` the middle, `axis` its direction; mm and rad.

    A circle has `count` points from `start` over `span`, counted about its axis from the part's X
    (`elements.basis`); a cylinder as many on each of its `levels` over its `length`; a plane a
    `grid` over its `size`; a sphere `count` over the half to which its axis points, evenly, the
    pole first; a point is one.

    Raises
    ------
    InputError
        For what the pattern lacks.
    """
    kind = named.kind
    if at is None:
        raise InputError("neither points nor a pattern", field="at", expected="at = [x, y, z]")
    direction = np.array(axis)
    if float(np.linalg.norm(direction)) < 1e-9:
        raise InputError("not a direction", field="axis", found=list(axis))
    direction = direction / np.linalg.norm(direction)
    frame = basis(direction)
    radius = 0.0
    if kind in ("circle", "sphere", "cylinder"):
        if diameter is None:
            raise InputError(f"a {kind} has a diameter", field="diameter", expected="mm")
        radius = 0.5 * diameter
    if kind == "point":
        own, normals = np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]])
    elif kind == "plane":
        own, normals = _grid(size, grid)
    elif kind == "sphere":
        own, normals = _half(count or 9, radius)
    else:
        own, normals = _ring(count or 8, start, span, radius)
        if kind == "cylinder":
            if length is None:
                raise InputError("a cylinder has a length", field="length", expected="mm")
            heights = np.linspace(-0.5 * length, 0.5 * length, levels)
            up = np.repeat(heights, len(own))[:, None] * np.array([0.0, 0.0, 1.0])
            own, normals = np.tile(own, (levels, 1)) + up, np.tile(normals, (levels, 1))
    if inside:
        normals = -normals
    return placed.feature(
        np.array(at) + own @ frame, normals @ frame, np.array(at), direction, radius,
        named
    )  # fmt: skip


def _ring(count: int, start: float, span: float, radius: float) -> tuple[F64, F64]:
    whole = span > 2.0 * np.pi - 1e-9
    angle = start + span * np.arange(count) / (count if whole else max(count - 1, 1))
    out = np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)
    return radius * out, out


def _half(count: int, radius: float) -> tuple[F64, F64]:
    """Evenly over half a sphere, the pole first (Fibonacci's lattice)."""
    number = np.arange(count)
    height = 1.0 - number / max(count - 1, 1)
    angle = number * np.pi * (3.0 - np.sqrt(5.0))
    flat = np.sqrt(1.0 - height**2)
    out = np.stack([flat * np.cos(angle), flat * np.sin(angle), height], axis=1)
    return radius * out, out


def _grid(size: tuple[float, float] | None, grid: tuple[int, int]) -> tuple[F64, F64]:
    if size is None:
        raise InputError("a plane has a size", field="size", expected="[mm, mm]")
    one, two = (np.linspace(-0.5 * s, 0.5 * s, n) for s, n in zip(size, grid, strict=True))
    first, second = (v.reshape(-1) for v in np.meshgrid(one, two, indexing="ij"))
    own = np.stack([first, second, np.zeros(len(first))], axis=1)
    return own, np.tile([0.0, 0.0, 1.0], (len(own), 1))
