"""Poses of a rotary test: where X, Y, Z follow a point, and the directions that are measured."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain, crossed
from abbe.compcore.machine.machine import Machine

F64 = NDArray[np.float64]

ON_THE_LINE = 1e-6
"""mm from a rotary axis's line below which nothing is radial or tangential."""


def following(machine: Machine, angles: Mapping[str, F64], point: F64, tool: F64) -> dict[str, F64]:
    """Positions of all axes when the tool follows a point of the workpiece, each (n,), mm or rad.

    Parameters
    ----------
    angles
        Rotary axis → (n,), rad; those that are not named stand at 0, as other linear axes do.
    point
        Shape (n, 3), workpiece's frame, mm.
    tool
        Shape (n, 3), mm.

    Raises
    ------
    InputError
        When the machine lacks one of X, Y, Z.
    """
    for letter in "XYZ":
        if letter not in machine.structure.linear:
            raise InputError(
                f"the machine has no axis {letter} that could follow the point",
                field="structure",
                found=str(machine.structure),
            )
    n = len(point)
    positions = {a: np.asarray(angles.get(a, np.zeros(n))) for a in machine.structure.axes}
    positions |= {a: np.zeros(n) for a in "XYZ" if a in positions}
    chain = Chain(machine, Conditions(positions, tool=tool))
    missing = chain.to_machine_axes(point - chain.point)
    moves = chain.as_moves(missing)
    return {**positions, **{a: np.asarray(moves[:, k]) for k, a in enumerate("XYZ")}}


def around(chain: Chain, axis: str) -> tuple[F64, F64, F64]:
    """Radial (outward), tangential and axial unit vectors at the tool, (n, 3), machine axes.

    Tangential is where the tool goes relative to the workpiece when the axis's number grows. On the
    axis's own line radial and tangential are 0.
    """
    speed, along = chain.screw(axis)
    outward = -crossed(along, speed)
    size = np.linalg.norm(outward, axis=1)[:, None]
    far = size > ON_THE_LINE
    size = np.where(far, size, 1.0)
    radial, tangential = np.where(far, outward, 0.0) / size, np.where(far, speed, 0.0) / size
    return (
        chain.to_machine_axes(radial),
        chain.to_machine_axes(tangential),
        chain.to_machine_axes(np.broadcast_to(along, radial.shape)),
    )


def nest_directions(chain: Chain, *, on_table: bool) -> F64:
    """The nest's own X, Y, Z as they stand, shape (n, 3, 3), machine axes; [:, k] the k-th.

    They are the machine's with all rotary axes at 0, and turn with what carries the nest.
    """
    n = chain.conditions.n
    own = np.broadcast_to(np.eye(3), (n, 3, 3)) if on_table else chain.orientation
    return np.stack([chain.to_machine_axes(own[:, :, k]) for k in range(3)], axis=1)
