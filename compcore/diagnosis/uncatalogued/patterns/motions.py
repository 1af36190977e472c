"""Error motions on which patterns are tried, and what their levers bring with them."""

from __future__ import annotations

from collections.abc import Sequence

from abbe.compcore.effects.base import ABOUT, FUNCTIONAL_POINT, ErrorMotion
from abbe.compcore.machine.machine import Machine, own_component
from abbe.compcore.machine.structure import is_rotary

_ALONG = 0.99
"""Cosine from which on a joint turns about a direction, and leaves it where it is."""


def error_motions(machine: Machine) -> list[ErrorMotion]:
    """Error motions on which patterns are tried: the point itself, and every axis's tilts."""
    points = [ErrorMotion(FUNCTIONAL_POINT, c) for c in ("X", "Y", "Z")]
    tilts = [ErrorMotion(a, ABOUT[c]) for a in machine.structure.axes for c in ("X", "Y", "Z")]
    return points + tilts


def turned_by_joints(
    machine: Machine, varied: Sequence[str]
) -> tuple[frozenset[str], frozenset[ErrorMotion]]:
    """An arm's joints that moved, and the point's error motions whose directions they turn.

    What errs in a joint goes round with the joints that carry it: as a function of their positions
    an error along a direction of the room is of the poses that were measured, and of no others.
    """
    if not machine.structure.jointed:
        return frozenset(), frozenset()
    joints = frozenset(a for a in machine.structure.tool_side if a in varied and is_rotary(a))
    turned = {
        ErrorMotion(FUNCTIONAL_POINT, c)
        for c in ("X", "Y", "Z")
        if any(abs(machine.axis(a).direction["XYZ".index(c)]) < _ALONG for a in joints)
    }
    return joints, frozenset(turned)


def lever_axes(machine: Machine, error_motion: ErrorMotion) -> tuple[str, ...]:
    """Axes whose position is in the lever of a tilt, so that what is seen depends on them too."""
    if not error_motion.rotation:
        return ()
    order = machine.structure.axes
    at = order.index(error_motion.place)
    on_workpiece = error_motion.place in machine.structure.workpiece_side
    behind = order[at if on_workpiece else at + 1 :]
    along = {"A": "X", "B": "Y", "C": "Z"}[error_motion.component]
    return tuple(a for a in behind if not is_rotary(a) and own_component(a) != along)
