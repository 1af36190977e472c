"""How a tool is drawn back before anything goes across or turns: along which axis, and where to."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from abbe.compcore.errors import InputError
from abbe.compcore.machine.machine import Machine, nominal_direction
from abbe.compcore.machine.structure import is_rotary


def drawn_back(machine: Machine, offset: Sequence[float]) -> tuple[str, float]:
    """The axis along which a tool is drawn back, and where to, mm.

    It is the linear axis nearest to the tool, drawn towards the spindle.

    Raises
    ------
    InputError
        When the machine has no linear axis.
    """
    near = [a for a in machine.structure.axes if not is_rotary(a)]
    if not near:
        raise InputError(
            "a machine without linear axes has none along which its tool could be drawn back",
            field="structure",
            expected="a program of the robot's own to the plan's targets: abbe measure names each",
        )
    axis = near[-1] if near[-1] in machine.structure.tool_side else near[0]
    towards = -float(np.dot(offset, nominal_direction(axis)))
    low, high = machine.axes[axis].travel
    edge = min(1.0, 0.01 * (high - low))
    return axis, low + edge if towards < 0.0 else high - edge
