"""How a tool is drawn back before anything goes across or turns: along which axis, and where to."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from abbe.compcore.figures.places import reaches_by_joints
from abbe.compcore.machine.machine import Machine, nominal_direction
from abbe.compcore.machine.structure import is_rotary


def draws_back(machine: Machine) -> bool:
    """Whether a linear axis draws the tool back: of an arm or a SCARA robot one beyond its joints.

    What a column under an arm would do to the tip depends on how the arm stands.
    """
    side = machine.structure.tool_side
    return bool(machine.structure.linear) and not (
        reaches_by_joints(machine) and is_rotary(side[-1])
    )


def drawn_back(machine: Machine, offset: Sequence[float]) -> tuple[str, float]:
    """The axis along which a tool is drawn back, and where to, mm; of machines that `draws_back`.

    It is the linear axis nearest to the tool, drawn towards the spindle. Not Y of a lathe, which
    moves the tool along the work's circumference.
    """
    structure = machine.structure
    near = [a for a in structure.axes if not is_rotary(a)]
    if structure.shows_diameters and near[-1] == "Y" and len(near) > 1:
        near.pop()
    axis = near[-1] if near[-1] in structure.tool_side else near[0]
    towards = -float(np.dot(offset, nominal_direction(axis)))
    low, high = machine.axes[axis].travel
    edge = min(1.0, 0.01 * (high - low))
    return axis, low + edge if towards < 0.0 else high - edge
