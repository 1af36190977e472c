"""Tables that turn rotary axes: their own angle, and the tool's direction by all axes' positions.

Errors turn the tool as well as move it; a controller that corrects a rotary axis by the position of
this and of other axes can turn it back (FOR of ISO/TR 16907, 8.2). What is best over the volume is
known in closed form as for moves, with one difference: a turn of C counts only as far as it tilts
the tool (sin B on a head). With `c_a` what a unit turn of axis a does to the tool's direction and ω
by what the tool is turned, the functions ``f(x)`` that leave least of the lean in the mean square
are ``E[cᵀc | x]⁻¹·E[cᵀω | x]``. Near a pole that is bounded as commands are
(`abbe.compcore.model.pose`).

An axis that can only turn the tool about itself holds its own positioning error and no more; so
does every axis where the direction is not asked for, which may leave less of the point's error:
tables over single axes cannot always take back by how much a turn moves the tip.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError
from abbe.compcore.machine.error_motion import ErrorMotion
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.machine.machine import Machine, own_component
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.pose import DAMPING, MOST_TURN, POLE, spinning_axes, tool_letter
from abbe.compcore.tables.capability import Capability, Holds
from abbe.compcore.tables.field import ErrorField
from abbe.compcore.tables.projection.curves.curve import Curve
from abbe.compcore.tables.projection.curves.marginal import marginal
from abbe.compcore.tables.projection.motions import LETTERS
from abbe.compcore.tables.table import Table
from abbe.compcore.tables.volume import Volume

F64 = NDArray[np.float64]
Fine = Callable[[str], F64]
"""Axis → fine positions over its travel, mm or rad."""

_POINTS = 987
_WORTH_SAYING = 1e-6
"""rad"""
_RADIUS = 100.0
"""mm from its line at which a rotary axis's angle counts where neither tool nor axes say where."""
_MOST_ALONE = 2
"""Rotary axes of a table or head alone; more, or two alike, are an arm, whose poses none knows."""
_NOTHING = 2e-7
"""rad: a table over another axis's position that does less is not made."""


def longest_lever(field: ErrorField, volume: Volume, axis: str = "") -> float:
    """The longest lever of a turn of an axis in the volume, mm: tool and the others' ranges."""
    linear = field.model.machine.structure.linear
    tool = float(np.linalg.norm(field.state.tool))
    if not linear:
        return tool or _RADIUS
    return tool + sum(2.0 * volume.half(a) for a in linear if a != axis)


def pointing_axes(machine: Machine) -> tuple[str, ...]:
    """Rotary axes that can turn the tool's direction, in the structure's order."""
    spins = spinning_axes(machine, "XYZ".index(tool_letter(machine)))
    return tuple(a for a in machine.structure.rotary if a not in spins)


def lean(
    field: ErrorField,
    where: Mapping[str, F64],
    facing: Mapping[str, F64],
    axes: tuple[str, ...],
) -> tuple[F64, F64]:
    """By what the tool is tilted, and what turns of axes do to that.

    Returns
    -------
    tilt
        (n, 3), rad, the workpiece's frame, square to the tool.
    columns
        (n, 3, axes), rad per rad.
    """
    conditions = field.conditions(where, facing)
    chain = Chain(field.model.machine, conditions)
    direction = chain.orientation[:, :, "XYZ".index(tool_letter(field.model.machine))]

    def across(vector: F64) -> F64:
        return np.asarray(vector - np.einsum("ni,ni->n", vector, direction)[:, None] * direction)

    tilt = across(chain.to_workpiece(field.model.predict(conditions).rotation))
    columns = [across(chain.screw(a)[1]) for a in axes]
    return tilt, np.stack(columns, axis=2) if columns else np.zeros((conditions.n, 3, 0))


def require_corrected(structure: Structure, capability: Capability) -> None:
    """Refuse a machine none of whose axes can carry what the controller's tables hold.

    Raises
    ------
    InputError
        For an arm, and a rotary table alone whose controller has no table for its angle.
    """
    if structure.carrying:
        return
    alike = len({axis[0] for axis in structure.rotary}) < len(structure.rotary)
    if structure.linear or alike or len(structure.rotary) > _MOST_ALONE:
        structure.require_carrying()
    grid_or_motions = capability.form("grid") or capability.form("motions")
    turned = [a for a in structure.rotary if _holds(capability, a, a)]
    if not turned and (grid_or_motions is None or not _knows_rotary(capability)):
        raise InputError(
            "the machine has rotary axes only, and this controller has no table for the angle of "
            "one",
            field="structure",
            found=str(structure),
            expected="a controller that holds R-POS: abbe controllers",
        )


def _knows_rotary(capability: Capability) -> bool:
    return any(name.startswith("R-") for name in capability.types)


def require_turning(machine: Machine, capability: Capability) -> None:
    """Refuse a machine or a controller whose tables cannot turn the tool's direction back.

    Raises
    ------
    InputError
        Says which, and why.
    """
    axes = pointing_axes(machine)
    if not axes:
        raise InputError(
            "no rotary axis of this machine can turn the tool's direction",
            field="orientation",
            found=str(machine.structure),
        )
    if not any(_holds(capability, a, output) for output in axes for a in machine.structure.axes):
        raise InputError(
            "this controller has no tables that correct a rotary axis by a position",
            field="orientation",
            expected=f"tables over one axis's position that correct {' or '.join(axes)}",
        )


def turning_curves(
    field: ErrorField,
    volume: Volume,
    capability: Capability,
    fine: Fine,
    *,
    orientation: bool,
) -> tuple[list[Curve], list[Curve]]:
    """What tables that turn rotary axes are to hold, rad.

    With `orientation` the tool's direction as far as they can; else each axis's own positioning
    error only.

    Returns
    -------
    Those that are to be made, and those for which the controller has no more tables.
    """
    machine = field.model.machine
    pointing = pointing_axes(machine) if orientation else ()
    own = _own_curves(field, volume, capability, fine, pointing)
    if not pointing:
        return own, []
    held, left_out = _pointing_curves(field, volume, capability, fine, pointing)
    return [*own, *held], left_out


def constant_turns(curves: Sequence[Curve], tables: Sequence[Table]) -> list[str]:
    """Notes on constant turns that tables cannot hold, which must be 0 at their axis's zero."""
    lost: dict[str, float] = {}
    for curve in curves:
        for table in tables:
            if table.same_number(curve.table()):
                missing = curve.values[0] - table.at(curve.positions)
                place = table.output.place
                lost[place] = lost.get(place, 0.0) + float(np.median(missing))
    return [
        f"{axis}: all its tables are 0 at a zero, and a constant turn of {constant * 1e6:.1f} µrad "
        f"is left of its correction: it belongs into the offset of the axis's reference point"
        for axis, constant in lost.items()
        if abs(constant) > _WORTH_SAYING
    ]


def _own_curves(
    field: ErrorField,
    volume: Volume,
    capability: Capability,
    fine: Fine,
    pointing: tuple[str, ...],
) -> list[Curve]:
    """Axes that only turn the tool about itself: their positioning error motion itself."""
    machine, reversing = field.model.machine, field.reversing()
    found: list[Curve] = []
    for axis in machine.structure.rotary:
        holds = _holds(capability, axis, axis)
        if holds is None or axis in pointing:
            continue
        error_motion = _turn_of(axis)

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


def _pointing_curves(
    field: ErrorField,
    volume: Volume,
    capability: Capability,
    fine: Fine,
    pointing: tuple[str, ...],
) -> tuple[list[Curve], list[Curve]]:
    machine, reversing = field.model.machine, field.reversing()
    count = len(pointing)

    def normal(where: Mapping[str, F64], facing: Mapping[str, F64]) -> F64:
        """cᵀω and cᵀc at each row, (n, count + count²)."""
        tilt, columns = lean(field, where, facing, pointing)
        need = np.einsum("nia,ni->na", columns, tilt)
        weight = np.einsum("nia,nib->nab", columns, columns)
        return np.concatenate([need, weight.reshape(-1, count * count)], axis=1)

    whole = normal(volume.spread(machine.structure.axes, _POINTS), {}).mean(axis=0)
    mean = _solved(whole[None], np.zeros(count))[0]
    made: dict[str, list[Curve]] = {a: [] for a in pointing}
    for axis in machine.structure.axes:
        holds = {a: _holds(capability, axis, a) for a in pointing}
        if not any(holds.values()):
            continue
        part = marginal(normal, machine, volume, axis, fine(axis), reverses=axis in reversing)
        values = np.stack([_solved(v, mean) for v in part.mean])
        for k, output in enumerate(pointing):
            family = holds[output]
            same = axis == output
            if family is None or not (same or np.abs(values[:, :, k]).max() > _NOTHING):
                continue
            curve = Curve(
                family,
                _turn_of(output),
                axis,
                part.positions,
                values[:, :, k] + (mean[k] if same else 0.0),
                longest_lever(field, volume, output),
            )
            made[output].append(curve)
    return _as_many_as_there_are(made, capability)


def _as_many_as_there_are(
    made: Mapping[str, list[Curve]], capability: Capability
) -> tuple[list[Curve], list[Curve]]:
    """Each axis's own table, and of the others those that do most."""
    kept: list[Curve] = []
    left_out: list[Curve] = []
    room = None if capability.most_tables is None else capability.most_tables // 2
    for output, curves in made.items():
        curves.sort(key=lambda c: (c.axis != output, -float(np.abs(c.values).max())))
        for i, curve in enumerate(curves):
            limits = [n for n in (capability.per_output, room) if n is not None]
            crosses = sum(c.holds is curve.holds for c in curves[:i])
            if curve.holds.per_output is not None and curve.axis != output:
                limits.append(i - crosses + curve.holds.per_output)
            (kept if all(i < n for n in limits) else left_out).append(curve)
    return kept, left_out


def _solved(normal: F64, besides: F64) -> F64:
    """Turns beside some that leave least of the lean, from cᵀω and cᵀc, (m, count).

    Damped near a pole: where a turn does nothing to the direction, there is none besides.
    """
    count = len(besides)
    weight = normal[:, count:].reshape(-1, count, count)
    need = normal[:, :count] - weight @ besides
    squares, vectors = np.linalg.eigh(0.5 * (weight + np.swapaxes(weight, 1, 2)))
    squares = np.maximum(squares, 0.0)
    damping = (DAMPING * np.maximum(0.0, 1.0 - squares / POLE**2)) ** 2
    along = np.einsum("mij,mi->mj", vectors, need) / (squares + damping + 1e-300)
    turns = np.einsum("mij,mj->mi", vectors, along)
    return np.asarray(np.clip(turns, -MOST_TURN, MOST_TURN))


def _holds(capability: Capability, axis: str, output: str) -> Holds | None:
    form = "axis" if axis == output else "cross"
    return next((h for h in capability.holds if h.form == form and h.serves(axis, output)), None)


def _turn_of(axis: str) -> ErrorMotion:
    return ErrorMotion(axis, LETTERS["XYZABC".index(own_component(axis))])
