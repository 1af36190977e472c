"""Where a campaign's rows were measured in space, for its pictures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.machine.machine import Machine

F64 = NDArray[np.float64]


def places(campaign: Campaign, machine: Machine | None) -> F64:
    """Where each row was measured, shape (n, 3), mm.

    Of machines with X, Y and Z, where these stand. An arm or a SCARA robot has only some of them:
    there it is where its joints take the functional point.
    """
    if machine is None or not reaches_by_joints(machine):
        return campaign.functional_moves()
    return np.asarray(Chain(machine, campaign.conditions).point)


def reaches_by_joints(machine: Machine) -> bool:
    """Whether joints take the functional point where X, Y or Z would: an arm, a SCARA robot."""
    structure = machine.structure
    joints = set(structure.rotary) & set(structure.tool_side)
    return bool(joints) and not {"X", "Y", "Z"} <= set(structure.axes)
