"""Where the tool stands relative to the workpiece when the bodies are warm: a C-frame mill.

Bed, column that bends as it is warmer in front, a head that reaches out, a spindle that hangs from
it; a table on the bed whose scales stretch. Lengths are put together body by body and turned by
true rotations; the error is what changes against 20 °C.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from benchmarks.thermal.bodies import BODIES

F64 = NDArray[np.float64]

IRON = 11e-6
SCALE = 10e-6
"""Expansion, 1/K."""

TO_COLUMN, UP, REACH, SPINDLE, TABLE, DEPTH = 700.0, 500.0, 480.0, 260.0, 350.0, 420.0
"""Bed to the column; column to Z's zero; head; spindle and tool; table's height; column, mm."""

TRAVEL = {"X": (0.0, 800.0), "Y": (-250.0, 250.0), "Z": (0.0, 500.0)}


def error(excess: Mapping[str, F64], at: F64) -> F64:
    """By how much the tool stands elsewhere than shown, (n, 3) mm.

    Parameters
    ----------
    excess
        Of each body above 20 °C, K, shape (n,).
    at
        Where X, Y and Z show, (n, 3) mm.
    """
    cold = {body: np.zeros(len(at)) for body in BODIES}
    return _tool_beside_workpiece(excess, at) - _tool_beside_workpiece(cold, at)


def _tool_beside_workpiece(excess: Mapping[str, F64], at: F64) -> F64:
    grown = {body: 1.0 + IRON * k for body, k in excess.items()}
    x, y, z = at.T
    height = (UP + z) * 0.5 * (grown["front"] + grown["rear"])
    # warmer in front: the column bends backwards, +Y, a circle of radius depth/(α·ΔT)
    curvature = IRON * (excess["front"] - excess["rear"]) / DEPTH
    angle = curvature * height
    with np.errstate(invalid="ignore", divide="ignore"):
        back = np.where(angle == 0.0, 0.0, (1.0 - np.cos(angle)) / curvature)
        up = np.where(angle == 0.0, height, np.sin(angle) / curvature)
    foot = TO_COLUMN * grown["bed"]
    reach = REACH * grown["head"]
    hangs = SPINDLE * 0.5 * (grown["bearing"] + grown["head"])
    # head and spindle turn with the column's end about X
    s, c = np.sin(angle), np.cos(angle)
    tool_y = foot + back - reach * c - hangs * s
    tool_z = up + reach * s - hangs * c
    # the table carries the workpiece under the tool: where its scales say
    work_x = -x * (1.0 + SCALE * excess["scale_x"])
    work_y = -y * (1.0 + SCALE * excess["scale_y"])
    work_z = TABLE * 0.5 * (grown["table"] + grown["bed"])
    return np.stack([-work_x, tool_y - work_y, tool_z - work_z], axis=1)
