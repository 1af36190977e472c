"""Artefacts as a model would have measured them: lengths and plates before and after."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.artefacts.measured_length import MeasuredLength
from abbe.compcore.artefacts.plate import MeasuredPlate
from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.model.model import Model

F64 = NDArray[np.float64]


def corrected_lengths(lengths: Sequence[MeasuredLength], model: Model) -> F64:
    """Errors of indication with a model's correction, shape (n,), mm.

    A corrected reading is the reading plus the predicted error of both ends (docs/conventions.md).

    Raises
    ------
    InputError
        For lengths without their probed points, and for a signal that the model needs.
    """
    ends = []
    for length in lengths:
        if length.ends is None:
            raise InputError(
                "a model corrects places: the two probed points are needed",
                line=length.line or None,
                field="x1",
                expected="columns x1, y1, z1, x2, y2, z2 (machine coordinates, mm)",
            )
        ends.append(length.ends)
    point = np.stack(ends)
    tool = np.repeat([length.tool for length in lengths], 2, axis=0)
    names = dict.fromkeys(name for length in lengths for name in length.signals)
    signals = {
        name: np.repeat([length.signals.get(name, np.nan) for length in lengths], 2)
        for name in names
    }
    moved = correction(model, point.reshape(-1, 3), tool, signals).reshape(-1, 2, 3)
    before = np.linalg.norm(point[:, 1] - point[:, 0], axis=1)
    after = np.linalg.norm((point + moved)[:, 1] - (point + moved)[:, 0], axis=1)
    error = np.array([length.error for length in lengths])
    return np.asarray(error + (after - before))


def corrected_plate(plate: MeasuredPlate, model: Model) -> F64:
    """A plate's points with a model's correction, shape (n, 3), mm.

    Raises
    ------
    InputError
        For a signal that the model needs and the file does not have.
    """
    return plate.indicated + correction(model, plate.indicated, plate.tool, plate.signals)


def correction(model: Model, point: F64, tool: F64, signals: Mapping[str, F64]) -> F64:
    """The predicted error at indicated points, shape (n, 3), mm.

    Parameters
    ----------
    point
        Shape (n, 3): the tip's centre, machine coordinates with rotary axes at 0, mm.
    tool
        Shape (n, 3), mm.
    signals
        Recorded signals; also where other axes than X, Y, Z stood (mm, rotary: degrees).

    Raises
    ------
    InputError
        For a signal that the model needs and nobody recorded.
    """
    for name in model.signals_needed():
        if name not in signals or not np.isfinite(signals[name]).all():
            raise InputError(
                "the model needs a signal that the file does not have",
                field=name,
                found=", ".join(signals) or "none",
                expected=f"a column {name!r}",
            )
    positions = positions_of(model.machine, point, tool, signals)
    others = {name: v for name, v in signals.items() if name not in positions}
    return model.predict(Conditions(positions, tool=tool, signals=others)).translation


def positions_of(
    machine: Machine, point: F64, tool: F64, recorded: Mapping[str, F64]
) -> dict[str, F64]:
    """Positions of the axes when the tool's tip is at points, each (n,), mm (rotary: rad).

    X, Y, Z stand at the point less the tool; other axes where recorded, else at 0.
    """
    positions = {}
    for axis in machine.structure.axes:
        if axis in recorded:
            value = recorded[axis]
            positions[axis] = np.deg2rad(value) if is_rotary(axis) else value
        elif axis in "XYZ":
            positions[axis] = (point - tool)[:, "XYZ".index(axis)]
        else:
            positions[axis] = np.zeros(len(point))
    return positions
