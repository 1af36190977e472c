"""An exact five-axis machine whose rotary lines lie elsewhere than its controller believes.

Written apart from compcore: products of 4×4 transformations, full rotations, mm and rad. A letter
with a prime stands on the workpiece side. The pose is that of the tool in the workpiece's frame.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

LETTER = {"X": 0, "Y": 1, "Z": 2, "A": 0, "B": 1, "C": 2}


def shift(v: Sequence[float]) -> np.ndarray:
    t = np.eye(4)
    t[:3, 3] = v
    return t


def turn(unit: Sequence[float], angle: float) -> np.ndarray:
    """Rodrigues: a right-handed turn about a unit vector through the origin."""
    x, y, z = unit
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    t = np.eye(4)
    t[:3, :3] = np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * (k @ k)
    return t


@dataclass(frozen=True)
class Line:
    """A line in space, all axes at zero: a point (mm) and a direction (unit vector)."""

    point: tuple[float, float, float]
    direction: tuple[float, float, float]

    def turned(self, angle: float) -> np.ndarray:
        return shift(self.point) @ turn(self.direction, angle) @ shift(-np.array(self.point))


def pose(
    order: Sequence[str],
    lines: Mapping[str, Line],
    q: Mapping[str, float],
    tool: Sequence[float] = (0.0, 0.0, 0.0),
) -> np.ndarray:
    """Workpiece → tool, 4×4. `order` from workpiece to tool, linear axes exact."""
    t = np.eye(4)
    for axis in order:
        along = np.eye(3)[LETTER[axis]] * q[axis]
        t = t @ (lines[axis].turned(q[axis]) if axis in lines else shift(along))
    return t @ shift(tool)


def bed(
    workpiece_side: Sequence[str], lines: Mapping[str, Line], q: Mapping[str, float]
) -> np.ndarray:
    """Directions of the machine's axes in the workpiece's frame, 3×3."""
    return pose(workpiece_side, lines, q)[:3, :3]


def moved(was: Line, now: Line) -> np.ndarray:
    """The rigid displacement that brings a line to another, 4×4; the least turn that does."""
    u, v = np.array(was.direction), np.array(now.direction)
    about = np.cross(u, v)
    size = float(np.linalg.norm(about))
    lean = np.eye(4) if size == 0.0 else turn((about / size).tolist(), np.arctan2(size, u @ v))
    return shift(now.point) @ lean @ shift(-np.array(was.point))


def moves_to(
    believed: Callable[[Mapping[str, float]], np.ndarray],
    angles: Mapping[str, float],
    target: np.ndarray,
) -> dict[str, float]:
    """Angles with the X, Y, Z that bring the tool to a point of the workpiece, as believed."""
    zero = {**dict.fromkeys("XYZ", 0.0), **angles}
    start = believed(zero)[:3, 3]
    columns = [believed({**zero, a: 1.0})[:3, 3] - start for a in "XYZ"]
    x, y, z = np.linalg.solve(np.stack(columns, axis=1), target - start)
    return {**zero, "X": float(x), "Y": float(y), "Z": float(z)}
