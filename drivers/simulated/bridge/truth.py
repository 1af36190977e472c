"""The exact machine: full 4 × 4 homogeneous transformations, for any structure code.

This is the independent truth that simulations and tests hold Abbe's models against. It shares no
formula with `compcore` and imports nothing of it: no small angles, no levers, no effects, only
rigid bodies put one behind the other, each rotation a full rotation matrix.

Conventions (error = actual − indicated; mm, rad; right-handed)
    The chain is walked from the workpiece to the tool, ``w X' b Y Z C t``. Every element has a
    nominal move ``M(q)``, by +q along (or about) its axis on whichever side of the bed it sits,
    since a positive move takes the tool in the positive direction relative to the workpiece. Its
    error ``E`` is a rigid displacement with three translations and three rotations. An axis on the
    tool side errs after its own move, ``M · E``; one on the workpiece side (primed) before it,
    ``E · M``. The functional point in the workpiece's frame is the product of all, applied to the
    tool's offset; its error is that minus the same product without any error.

    A `mount` is how an axis's guideway is fixed to what carries it, on the side of the bed:
    ``mount · M · E`` on the tool side, ``E · M · mount`` on the workpiece side. Squareness errors
    are rotations of mounts.

    All frames coincide with the machine's when every axis stands at 0.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array: TypeAlias = NDArray[np.float64]
State: TypeAlias = Mapping[str, ArrayLike]
"""Indicated positions by axis name (mm, rad) and whatever else errors depend on (temperatures in
°C, ...), each a number or an array; all are broadcast together."""

SixErrors: TypeAlias = Callable[[State], ArrayLike]
"""State → the six error motions (..., 6): translations x, y, z in mm, rotations about x, y, z in
rad (the direction is the rotation's axis, the length its angle)."""

PERFECT_MOUNT: Final = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
_DIRECTION: Final = {"X": 0, "Y": 1, "Z": 2, "U": 0, "V": 1, "W": 2, "A": 0, "B": 1, "C": 2}
_ROTARY: Final = frozenset("ABC")


@dataclass(frozen=True)
class ExactAxis:
    """What is not perfect about one axis; everything defaults to perfect.

    Attributes
    ----------
    error
        The six error motions as a function of the state.
    actual
        How far the axis really goes for its indicated position (mm, rad), as a function of the
        state: a scale that expands, a gear that is wrong. Default: as far as indicated.
    mount
        Three translations (mm) and three rotations (rad) of the guideway's fixing.
    rotation_point
        Point (mm) of the axis's own frame about which the error's rotations turn.
    location
        A point (mm) on the axis line of a rotary axis, all axes at 0.
    """

    error: SixErrors | None = None
    actual: Callable[[State], ArrayLike] | None = None
    mount: Sequence[float] = PERFECT_MOUNT
    rotation_point: Sequence[float] = (0.0, 0.0, 0.0)
    location: Sequence[float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Element:
    """One axis of a structure code: its name, its side of the bed, its direction.

    Attributes
    ----------
    name
        ``X``, ``C``; a spindle is ``(C)``.
    on_tool_side
        False where the code has a prime.
    direction
        0, 1, 2: along or about x, y, z.
    rotary
        Turns instead of moving.
    """

    name: str
    on_tool_side: bool
    direction: int
    rotary: bool


def parse_structure(code: str) -> tuple[Element, ...]:
    """Read a structure code such as ``w X' b Y Z C B (C) t`` (ISO 10791-6, ISO/TR 16907).

    Raises
    ------
    ValueError
        When it is not ``w``, primed axes, ``b``, unprimed axes, ``t``.
    """
    words = code.split()
    if words[:1] != ["w"] or words[-1:] != ["t"] or words.count("b") != 1:
        raise ValueError(f"structure {code!r}: expected 'w ... b ... t'")
    bed = words.index("b")
    elements = []
    for place, word in enumerate(words[1:-1], start=1):
        if place == bed:
            continue
        match = re.fullmatch(r"(\(?)([A-CU-Z])(\d*)(\)?)('?)", word)
        if match is None or bool(match[1]) is not bool(match[4]):
            raise ValueError(f"structure {code!r}: {word!r} is no axis")
        if bool(match[5]) is not (place < bed):
            raise ValueError(f"structure {code!r}: a prime marks an axis before b, see {word!r}")
        rotary = match[2] in _ROTARY
        elements.append(Element(word.rstrip("'"), place > bed, _DIRECTION[match[2]], rotary))
    names = [element.name for element in elements]
    if len(set(names)) != len(names):
        raise ValueError(f"structure {code!r}: an axis appears twice")
    return tuple(elements)


@dataclass(frozen=True)
class ExactMachine:
    """A machine as a chain of rigid bodies.

    Attributes
    ----------
    structure
        The structure code.
    axes
        What is not perfect, by axis name; an axis that is not listed is perfect.
    travels
        Ends of the travels (mm, rad) by axis name; for those who sample the volume.
    """

    structure: str
    axes: Mapping[str, ExactAxis] = field(default_factory=dict)
    travels: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    elements: tuple[Element, ...] = field(init=False)
    _mounts: Mapping[str, Array] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "elements", parse_structure(self.structure))
        known = {element.name for element in self.elements}
        for name in (*self.axes, *self.travels):
            if name not in known:
                raise ValueError(f"no axis {name!r} in the structure {self.structure!r}")
        mounts = {name: rigid(axis.mount) for name, axis in self.axes.items()}
        object.__setattr__(self, "_mounts", mounts)

    def pose(self, state: State) -> Array:
        """Where the tool's frame really is in the workpiece's frame, shape (..., 4, 4)."""
        return self._chain(state, actual=True)

    def nominal_pose(self, state: State) -> Array:
        """Where the tool's frame would be without any error, shape (..., 4, 4)."""
        return self._chain(state, actual=False)

    def point(self, state: State, tool: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
        """The functional point's actual position in the workpiece's frame, mm, shape (..., 3).

        Parameters
        ----------
        state
            Indicated positions and conditions.
        tool
            Offset of the tool's or probe's tip, mm, shape (..., 3).
        """
        return _apply(self.pose(state), tool)

    def error(self, state: State, tool: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
        """Error of the functional point, actual − indicated, mm, shape (..., 3)."""
        return _apply(self.pose(state), tool) - _apply(self.nominal_pose(state), tool)

    def orientation_error(self, state: State) -> Array:
        """Error of the functional orientation as a rotation vector, rad, shape (..., 3).

        The one rotation, in the workpiece's frame, that turns the nominal orientation into the
        actual one; its component along u is what a level or an autocollimator reads about u.
        """
        actual, nominal = self.pose(state)[..., :3, :3], self.nominal_pose(state)[..., :3, :3]
        return rotation_vector(actual @ np.swapaxes(nominal, -1, -2))

    def _chain(self, state: State, *, actual: bool) -> Array:
        pose: Array = np.eye(4)
        for element in self.elements:
            axis = self.axes.get(element.name, _PERFECT)
            q = np.asarray(state[element.name], dtype=float)
            if not actual or axis is _PERFECT:
                pose = pose @ _move(element, axis, q)
                continue
            if axis.actual is not None:
                q = np.asarray(axis.actual(state), dtype=float)
            move, mount = _move(element, axis, q), self._mounts[element.name]
            error = np.eye(4)
            if axis.error is not None:
                about = np.asarray(axis.rotation_point, dtype=float)
                if element.rotary:
                    # A rotary axis errs about its own line, wherever that is.
                    about = about + np.asarray(axis.location, dtype=float)
                error = _about(rigid(axis.error(state)), about)
            if element.on_tool_side:
                pose = pose @ mount @ move @ error
            else:
                pose = pose @ error @ move @ mount
        return pose


_PERFECT = ExactAxis()


def rigid(six: ArrayLike) -> Array:
    """Rigid displacement (..., 4, 4) with translations (mm) and a rotation vector (rad)."""
    six = np.asarray(six, dtype=float)
    out = np.zeros((*six.shape[:-1], 4, 4))
    out[..., :3, :3] = rotation(six[..., 3:])
    out[..., :3, 3] = six[..., :3]
    out[..., 3, 3] = 1.0
    return out


def rotation(vector: ArrayLike) -> Array:
    """Rotation matrix (..., 3, 3) about a vector by its length in rad: Rodrigues' formula."""
    vector = np.asarray(vector, dtype=float)
    x, y, z = vector if vector.ndim == 1 else np.moveaxis(vector, -1, 0)
    # The tiny summand makes 0 / 0 the 1 that it tends to, and is lost beside any real angle.
    half = 0.5 * np.sqrt(x * x + y * y + z * z + 1e-300)
    by_half = np.sin(half) / half
    first = by_half * np.cos(half)  # sin θ / θ
    second = 0.5 * by_half * by_half  # (1 − cos θ) / θ²
    out = np.empty((*vector.shape[:-1], 3, 3))
    out[..., 0, 0] = 1.0 - second * (y * y + z * z)
    out[..., 1, 1] = 1.0 - second * (x * x + z * z)
    out[..., 2, 2] = 1.0 - second * (x * x + y * y)
    out[..., 0, 1] = second * x * y - first * z
    out[..., 1, 0] = second * x * y + first * z
    out[..., 0, 2] = second * x * z + first * y
    out[..., 2, 0] = second * x * z - first * y
    out[..., 1, 2] = second * y * z - first * x
    out[..., 2, 1] = second * y * z + first * x
    return out


def rotation_vector(matrix: ArrayLike) -> Array:
    """Rotation vector (..., 3), rad, of rotation matrices by less than half a turn."""
    m = np.asarray(matrix, dtype=float)
    axial = 0.5 * np.stack(
        [
            m[..., 2, 1] - m[..., 1, 2],
            m[..., 0, 2] - m[..., 2, 0],
            m[..., 1, 0] - m[..., 0, 1],
        ],
        axis=-1,
    )
    sine = np.linalg.norm(axial, axis=-1, keepdims=True)
    cosine = 0.5 * (np.trace(m, axis1=-2, axis2=-1)[..., None] - 1.0)
    angle = np.arctan2(sine, cosine)
    vector: Array = axial * np.divide(angle, sine, out=np.ones_like(sine), where=sine > 0.0)
    return vector


def _move(element: Element, axis: ExactAxis, q: Array) -> Array:
    """Nominal move by +q along or about the element's direction."""
    if element.rotary:
        six = np.zeros((*q.shape, 6))
        six[..., 3 + element.direction] = q
        return _about(rigid(six), np.asarray(axis.location, dtype=float))
    move = np.zeros((*q.shape, 4, 4))
    move[..., range(4), range(4)] = 1.0
    move[..., element.direction, 3] = q
    return move


def _about(transform: Array, point: Array) -> Array:
    """The same displacement with its rotation about another point than the origin."""
    if not np.any(point):
        return transform
    out = transform.copy()
    out[..., :3, 3] += point - transform[..., :3, :3] @ point
    return out


def _apply(pose: Array, point: ArrayLike) -> Array:
    p = np.asarray(point, dtype=float)
    moved: Array = (pose[..., :3, :3] @ p[..., None])[..., 0] + pose[..., :3, 3]
    return moved
