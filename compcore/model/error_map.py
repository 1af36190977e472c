"""The error map of a plane: errors of length between its points, and the worst pair (Zhang)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError, require_type
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.machine.machine import Axis, Machine
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


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane of two linear axes, and what holds all over it.

    Attributes
    ----------
    across
        The two axes that span it.
    ranges
        Least and greatest position of each of the two, mm.
    points
        Grid points along each.
    at
        Where the other axes stand, mm (rotary: rad).
    signals, directions
        Name → value; axis → direction of approach.
    tool
        Tool or probe offset, mm, machine axes.
    time, spindle_angle
        s; rad, None where it is not known.
    """

    across: tuple[str, str]
    ranges: tuple[tuple[float, float], tuple[float, float]]
    points: tuple[int, int]
    at: Mapping[str, float]
    signals: Mapping[str, float]
    directions: Mapping[str, float]
    tool: tuple[float, float, float] = (0.0, 0.0, 0.0)
    time: float = 0.0
    spindle_angle: float | None = None

    @property
    def grid(self) -> tuple[F64, F64]:
        """Positions along each of the two axes, mm."""
        first, second = (
            np.linspace(*ends, count) for ends, count in zip(self.ranges, self.points, strict=True)
        )
        return first, second

    def conditions(self) -> Conditions:
        """A row for each point of the grid, the second axis the faster."""
        p, q = (g.ravel() for g in np.meshgrid(*self.grid, indexing="ij"))
        n = len(p)
        positions = {a: np.full(n, v) for a, v in self.at.items()}
        positions |= {self.across[0]: p, self.across[1]: q}
        return Conditions(
            positions,
            directions={a: np.full(n, v) for a, v in self.directions.items()},
            tool=np.tile(np.asarray(self.tool, dtype=np.float64), (n, 1)),
            time=np.full(n, self.time),
            signals={k: np.full(n, v) for k, v in self.signals.items()},
            spindle_angle=None if self.spindle_angle is None else np.full(n, self.spindle_angle),
        )


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
        Where the other axes stand, mm (rotary: rad); the middle of their travel where not given.
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
    require_type(model, Model, "model")
    machine = model.machine
    first, second = (spanning_axis(machine, name) for name in across)
    plane = Plane(
        across,
        (first.travel, second.travel),
        (points, points),
        {a: at.get(a, machine.axes[a].middle) for a in machine.structure.axes if a not in across},
        {
            s.name: machine.reference_temperature if s.temperature else 0.0
            for s in machine.signals.values()
        }
        | dict(signals or {}),
        {},
        tool,
    )
    return map_plane(model, plane)


def spanning_axis(machine: Machine, name: str) -> Axis:
    """A linear axis, as one that can span a plane.

    Raises
    ------
    InputError
        When the machine lacks it, or it turns.
    """
    axis = machine.axis(name, "plane")
    if axis.rotary:
        raise InputError("a plane is spanned by linear axes", field="plane", found=name)
    return axis


def map_plane(model: Model, plane: Plane) -> ErrorMap:
    """Errors of a fitted model on the grid of a plane."""
    conditions = plane.conditions()
    error = model.predict(conditions).translation
    chain = Chain(model.machine, conditions)
    i, j, length = worst_pair(chain.to_machine_axes(chain.point), error)
    p, q = (conditions.position(a) for a in plane.across)
    return ErrorMap(
        plane.across,
        plane.grid,
        error.reshape(*plane.points, 3),
        {
            plane.across[0]: (float(p[i]), float(p[j])),
            plane.across[1]: (float(q[i]), float(q[j])),
        },
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
