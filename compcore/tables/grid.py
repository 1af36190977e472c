"""Spatial error grids (ISO/TR 16907, 9.3): three translations, three rotations at each point.

Straight from the model: a grid holds whatever the model says, also what no set of axis tables could
(ISO/TR 16907, 9.3). Pairs of rotary axes have grids of their own, whose values are relative to both
axes at zero, so that the grid of the linear axes and theirs add up.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.compensator.folding.slow_state import SlowState
from abbe.compcore.errors import InputError
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.model.model import Model
from abbe.compcore.tables.table import Table, move

F64 = NDArray[np.float64]

COMPONENTS = "XYZABC"
"""Order of a grid's columns: moves of X, Y, Z, then turns about X, Y, Z."""


def spatial_grid(
    model: Model,
    state: SlowState,
    nodes: Mapping[str, F64],
    others: Mapping[str, float] | None = None,
    directions: Mapping[str, float] | None = None,
) -> tuple[Table, ...]:
    """The spatial error grid of a model: ΔX ΔY ΔZ (mm), ΔA ΔB ΔC (rad) at its points.

    Parameters
    ----------
    model, state
        The model; temperatures, tool and the rest.
    nodes
        One to three axes → positions, increasing, mm (rotary: rad), in the order in which the grid
        is to be written.
    others
        Axis → position of axes that are not in the grid, mm or rad; the point of their travel that
        is nearest to zero where not stated.
    directions
        Axis → 1 or −1 where the grid is for one direction; not stated: the mean of both.

    Returns
    -------
    Six tables of errors on the same nodes: X, Y, Z moves (mm), A, B, C turns (rad) of the
    functional orientation.

    Raises
    ------
    InputError
        When an axis is missing on the machine, or linear and rotary axes are mixed.
    """
    machine = model.machine
    axes = tuple(nodes)
    for name in axes:
        machine.axis(name, "grid")
    if len({is_rotary(a) for a in axes}) != 1:
        raise InputError(
            "a grid is over linear axes or over rotary ones", field="grid", found=",".join(axes)
        )
    rest = {**_nearest_to_zero(model), **(others or {})}
    errors = _at(model, state, nodes, rest, directions or {})
    if is_rotary(axes[0]):
        zero = {a: np.zeros(1) for a in axes}
        errors = errors - _at(model, state, zero, rest, directions or {})
    shape = tuple(len(n) for n in nodes.values())
    held = tuple(np.asarray(n, dtype=np.float64) for n in nodes.values())
    return tuple(
        Table(move(c), axes, held, np.ascontiguousarray(errors[:, k].reshape(shape)))
        for k, c in enumerate(COMPONENTS)
    )


def _nearest_to_zero(model: Model) -> dict[str, float]:
    return {name: float(np.clip(0.0, *axis.travel)) for name, axis in model.machine.axes.items()}


def _at(
    model: Model,
    state: SlowState,
    nodes: Mapping[str, F64],
    rest: Mapping[str, float],
    directions: Mapping[str, float],
) -> F64:
    """Moves and turns at every point of the grid, (n, 6)."""
    mesh = np.meshgrid(*nodes.values(), indexing="ij")
    n = mesh[0].size
    positions = {name: np.full(n, value) for name, value in rest.items()}
    positions.update({a: m.reshape(-1) for a, m in zip(nodes, mesh, strict=True)})
    facing = {a: np.full(n, float(d)) for a, d in directions.items()}
    conditions = state.conditions(positions, facing)
    found = model.predict(conditions)
    along = Chain(model.machine, conditions).as_moves(found.translation)
    return np.concatenate([along, found.rotation], axis=1)
