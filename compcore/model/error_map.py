"""The error map of a plane: errors of length between its points, and the worst pair (Zhang)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.model.model import Model

F64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ErrorMap:
    """Errors at the functional point on a grid in a plane, and the pair of worst length error.

    Attributes
    ----------
    across
        The two axes that span the plane.
    grid
        The grid's positions of each of the two, mm.
    error
        Error at each point, shape (len(grid 1), len(grid 2), 3), mm.
    worst
        Positions of the two points whose distance errs most, axis → (first, second), mm.
    worst_error
        That error of length, actual − indicated, mm.
    """

    across: tuple[str, str]
    grid: tuple[F64, F64]
    error: F64
    worst: Mapping[str, tuple[float, float]]
    worst_error: float


def error_map(
    model: Model,
    across: tuple[str, str],
    at: Mapping[str, float],
    *,
    signals: Mapping[str, float] | None = None,
    tool: tuple[float, float, float] = (0.0, 0.0, 0.0),
    points: int = 15,
) -> ErrorMap:
    """Errors of a fitted model on a grid in the plane of two axes (Zhang et al., 1985).

    Parameters
    ----------
    across
        Two linear axes.
    at
        Where the other axes stand, mm (rotary: rad).
    signals
        Name → value; temperatures that are not given are at the reference temperature, other
        signals 0.
    tool
        Tool or probe offset, mm, machine axes.
    points
        Grid points along each axis.

    Raises
    ------
    InputError
        When the machine lacks one of the axes.
    """
    machine = model.machine
    for name in across:
        if machine.axis(name, "across").rotary:
            raise InputError("a plane is spanned by linear axes", field="across", found=name)
    first, second = (np.linspace(*machine.axes[a].travel, points) for a in across)
    p, q = (g.ravel() for g in np.meshgrid(first, second, indexing="ij"))
    n = len(p)
    positions = {a: np.full(n, at.get(a, machine.axes[a].middle)) for a in machine.structure.axes}
    positions |= {across[0]: p, across[1]: q}
    values = {
        s.name: machine.reference_temperature if s.temperature else 0.0
        for s in machine.signals.values()
    } | dict(signals or {})
    conditions = Conditions(
        positions,
        tool=np.tile(np.asarray(tool, dtype=np.float64), (n, 1)),
        signals={k: np.full(n, v) for k, v in values.items()},
    )
    error = model.predict(conditions).translation
    chain = Chain(machine, conditions)
    i, j, length = worst_pair(chain.to_machine_axes(chain.point), error)
    return ErrorMap(
        across,
        (first, second),
        error.reshape(points, points, 3),
        {across[0]: (float(p[i]), float(p[j])), across[1]: (float(q[i]), float(q[j]))},
        length,
    )


def worst_pair(point: F64, error: F64) -> tuple[int, int, float]:
    """The two of n points, (n, 3) mm, with the largest error of length, and that error, mm."""
    apart = point[:, None, :] - point[None, :, :]
    distance = np.linalg.norm(apart, axis=2)
    between = np.einsum("ijk,ijk->ij", apart, error[:, None, :] - error[None, :, :])
    change = np.divide(between, distance, out=np.zeros_like(between), where=distance > 0.0)
    i, j = np.unravel_index(int(np.argmax(np.abs(change))), change.shape)
    return int(i), int(j), float(change[i, j])
