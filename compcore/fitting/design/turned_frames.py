"""How an instrument stands, set-up by set-up, where it is turned by more than a small angle.

To first order a set-up that leaves its frame unknown adds six columns to the rows (`nuisance`).
That is enough for an instrument that was aligned. A tracker in front of an arm whose joints stand
20 mrad elsewhere is aligned to an arm that is not there: turned by as much, it sees errors of
10 mm in other directions, 0.2 mm of them along the wrong one. Where a model composes errors in
full, its set-ups' frames are rigid motions in full as well.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.kinematics import rotation_about

F64 = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Seen:
    """What rows see of where the machine really stands, all in the workpiece's frame.

    Attributes
    ----------
    point
        Functional points as the machine indicates them, (n, 3), mm.
    actual
        Where the model puts them, (n, 3), mm.
    toward, about
        Directions in which rows see a displacement and a rotation, (n, 3); 0 where none.
    value
        What the rows read less what the model predicts, the instrument not turned, (n,).
    """

    point: F64
    actual: F64
    toward: F64
    about: F64
    value: F64


@dataclass(frozen=True, eq=False)
class TurnedFrames:
    """Rigid motions of set-ups' instruments: what stands at p is seen at ``R·p + s``.

    Attributes
    ----------
    names
        The set-ups that have one.
    of_row
        Shape (n,): which of them a row belongs to, −1 for none.
    rotation, shift
        Shapes (k, 3, 3) and (k, 3), mm; workpiece's frame.
    values
        Set-up → name of a nuisance → (value, unit): how the frame stands, about its points' middle.
    """

    names: tuple[str, ...]
    of_row: Index
    rotation: F64
    shift: F64
    values: dict[str, dict[str, tuple[float, str]]]

    def rows(self, rows: Index) -> TurnedFrames:
        """The frames of some of the rows."""
        return TurnedFrames(self.names, self.of_row[rows], self.rotation, self.shift, self.values)

    def on(self, setups: Sequence[tuple[str, Index]], n: int) -> TurnedFrames:
        """The same frames on all n rows of the set-ups, given by name and rows."""
        of_row = np.full(n, -1, dtype=np.int64)
        for name, rows in setups:
            if name in self.names:
                of_row[rows] = self.names.index(name)
        return TurnedFrames(self.names, of_row, self.rotation, self.shift, self.values)

    def placed(self, point: F64) -> F64:
        """Points, (n, 3) mm, as each row's instrument sees them."""
        out = point.copy()
        for k in range(len(self.names)):
            own = self.of_row == k
            out[own] = point[own] @ self.rotation[k].T + self.shift[k]
        return out

    def turned(self, about: F64) -> F64:
        """What the instruments' turns add to rotations seen about (n, 3) directions, (n,) rad."""
        out = np.zeros(len(about))
        for k in range(len(self.names)):
            own = self.of_row == k
            out[own] = about[own] @ turn_of(self.rotation[k])
        return out

    def back(self, toward: F64) -> F64:
        """Directions of the instruments, (n, 3), as they lie beside the machine."""
        out = toward.copy()
        for k in range(len(self.names)):
            own = self.of_row == k
            out[own] = toward[own] @ self.rotation[k]
        return out


def turn_of(rotation: F64) -> F64:
    """The rotation vector of a rotation matrix (3, 3): axis times angle, rad, below half a turn."""
    skew = 0.5 * (rotation - rotation.T)
    vector = np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
    sine = float(np.linalg.norm(vector))
    angle = math.atan2(sine, 0.5 * (float(np.trace(rotation)) - 1.0))
    return np.asarray(vector * (angle / sine) if sine > 0.0 else vector)


def turn_by(vector: F64) -> F64:
    """The rotation matrix (3, 3) of a rotation vector, rad."""
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    return np.asarray(rotation_about(vector / angle, np.array([angle]))[0])
