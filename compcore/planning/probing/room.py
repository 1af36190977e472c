"""Whether a stylus has room to touch a sphere on the table, however rotary axes stand.

Everything is looked at from the table: the sphere and the table's disc stay there, tip and stylus
turn about them. The tool is a rod of its radius from the tip along the stylus, as long as the tool
and a piece of the spindle.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.machine.machine import Machine
from abbe.compcore.planning.probing.touches import MOST_LEAN, unit

F64 = NDArray[np.float64]

_SAFE_LEAN = math.radians(60.0)
"""By which stylus and post may lean where nobody says how large the table is."""
_ABOUT = 30.0
"""mm that the tip goes about a sphere's middle."""
_OVER = 50.0
"""mm from it to the ways between spheres, as measured without another word."""
_SPINDLE = 200.0
"""mm of the spindle beyond the tool."""
_STEP = 10.0
"""mm between places along the rod that are looked at."""


def out_of(offset: Sequence[float]) -> F64:
    """From the tip to the spindle with rotary axes at 0, unit vector: against a tool's offset."""
    far = float(np.linalg.norm(offset))
    return unit([0.0, 0.0, 1.0]) if far == 0.0 else -np.asarray(offset) / far


def post_of(machine: Machine, offset: Sequence[float]) -> F64:
    """The direction to which a sphere looks out of its post, unit vector, rotary axes at 0.

    It stands upright on the rotary table, else against the tool.
    """
    carriers = [a for a in machine.structure.rotary if a in machine.structure.workpiece_side]
    return unit(machine.axes[carriers[0]].direction) if carriers else out_of(offset)


def hindered(
    machine: Machine,
    targets: Mapping[str, F64],
    offset: Sequence[float],
    back: tuple[str, float],
    table: float,
    radius: float,
) -> tuple[NDArray[np.bool_], str]:
    """At which poses a stylus cannot touch a sphere on the table, (n,), and why the first of them.

    Parameters
    ----------
    targets
        Axis → where it stands with the tip in the sphere's middle, (n,), mm or rad.
    offset
        Of the tip, mm.
    back
        The axis along which the tip is drawn back, and to where, mm.
    table
        Radius of the rotary table with all that is on it lower than the sphere, mm; 0: not known.
    radius
        Of tool, holder and spindle, mm.
    """
    n = len(next(iter(targets.values())))
    tools = np.tile(np.asarray(offset, dtype=np.float64), (n, 1))
    post, out = post_of(machine, offset), out_of(offset)
    chain = Chain(machine, Conditions(dict(targets), tool=tools))
    shafts = chain.orientation @ out
    lean = np.arccos(np.clip(shafts @ post, -1.0, 1.0))
    carriers = [a for a in machine.structure.rotary if a in machine.structure.workpiece_side]
    disc = table > 0.0 and bool(carriers)
    found = lean > (MOST_LEAN if disc else _SAFE_LEAN) + 1e-9
    why = ""
    if found.any():
        turned = math.degrees(float(lean[found].max()))
        most = math.degrees(MOST_LEAN if disc else _SAFE_LEAN)
        why = f"stylus and post would lean by {turned:.0f}°, more than {most:.0f}°" + (
            "" if disc or not carriers else " (how large is the table? table_radius)"
        )
    if disc:
        own = machine.axes[carriers[0]]
        hit = np.zeros(n, dtype=np.bool_)
        length = float(np.linalg.norm(offset)) + _SPINDLE
        # the tip in the sphere, and drawn back over where it was, is and will be
        for shift in (None, 0, 1, -1):
            at = dict(targets)
            if shift is not None:
                at |= {a: np.roll(at[a], shift) for a in "XYZ" if a in at}
                at[back[0]] = np.full(n, back[1])
            seen = Chain(machine, Conditions(at, tool=tools))
            along = seen.orientation @ out
            more = _ABOUT if shift is None else 0.0
            start = radius + more if shift is None else 0.0
            for s in np.arange(start, length, _STEP):
                places = seen.point + s * along
                hit |= _from_disc(places, own.location, own.direction, table) < radius + more
        why = why or ("tool or spindle would touch the table" if hit.any() else "")
        found |= hit
    return found, why


def room_about(
    machine: Machine, targets: Mapping[str, F64], offset: Sequence[float]
) -> NDArray[np.bool_]:
    """At which poses the travels leave room to go about a sphere, and over it, (n,).

    Parameters
    ----------
    targets, offset
        As `hindered` takes them.
    """
    n = len(next(iter(targets.values())))
    tools = np.tile(np.asarray(offset, dtype=np.float64), (n, 1))
    chain = Chain(machine, Conditions(dict(targets), tool=tools))
    over = _OVER * chain.to_machine_axes(np.tile(post_of(machine, offset), (n, 1)))
    room = np.ones(n, dtype=np.bool_)
    for k, axis in enumerate("XYZ"):
        low, high = machine.axes[axis].travel
        at = targets[axis]
        for place, more in ((at, _ABOUT), (at + over[:, k], 0.0)):
            room &= (place - more >= low) & (place + more <= high)
    return room


def _from_disc(places: F64, middle: Sequence[float], along: Sequence[float], radius: float) -> F64:
    """How far places (n, 3) are from a disc, and from all below it, mm, (n,)."""
    normal = unit(along)
    away = places - np.asarray(middle)
    height = away @ normal
    out = np.linalg.norm(away - np.outer(height, normal), axis=1)
    return np.asarray(np.hypot(np.maximum(height, 0.0), np.maximum(out - radius, 0.0)))
