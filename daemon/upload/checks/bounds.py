"""Bounds of tables: how large, how steep, how far from others they may be.

A correction is a sum over groups of tables that look up the same axes. Each group is linear
between its own points and, through levers, in the other axes' positions; so its largest value
stands at a point of its own with the other axes at the ends of their travels, and the sum of the
groups' largest values is a bound for every position of the machine. What a table turns a rotary
axis by counts as what that moves the tip by, as far out as it can be.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.compensator.folding.slow_state import SlowState
from abbe.compcore.errors import AbbeError
from abbe.compcore.machine.error_motion import ErrorMotion
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.model.model import Model
from abbe.compcore.tables.field import ErrorField
from abbe.compcore.tables.table import Sign, Table, superposed
from abbe.compcore.units import in_digits
from abbe.drivers.controllers.axes import moved_axis, output_of

F64 = NDArray[np.float64]

_TURN = np.pi / 6.0
"""rad between two places of a rotary axis: as it turns, a lever goes by a sine."""
_BETWEEN = 1.0 / np.cos(0.5 * _TURN)
"""How much a sine may be larger between two such places than at both."""


class OutOfBoundsError(AbbeError):
    """Tables are larger, steeper or further from the present ones than is allowed."""


@dataclass(frozen=True)
class Limits:
    """The limits of tables; µm, µrad, µm/mm."""

    entry_um: float
    entry_urad: float | None
    slope: float
    correction_um: float
    change_um: float


@dataclass(frozen=True)
class Extent:
    """The extent of tables, bounds of it; µm, µrad, µm/mm."""

    entry_um: float
    entry_urad: float
    slope: float
    correction_um: float


def extent(tables: Sequence[Table], model: Model, tool: tuple[float, float, float]) -> Extent:
    """How large tables are at most."""
    lengths = [t for t in tables if not t.output.rotation]
    angles = [t for t in tables if t.output.rotation]
    return Extent(
        max((_largest(t, model) * 1e3 for t in lengths), default=0.0),
        max((_largest(t, model) * 1e6 for t in angles), default=0.0),
        max((_slope(t, model) * 1e3 for t in lengths), default=0.0),
        largest_correction(tables, model, tool) * 1e3,
    )


def largest_change(
    new: Sequence[Table], old: Sequence[Table], model: Model, tool: tuple[float, float, float]
) -> float:
    """A bound for the difference between two sets' corrections anywhere, mm."""
    less = [t.as_sign(Sign.ERROR).scaled(-1.0) for t in old]
    return largest_correction(superposed(new, less), model, tool)


def largest_correction(
    tables: Sequence[Table], model: Model, tool: tuple[float, float, float]
) -> float:
    """A bound for the length of the correction anywhere in the travels, mm."""
    field = ErrorField(model, SlowState(tool=tool))
    groups: dict[tuple[str, ...], list[Table]] = {}
    for table in tables:
        groups.setdefault(tuple(sorted(table.inputs)), []).append(table)
    bound = np.zeros(3)
    for axes, group in groups.items():
        where = _places(axes, group, model)
        most = np.zeros(3)
        for way in (1.0, -1.0):
            directions = {a: np.full(len(next(iter(where.values()))), way) for a in axes}
            most = np.maximum(most, _moved(field, group, where, directions).max(axis=0))
        rotary = sum(map(is_rotary, model.machine.axes))
        bound += most * (_BETWEEN**rotary if _levers(group, model) else 1.0)
    return float(np.linalg.norm(bound))


def check(extent: Extent, change_um: float | None, limits: Limits) -> None:
    """Refuse what is out of bounds.

    Parameters
    ----------
    extent
        Of the new tables.
    change_um
        From the present ones; None: not known yet.

    Raises
    ------
    OutOfBoundsError
        Names the key of the configuration, what was found and what is allowed.
    """
    if extent.entry_urad > 0.0 and limits.entry_urad is None:
        raise OutOfBoundsError(
            f"the tables hold angles up to {extent.entry_urad:.1f} µrad, and upload.max_entry_urad "
            "does not say how large they may be: look at the tables (abbe table --report), and "
            "state the key in [upload] where the figure is right; 100 µrad are 50 µm at 500 mm "
            "from the axis"
        )
    rows: tuple[tuple[str, str, float, float, str], ...] = (
        ("an entry", "max_entry_um", extent.entry_um, limits.entry_um, "µm"),
        ("an entry", "max_entry_urad", extent.entry_urad, limits.entry_urad or 0.0, "µrad"),
        ("the slope", "max_slope_um_per_mm", extent.slope, limits.slope, "µm/mm"),
        ("the correction", "max_correction_um", extent.correction_um, limits.correction_um, "µm"),
    )
    for what, key, found, allowed, unit in rows:
        if not found <= allowed:
            raise OutOfBoundsError(
                f"{what} of the new tables reaches {in_digits(found, 4)} {unit}; "
                f"upload.{key} allows {allowed:g} {unit}{_meaning(key, found)}"
            )
    if change_um is not None and not change_um <= limits.change_um:
        raise OutOfBoundsError(
            f"the correction changes by up to {in_digits(change_um, 4)} µm against what is "
            "active now; "
            f"upload.max_change_um allows {limits.change_um:g} µm (--max-change for this once)"
        )


def _meaning(key: str, found: float) -> str:
    """What a figure that is out of bounds is likely to be, and what to do."""
    if key != "max_slope_um_per_mm":
        return ""
    return (
        f": {in_digits(0.1 * found)} % of the way. So much is a wrong unit or ratio, or two points "
        "too near each other, more often than an error of the axis: put the ratio right at the "
        "control; raise the bound where the figure is right"
    )


def _moved(
    field: ErrorField,
    group: Sequence[Table],
    where: Mapping[str, F64],
    directions: Mapping[str, F64],
) -> F64:
    """How far tables move the tip along X, Y and Z at most, (n, 3), mm."""
    turns = [(t, _turned(t, field.model)) for t in group]
    moved = np.abs(field.removed([t for t, axis in turns if axis is None], where, directions))
    own: dict[ErrorMotion, F64] = {}
    conditions = field.conditions(where, directions)
    for table, axis in turns:
        if axis is not None:
            motion = output_of(axis)
            own[motion] = own.get(motion, 0.0) + table.value(conditions)
    return moved + np.abs(field.carried(own, conditions)) if own else moved


def _turned(table: Table, model: Model) -> str | None:
    """The rotary axis that a table turns, if it turns one."""
    axis = moved_axis(table)
    rotary = is_rotary(axis) and axis in model.machine.axes
    return axis if rotary and (table.direct or table.output == output_of(axis)) else None


def _largest(table: Table, model: Model) -> float:
    """The largest entry, a lever multiplied in."""
    if table.lever is None:
        return table.largest()
    return table.largest() * table.reach(model.machine.axes[table.lever[0]].travel)


def _slope(table: Table, model: Model) -> float:
    """The steepest rise along any linear axis, mm/mm."""
    # along a lever the values are the slope themselves
    steepest = 0.0 if table.lever is None else table.largest()
    factor = _largest(table, model) / table.largest() if table.largest() > 0.0 else 1.0
    for k, (axis, nodes) in enumerate(zip(table.inputs, table.nodes, strict=True)):
        if is_rotary(axis) or len(nodes) < 2:
            continue
        for values in (table.forward, table.downward):
            steps = np.moveaxis(np.diff(values, axis=k), k, -1) / np.diff(nodes)
            steepest = max(steepest, float(np.abs(steps).max()) * factor)
    return steepest


def _places(axes: Sequence[str], group: Sequence[Table], model: Model) -> Mapping[str, F64]:
    """All points of a group, with the other axes at the ends of their travels."""
    levers = _levers(group, model)
    own = []
    for axis in axes:
        nodes = [t.nodes[t.inputs.index(axis)] for t in group]
        if levers and is_rotary(axis):
            nodes.append(_turns(model.machine.axes[axis].travel))
        # the ends are held: nothing beyond the travel, nothing left out up to its ends
        low, high = model.machine.axes[axis].travel
        inside = np.unique(np.concatenate(nodes))
        inside = inside[(inside > low) & (inside < high)]
        own.append(np.concatenate([[low], inside, [high]]))
    others = []
    for axis, found in model.machine.axes.items():
        if axis in axes:
            continue
        needed = levers or any((t.lever or ("",))[0] == axis for t in group)
        if not needed:
            others.append((axis, np.array([found.middle])))
        elif is_rotary(axis):
            others.append((axis, _turns(found.travel)))
        else:
            others.append((axis, np.array(found.travel)))
    names = [*axes, *(name for name, _ in others)]
    mesh = np.meshgrid(*own, *(places for _, places in others), indexing="ij")
    return {name: m.reshape(-1) for name, m in zip(names, mesh, strict=True)}


def _levers(group: Sequence[Table], model: Model) -> bool:
    """Whether what tables move the tip by depends on where it is."""
    return any(not t.direct or _turned(t, model) for t in group)


def _turns(travel: tuple[float, float]) -> F64:
    """Places of a rotary axis all over its travel, one turn at most, (n,), rad."""
    low, high = travel
    high = min(high, low + 2.0 * np.pi)
    return np.linspace(low, high, int(np.ceil((high - low) / _TURN)) + 1)
