"""Curves of tables over single axes: moves of X, Y and Z, and rotary axes' own positioning."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.error_motion import ErrorMotion
from abbe.compcore.machine.machine import own_component
from abbe.compcore.tables.capability import Capability, Holds
from abbe.compcore.tables.field import ErrorField
from abbe.compcore.tables.projection.curve import Curve
from abbe.compcore.tables.projection.marginal import Marginal, marginal
from abbe.compcore.tables.projection.motions import LETTERS
from abbe.compcore.tables.table import move
from abbe.compcore.tables.volume import Volume

F64 = NDArray[np.float64]
Fine = Callable[[str], F64]
"""Axis → fine positions over its travel, mm or rad."""

_POINTS = 987


def longest_lever(field: ErrorField, volume: Volume, axis: str = "") -> float:
    """The longest lever of a turn of an axis in the volume, mm: tool and the others' ranges."""
    linear = field.model.machine.structure.linear
    tool = float(np.linalg.norm(field.state.tool))
    return tool + sum(2.0 * volume.half(a) for a in linear if a != axis)


def turning_curves(
    field: ErrorField, volume: Volume, capability: Capability, fine: Fine
) -> list[Curve]:
    """Positioning error motions of rotary axes (R-POS), over their own angle, rad."""
    machine, reversing = field.model.machine, field.reversing()
    found: list[Curve] = []
    own = [h for h in capability.holds if h.form == "axis"]
    for axis in machine.structure.rotary:
        holds = next((h for h in own if h.serves(axis, axis)), None)
        if holds is None:
            continue
        error_motion = ErrorMotion(axis, LETTERS["XYZABC".index(own_component(axis))])

        def turning(
            where: Mapping[str, F64],
            facing: Mapping[str, F64],
            error_motion: ErrorMotion = error_motion,
        ) -> F64:
            n = len(where[error_motion.place])
            value = field.motions(where, facing).get(error_motion, np.zeros(n))
            return np.broadcast_to(value, (n,))[:, None]

        part = marginal(turning, machine, volume, axis, fine(axis), reverses=axis in reversing)
        reach = longest_lever(field, volume, axis)
        found.append(Curve(holds, error_motion, axis, part.positions, part.mean[:, :, 0], reach))
    return found


def marginals_beside(
    turns: Sequence[Curve], field: ErrorField, volume: Volume, capability: Capability, fine: Fine
) -> tuple[F64, dict[str, Marginal]]:
    """Mean over the volume, (3,), and marginals, mm, of what rotary axes' own tables leave."""
    machine, reversing = field.model.machine, field.reversing()
    axes = machine.structure.axes
    turned = [c.table() for c in turns]

    def left(where: Mapping[str, F64], facing: Mapping[str, F64]) -> F64:
        error = field(where, facing)
        return error - field.removed(turned, where, facing) if turned else error

    mean = left(volume.spread(axes, _POINTS), {}).mean(axis=0)
    looked_up = dict.fromkeys(
        a
        for h in capability.holds
        if h.form in ("axis", "cross", "product")
        for a in (h.inputs or axes)
        if a in axes
    )
    return mean, {
        axis: marginal(left, machine, volume, axis, fine(axis), reverses=axis in reversing)
        for axis in looked_up
    }


def axis_curves(
    holds: Holds, marginals: Mapping[str, Marginal], volume: Volume
) -> tuple[list[Curve], list[Curve]]:
    """Curves of tables of the form ``axis`` (L-POS) or ``cross`` (L-STR), centred in the volume.

    Parameters
    ----------
    holds
        The family.
    marginals
        Axis → how the error depends on it.
    volume
        The working volume.

    Returns
    -------
    Those that are to be made, and those for which an axis has no more tables of this family.
    """
    found, left_out = [], []
    for k, output in enumerate("XYZ"):
        mine = []
        for axis, part in marginals.items():
            same = axis == output
            if same == (holds.form == "axis") and holds.serves(axis, output):
                values = part.mean[:, :, k]
                inside = volume.inside(axis, part.positions)
                centred = values - values[:, inside].mean()
                mine.append(Curve(holds, move(output), axis, part.positions, centred))
        if holds.per_output is not None and len(mine) > holds.per_output:
            mine.sort(key=lambda c: -float(c.values.std()))
            left_out += mine[holds.per_output :]
            mine = mine[: holds.per_output]
        found += mine
    return found, left_out
