"""An exact machine of homogeneous transformations, written apart: nothing from compcore.

Any structure, linear and rotary axes of any direction on both sides of the bed, rotary axes
anywhere in space, a spindle. Errors are full rotations. Units mm and rad.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

Six = Sequence[float]
NONE = (0.0,) * 6


def shifted(vector: Sequence[float]) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = vector
    return matrix


def turned(vector: Sequence[float], about: Sequence[float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """A right-handed rotation by a rotation vector about a point."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(vector).as_matrix()
    return shifted(about) @ matrix @ shifted(-np.asarray(about))


@dataclass(frozen=True)
class Joint:
    """An axis: linear along, or rotary about a line with this direction."""

    name: str
    rotary: bool
    direction: Sequence[float]
    point: Sequence[float] = (0.0, 0.0, 0.0)
    """Rotary: a point of the line. Linear: the point about which its errors turn."""

    def move(self, position: float) -> np.ndarray:
        along = np.asarray(self.direction) * position
        return turned(along, self.point) if self.rotary else shifted(along)

    def err(self, six: Six) -> np.ndarray:
        return shifted(six[:3]) @ turned(six[3:], self.point)


@dataclass(frozen=True)
class HomogeneousMachine:
    """Joints from the workpiece to the bed and from the bed to the tool."""

    workpiece_side: Sequence[Joint]
    tool_side: Sequence[Joint]
    spindle: Sequence[float] | None = None
    acts: Mapping[str, str] = field(default_factory=dict)
    """Linear axis → ``before`` or ``after``, where it is not the side's usual order."""

    def frame(
        self,
        position: Mapping[str, float],
        tool: Sequence[float],
        errors: Mapping[str, Six],
        spindle_angle: float = 0.0,
    ) -> np.ndarray:
        """Workpiece → tool point, 4×4. Errors by axis, ``workpiece`` and ``spindle``."""
        place = np.asarray(errors.get("workpiece", NONE))
        chain = shifted(place[:3]) @ turned(place[3:])
        for joint in (*self.workpiece_side, *self.tool_side):
            on_table = joint in self.workpiece_side
            move = joint.move(position[joint.name])
            error = joint.err(errors.get(joint.name, NONE))
            if joint.rotary:
                # a rotary axis errs in its stator, which is the part on the side of the bed
                error_first = not on_table
            else:
                usual = "before" if on_table else "after"
                error_first = self.acts.get(joint.name, usual) == "before"
            chain = chain @ error @ move if error_first else chain @ move @ error
        place = np.asarray(errors.get("spindle", NONE))
        chain = chain @ shifted(place[:3]) @ turned(place[3:])
        if self.spindle is not None:
            chain = chain @ turned(np.asarray(self.spindle) * spindle_angle)
        return chain @ shifted(tool)

    def table(self, position: Mapping[str, float]) -> np.ndarray:
        """Nominal orientation of the bed as seen from the workpiece, 3×3."""
        chain = np.eye(4)
        for joint in self.workpiece_side:
            chain = chain @ joint.move(position[joint.name])
        return chain[:3, :3]

    def error(
        self,
        position: Mapping[str, float],
        tool: Sequence[float],
        errors: Mapping[str, Six],
        spindle_angle: float = 0.0,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Displacement (3,) and orientation (3, 3) against nominal, seen in the axes of the bed."""
        nominal = self.frame(position, tool, {}, spindle_angle)
        actual = self.frame(position, tool, errors, spindle_angle)
        bed = self.table(position)
        rotation = actual[:3, :3] @ nominal[:3, :3].T
        return bed.T @ (actual - nominal)[:3, 3], bed.T @ rotation @ bed

    def first_order(
        self,
        position: Mapping[str, float],
        tool: Sequence[float],
        errors: Mapping[str, Six],
        spindle_angle: float = 0.0,
    ) -> tuple[np.ndarray, np.ndarray]:
        """The part linear in the errors: displacement (3,) and rotation vector (3,).

        From errors of both signs, so that what is left is of third order.
        """
        minus = {k: -np.asarray(v) for k, v in errors.items()}
        up = self.error(position, tool, errors, spindle_angle)
        down = self.error(position, tool, minus, spindle_angle)
        odd = 0.5 * (up[1] - down[1])
        rotation = 0.5 * np.array(
            [odd[2, 1] - odd[1, 2], odd[0, 2] - odd[2, 0], odd[1, 0] - odd[0, 1]]
        )
        return 0.5 * (up[0] - down[0]), rotation
