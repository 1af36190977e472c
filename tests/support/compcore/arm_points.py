"""An arm of six joints by products of homogeneous transforms, and a tracker's points of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from abbe.compcore.campaign.campaign import Campaign, Kind, Setup
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model
from tests.support.compcore.fit_cases import model

F64 = NDArray[np.float64]
Bool = NDArray[np.bool_]

JOINTS = ("C1", "B2", "B3", "A4", "B5", "A6")
PLACES = np.array(
    [[0, 0, 0], [85, 0, 487], [85, 0, 1127], [85, 0, 1332], [805, 0, 1332], [880, 0, 1332]], float
)
"""A point of each joint's line, all joints at zero, mm."""
_ABOUT = {"A": (1.0, 0.0, 0.0), "B": (0.0, 1.0, 0.0), "C": (0.0, 0.0, 1.0)}


def arm() -> Machine:
    """The arm as it is drawn."""
    axes = {
        joint: Axis(joint, (-3.0, 3.0), direction=_ABOUT[joint[0]], location=(x, y, z))
        for joint, (x, y, z) in zip(JOINTS, PLACES.tolist(), strict=True)
    }
    return Machine("arm", Structure.parse("w b " + " ".join(JOINTS) + " t"), axes)


def tips(q: F64, tool: F64, errors: F64 | None = None) -> F64:
    """Where the tip of the tool is, (n, 3) mm.

    q (n, 6) rad; tool (n, 3) mm, all joints at zero; errors (6, 6): of each joint, before it turns,
    a shift in mm and a turn Rx·Ry·Rz in rad, in the axes of what carries it.
    """
    wrong = np.zeros((6, 6)) if errors is None else errors
    out = np.empty_like(tool)
    for row, (angles, tip) in enumerate(zip(q, tool, strict=True)):
        pose = np.eye(4)
        for k, joint in enumerate(JOINTS):
            pose = pose @ _rigid(Rotation.identity(), PLACES[k])
            pose = pose @ _rigid(Rotation.from_euler("XYZ", wrong[k, 3:]), wrong[k, :3])
            turn = Rotation.from_rotvec(angles[k] * np.array(_ABOUT[joint[0]]))
            pose = pose @ _rigid(turn, np.zeros(3)) @ _rigid(Rotation.identity(), -PLACES[k])
        out[row] = (pose @ np.append(tip, 1.0))[:3]
    return out


def campaign_of(q: F64, tool: F64, error: F64, second: Bool) -> tuple[Model, Campaign]:
    """All that an arm's geometry can lack, composed in full, and points from two places."""
    machine = arm()
    n = len(q)
    conditions = Conditions(
        {joint: np.repeat(q[:, k], 3) for k, joint in enumerate(JOINTS)},
        tool=np.repeat(tool, 3, axis=0),
        setup=np.repeat(np.where(second, "two", "one"), 3),
        u=np.tile(np.eye(3), (n, 1)),
    )
    empty = np.full(3 * n, "")
    campaign = Campaign(
        "points", conditions, np.full(3 * n, Kind.DISPLACEMENT, dtype=np.int8),
        error.reshape(-1), np.full(3 * n, 0.02), empty, empty, np.arange(3 * n),
        setups={name: Setup(name, ("frame",)) for name in ("one", "two")},
    )  # fmt: skip
    whole = [f"rotary_location axis={joint}" for joint in JOINTS]
    whole += ["spindle_location", *(f"spindle_squareness direction={d}" for d in "YZ")]
    return replace(model(machine, *whole), composition="exact"), campaign


def _rigid(rotation: Rotation, shift: F64) -> F64:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation.as_matrix(), shift
    return out
