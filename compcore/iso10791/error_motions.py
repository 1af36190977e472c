"""Error motions of a rotary axis at each of its angles, as columns of what a test reads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.effects.base import ErrorMotion
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.machine.machine import own_component

F64 = NDArray[np.float64]

_SAME_ANGLE = 1e-5
_OF_A_POINT = 3
"""Components of a point's motion."""
_SEPARATED = 0.03
"""Part of the largest singular value that the least must have for components to be separate."""


@dataclass(frozen=True, eq=False)
class AngleCurve:
    """One error motion of a rotary axis over its angle.

    Attributes
    ----------
    motion
        Which; with `at_sphere` the motion of the sphere itself in that direction.
    angle
        Shape (m,), rad, ascending.
    value
        Shape (m,): error of the tool relative to the workpiece, mm or rad, without what the line's
        place and lean explain.
    way
        1 or −1: of the angles that were approached with rising, or falling, numbers; 0: of all.
    at_sphere
        Whether it could not be separated from tilts times levers: one sphere, or one height.
    """

    motion: ErrorMotion
    angle: F64
    value: F64
    way: int
    at_sphere: bool

    @property
    def range(self) -> float:
        """Greatest less least, mm or rad."""
        return float(np.ptp(self.value))


@dataclass(frozen=True, eq=False)
class MotionColumns:
    """Columns of the error motions of one axis at each of its angles, row by row.

    Attributes
    ----------
    columns
        Shape (n, angles · components).
    angle, way
        Shape (m,): angles, rad, and the way in which they were approached.
    components
        Which of the six.
    unit
        What one unit of each component's column is, mm or rad.
    """

    columns: F64
    angle: F64
    way: NDArray[np.int64]
    components: tuple[int, ...]
    unit: F64

    @classmethod
    def of(cls, campaign: Campaign, chain: Chain, axis: str) -> MotionColumns:
        """As many components as the spheres separate at every angle; else the sphere's own."""
        c = campaign.conditions
        number, angle, way = _groups(c, axis)
        seen = _seen(chain, c, axis)
        own = "XYZABC".index(own_component(axis))
        every = tuple(range(6))
        choices = (every, tuple(k for k in every if k != own), (0, 1, 2))
        chosen = next((k for k in choices if _separable(seen[:, list(k)], number)), ())
        columns = np.zeros((campaign.n, len(angle), len(chosen)))
        columns[np.arange(campaign.n), number] = seen[:, list(chosen)]
        unit = np.r_[np.ones(3), np.full(3, 1.0 / _reach(chain, axis))][list(chosen)]
        return cls(columns.reshape(campaign.n, -1), angle, way, chosen, unit)

    def curves(self, axis: str, amount: F64) -> tuple[AngleCurve, ...]:
        """The error motions that amounts of the columns are."""
        values = amount.reshape(len(self.angle), len(self.components)) * self.unit
        return tuple(
            AngleCurve(
                ErrorMotion(axis, "XYZABC"[k]),  # type: ignore[arg-type]
                self.angle[self.way == way],
                values[self.way == way, j],
                int(way),
                at_sphere=len(self.components) == _OF_A_POINT,
            )
            for j, k in enumerate(self.components)
            for way in np.unique(self.way)[::-1]
        )


def _groups(conditions: Conditions, axis: str) -> tuple[NDArray[np.int64], F64, NDArray[np.int64]]:
    """Group of each row by the axis's angle and way, (n,); the groups' angles, rad, and ways."""
    angle = conditions.position(axis)
    way = np.zeros(len(angle), dtype=np.int64)
    if axis in conditions.directions:
        way = conditions.directions[axis].astype(np.int64)
    keys = np.stack([way, np.rint(angle / _SAME_ANGLE).astype(np.int64)], axis=1)
    _, first, number = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return number.reshape(-1).astype(np.int64), angle[first], way[first]


def _seen(chain: Chain, conditions: Conditions, axis: str) -> F64:
    """What each row sees of the six error motions, (n, 6); angles in mm at the mean lever."""
    u = measured_directions(conditions)
    reach = _reach(chain, axis)
    columns = []
    for k in "XYZABC":
        moved, _ = chain.influence(ErrorMotion(axis, k))  # type: ignore[arg-type]
        columns.append(np.einsum("ni,ni->n", moved, u) / (reach if k in "ABC" else 1.0))
    return np.stack(columns, axis=1)


def measured_directions(conditions: Conditions) -> F64:
    """The unit vectors of the rows, shape (n, 3); zeros where there are none."""
    return np.zeros((conditions.n, 3)) if conditions.u is None else conditions.u


def _reach(chain: Chain, axis: str) -> float:
    """Mean length of the lever, mm; at least 1."""
    return max(1.0, float(np.linalg.norm(chain.lever(axis), axis=1).mean()))


def _separable(seen: F64, number: NDArray[np.int64]) -> bool:
    """Whether the readings at most of the angles determine all of these components."""
    count = int(number.max()) + 1
    full = 0
    for i in range(count):
        size = np.linalg.svd(seen[number == i], compute_uv=False)
        full += len(size) == seen.shape[1] and size[-1] > _SEPARATED * size[0]
    return full == count
