"""Curves of tables over single axes: moves of X, Y and Z beside turns of rotary axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.tables.capability import Capability, Holds
from abbe.compcore.tables.field import ErrorField
from abbe.compcore.tables.projection.curves.curve import Curve
from abbe.compcore.tables.projection.curves.marginal import Marginal, marginal
from abbe.compcore.tables.projection.orientation import Fine
from abbe.compcore.tables.table import move
from abbe.compcore.tables.volume import Volume

F64 = NDArray[np.float64]
_POINTS = 987


def marginals_beside(
    turns: Sequence[Curve], field: ErrorField, volume: Volume, capability: Capability, fine: Fine
) -> tuple[F64, dict[str, Marginal]]:
    """Mean over the volume, (3,), and marginals, mm, of what rotary axes' tables leave."""
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
    beside = tuple(
        (c.output, c.axis, c.lever, c.positions.tobytes(), c.values.tobytes()) for c in turns
    )
    found: dict[str, Marginal] = {}
    for axis in looked_up:
        positions = fine(axis)
        find = partial(marginal, left, machine, volume, axis, positions, reverses=axis in reversing)
        key = ("beside", beside, axis, positions.tobytes(), *_ranges(volume))
        found[axis] = field.found(key, find)
    return mean, found


def _ranges(volume: Volume) -> tuple[tuple[str, tuple[float, float]], ...]:
    return tuple(sorted(volume.ranges.items()))


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
