"""Tools of an arm that seem to be counted from its flange: they lie at its foot, not at its end."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.machine.machine import Machine, nominal_direction
from abbe.compcore.sentences import Sentence, said

F64 = NDArray[np.float64]

_LINEAR = 3
"""So many linear axes reach every place by themselves."""
_APART = 1.0
"""mm by which two lines have to lie apart to be told from each other."""


def joints(machine: Machine) -> tuple[str, ...]:
    """The joints of an arm from its foot to its tool; empty for a machine that is none."""
    structure = machine.structure
    rotary = tuple(a for a in structure.rotary if a not in structure.workpiece_side)
    return rotary if len(rotary) > 1 and len(structure.linear) < _LINEAR else ()


def of_tools(campaign: Campaign, machine: Machine) -> Iterator[Sentence]:
    """Tools whose point lies nearer to the first joints than to the last, all joints at zero.

    An arm's tool offset counts from the machine's origin, as all of this machine's places do. Who
    writes it as robots' controls do, from the flange, has a point that the arm cannot be at.
    """
    chain = joints(machine)
    tool = campaign.conditions.tool
    points = tool[campaign.kind != Kind.BASE_DISTANCE]
    if not chain or not len(points):
        return
    for point in np.unique(points, axis=0):
        for first, last in zip(chain, chain[::-1], strict=True):
            if first == last or chain.index(first) > chain.index(last):
                break
            near, far = (off_line(machine, axis, point) for axis in (first, last))
            if far > near + _APART:
                yield said(
                    "the tool {tool} (mm) lies {near} mm from the line of {first} and {far} mm "
                    "from that of {last}, all joints at zero: the arm has hardly its tool at its "
                    "foot. A tool's offset counts from the machine's origin, not from the flange: "
                    "add where the flange is with all joints at zero",
                    tool=", ".join(f"{v:g}" for v in point),
                    near=f"{near:.0f}",
                    far=f"{far:.0f}",
                    first=first,
                    last=last,
                )
                return


def off_line(machine: Machine, axis: str, point: F64) -> float:
    """How far a point lies from a joint's line, all joints at zero, mm."""
    along = np.asarray(nominal_direction(axis))
    away = point - np.asarray(machine.axes[axis].location)
    return float(np.linalg.norm(away - along * (along @ away)))
