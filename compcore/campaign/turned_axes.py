"""Rotary axes whose sense seems to be turned over: an artefact would stand still with the other."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.sentences import Sentence, said
from abbe.compcore.units import in_digits

F64 = NDArray[np.float64]

_TURNS = math.radians(30.0)
"""An axis that turns by less in a set-up shows nothing there."""
_FAR, _STILL = 20.0, 2.0
"""mm by which an artefact's points lie apart with one sense, and with the other."""


def of_turned_axes(campaign: Campaign, machine: Machine) -> Iterator[Sentence]:
    """Axes with whose other sense every set-up's artefact would stay where it was clamped.

    A sphere on a table is measured wherever the table takes it: on the workpiece it is one place.
    By ISO 841 a positive C' turns the table backwards, as the tool then goes on around the part;
    who notes the table's own sense has spheres that wander over it, and errors that are none.
    """
    conditions = campaign.conditions
    if conditions.setup is None:
        return
    for axis, position in conditions.positions.items():
        if not is_rotary(axis):
            continue
        other = replace(conditions, positions={**conditions.positions, axis: -position})
        turning = [
            name
            for name, setup in campaign.setups.items()
            if "frame" in setup.free and _turn(position, conditions.setup == name) > _TURNS
        ]
        spread = [
            tuple(_spread(machine, c.rows(conditions.setup == name)) for c in (conditions, other))
            for name in turning
        ]
        if spread and all(now > _FAR and turned < _STILL for now, turned in spread):
            yield said(
                "with {axis} turned the other way the points of set-up {name} would be one place "
                "of the workpiece; as it is they lie {far} mm apart. Has the column {axis} the "
                "table's own sense? By ISO 841 a positive turn of a table ({axis}' in the "
                "structure) turns it backwards: change the column's sign",
                axis=axis,
                name=turning[0],
                far=in_digits(spread[0][0]),
            )


def _turn(position: F64, rows: NDArray[np.bool_]) -> float:
    """How far an axis turns in some rows, rad."""
    return float(np.ptp(position[rows])) if rows.any() else 0.0


def _spread(machine: Machine, conditions: Conditions) -> float:
    """How far functional points lie apart on the workpiece, mm."""
    return float(np.linalg.norm(np.ptp(Chain(machine, conditions).point, axis=0)))
