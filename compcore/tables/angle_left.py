"""What tables leave of the angles of rotary axes, where no linear axis makes a lever of them."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.error_motion import ErrorMotion
from abbe.compcore.machine.machine import own_component
from abbe.compcore.tables.projection.motions import LETTERS
from abbe.compcore.tables.remainder import TrialPoints
from abbe.compcore.tables.table import Table

F64 = NDArray[np.float64]


def angle_left(trial: TrialPoints, axis: str, tables: Iterable[Table] = ()) -> F64:
    """The error of a rotary axis's own angle at points of a volume, its mean taken off, (n,), rad.

    Parameters
    ----------
    trial
        The points.
    axis
        The axis.
    tables
        What is compensated.
    """
    turn = ErrorMotion(axis, LETTERS["XYZABC".index(own_component(axis))])
    at = trial.positions[axis]
    found = trial.field.motions(trial.positions, trial.directions)
    left = np.broadcast_to(found.get(turn, np.zeros(1)), at.shape).astype(float)
    conditions = trial.field.conditions(trial.positions, trial.directions)
    for table in tables:
        if table.output == turn:
            left = left - table.value(conditions)
    return np.asarray(left - left.mean())
