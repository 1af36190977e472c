"""The live step of any machine: the chain of axes walked with Python floats.

The same composition as `abbe.compcore.machine.kinematics`, first-order or exact, written in the
workpiece's
frame: a walk from workpiece to tool that carries the orientation R and the shift so far. To first
order the error ``Σ t + ω × (P − O)`` is collected as ``Σ t − ω × O`` and ``Σ ω`` until the
functional point P is known.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.compensator.folding.slow_state import SlowState
from abbe.compcore.compensator.folding.tables import DirectionTable, FoldedAxisTable, FoldedTables
from abbe.compcore.compensator.rotation import (
    IDENTITY,
    Nine,
    Triple,
    about,
    about_xyz,
    apply,
    product,
    shifted,
    solved,
    transposed,
)
from abbe.compcore.compensator.scalar import (
    Value,
    lazy_rows,
    one_row,
    phases,
    scalar,
    scalar_products,
)
from abbe.compcore.machine.error_motion import FUNCTIONAL_POINT, SPINDLE, WORKPIECE, ErrorMotion
from abbe.compcore.machine.kinematics import Chain, moved_along
from abbe.compcore.machine.machine import Machine
from abbe.compcore.model.model import Composition

F64 = NDArray[np.float64]
Step = Callable[[Sequence[float], Sequence[float]], Triple]


def motions_at(tables: FoldedTables) -> Callable[[Sequence[float], Sequence[float]], list[float]]:
    """All error motions at one point, a list in the order of `tables` with a 0 at its end."""
    start = [*tables.constant.tolist(), 0.0]
    lines = []
    others: list[tuple[Value, int]] = phases(tables)
    products = [(scalar_products(bundle), bundle.error_motions) for bundle in tables.products]
    for table, columns in tables.tables:
        if isinstance(table, FoldedAxisTable):
            rows, fetch = lazy_rows(np.concatenate([table.intercept, table.slope], axis=1))
            width = len(columns)
            each = [(k, j, j + width) for j, k in enumerate(columns)]
            lines.append((table.axis, table.nodes.tolist(), rows, fetch, each))
        elif isinstance(table, DirectionTable):
            others += [(scalar(table, j), k) for j, k in enumerate(columns)]
    direct = tables.direct

    def motions(positions: Sequence[float], directions: Sequence[float]) -> list[float]:
        v = start.copy()
        for axis, nodes, rows, fetch, each in lines:
            q = positions[axis]
            i = bisect_right(nodes, q)
            row = rows[i] or fetch(i)
            for k, j, m in each:
                v[k] += row[j] + row[m] * q
        for value, k in others:
            v[k] += value(positions, directions)
        for values, error_motions in products:
            for k, part in zip(error_motions, values(positions, directions), strict=True):
                v[k] += part
        if direct is not None:
            for k, part in enumerate(direct(*one_row(positions, directions))[0].tolist()):
                v[k] += part
        return v

    return motions


class _Stage(NamedTuple):
    """One step of the walk.

    Attributes
    ----------
    kind
        ``linear``, ``rotary``, ``place`` (nothing moves) or ``bed`` (nothing errs either).
    axis
        Index among the positions.
    direction, point
        Of the axis; `point` is its rotation point (rotary: a point of its average line).
    first
        Linear: the error acts before the axis's own move. Rotary: on the workpiece side.
    motions
        Indices of the place's six error motions, −1 where it has none; None: it has none at all.
    letter
        0, 1, 2 for the axes X, Y, Z that carry corrections, else −1.
    along
        Whether the errors before it turn its linear error motions (`moved_along`).
    """

    kind: str
    axis: int = -1
    direction: Triple = (0.0, 0.0, 0.0)
    point: Triple = (0.0, 0.0, 0.0)
    first: bool = False
    motions: tuple[int, ...] | None = None
    letter: int = -1
    along: bool = False


def stages_of(machine: Machine, error_motions: Sequence[ErrorMotion]) -> list[_Stage]:
    """The walk from workpiece to tool."""

    def six(place: str) -> tuple[int, ...] | None:
        found = [-1] * 6
        for k, error_motion in enumerate(error_motions):
            if error_motion.place == place:
                found["XYZABC".index(error_motion.component)] = k
        return tuple(found) if max(found) >= 0 else None

    structure = machine.structure
    along = moved_along(machine)
    stages = [_Stage("place", motions=six(WORKPIECE))]
    for index, name in enumerate(structure.axes):
        if index == len(structure.workpiece_side):
            stages.append(_Stage("bed"))
        axis = machine.axis(name)
        if axis.rotary:
            on_workpiece = name in structure.workpiece_side
            stages.append(
                _Stage(
                    "rotary", index, axis.direction, axis.location, on_workpiece, six(name),
                    along=True,
                )
            )  # fmt: skip
        else:
            before = machine.own_move_in_lever(name)
            letter = "XYZ".find(name)
            stages.append(
                _Stage(
                    "linear", index, axis.direction, axis.rotation_point, before, six(name), letter,
                    name in along,
                )
            )  # fmt: skip
    if not structure.tool_side:
        stages.append(_Stage("bed"))
    return [*stages, _Stage("place", motions=six(SPINDLE), along=SPINDLE in along)]


Visit = tuple[tuple[int, ...], Nine, float, float, float, bool]
"""A place that errs: indices of its six error motions, the orientation of the frame in which they
are given, the point about which its angles turn, and whether errors before it turn its linear
ones."""


def walk(
    stages: Sequence[_Stage], positions: Sequence[float]
) -> tuple[list[Visit], Nine, float, float, float, Nine, list[Nine]]:
    """From workpiece to tool at one point.

    The places that err; orientation and place of the tool's zero; the bed's orientation; those in
    which X, Y and Z move. (A plain tuple: a named one takes longer to make than a stage.)
    """
    turn = bed = IDENTITY
    carried = [IDENTITY, IDENTITY, IDENTITY]
    visits: list[Visit] = []
    sx = sy = sz = 0.0
    for kind, axis, direction, point, first, six, letter, along in stages:
        frame = turn
        if kind == "linear":
            q = positions[axis]
            mx, my, mz = direction
            cx, cy, cz = point
            if turn is not IDENTITY:
                mx, my, mz = apply(turn, mx, my, mz)
                cx, cy, cz = apply(turn, cx, cy, cz)
            if letter >= 0:
                carried[letter] = turn
            nx, ny, nz = sx + mx * q, sy + my * q, sz + mz * q
            if first:
                cx, cy, cz = sx + cx, sy + cy, sz + cz
            else:
                cx, cy, cz = nx + cx, ny + cy, nz + cz
            sx, sy, sz = nx, ny, nz
        elif kind == "rotary":
            lx, ly, lz = point
            rotation = about(direction, positions[axis])
            if turn is IDENTITY:
                cx, cy, cz = sx + lx, sy + ly, sz + lz
                turn = rotation
            else:
                rx, ry, rz = apply(turn, lx, ly, lz)
                cx, cy, cz = sx + rx, sy + ry, sz + rz
                turn = product(turn, rotation)
            rx, ry, rz = apply(turn, lx, ly, lz)
            sx, sy, sz = cx - rx, cy - ry, cz - rz
            if first:
                frame = turn
        elif kind == "bed":
            bed = turn
            continue
        else:
            cx, cy, cz = sx, sy, sz
        if six is not None:
            visits.append((six, frame, cx, cy, cz, along))
    return visits, turn, sx, sy, sz, bed, carried


def _first_order(
    visits: list[Visit], v: Sequence[float], gx: float, gy: float, gz: float
) -> tuple[float, float, float, Nine]:
    """The error at the functional point, ``Σ t + ω × (P − O)``, and by what the tool is turned."""
    ex = ey = ez = wx = wy = wz = 0.0
    for (i, j, k, a, b, c), frame, cx, cy, cz, _ in visits:
        tx, ty, tz, ax, ay, az = v[i], v[j], v[k], v[a], v[b], v[c]
        if frame is not IDENTITY:
            tx, ty, tz = apply(frame, tx, ty, tz)
            ax, ay, az = apply(frame, ax, ay, az)
        ex += tx - ay * cz + az * cy
        ey += ty - az * cx + ax * cz
        ez += tz - ax * cy + ay * cx
        wx += ax
        wy += ay
        wz += az
    return (
        ex + (wy * gz - wz * gy),
        ey + (wz * gx - wx * gz),
        ez + (wx * gy - wy * gx),
        (1.0, -wz, wy, wz, 1.0, -wx, -wy, wx, 1.0),
    )


def _exact(
    visits: list[Visit], v: Sequence[float], gx: float, gy: float, gz: float
) -> tuple[float, float, float, Nine]:
    """The error at the functional point and of the tool's orientation, with full rotations."""
    ex = ey = ez = ox = oy = oz = 0.0
    turned = IDENTITY
    for (i, j, k, a, b, c), frame, cx, cy, cz, along in visits:
        tx, ty, tz = v[i], v[j], v[k]
        local = about_xyz(v[a], v[b], v[c])
        if frame is not IDENTITY:
            tx, ty, tz = apply(frame, tx, ty, tz)
            local = product(product(frame, local), transposed(frame))
        if along and turned is not IDENTITY:
            tx, ty, tz = apply(turned, tx, ty, tz)
        dx, dy, dz = shifted(turned, cx - ox, cy - oy, cz - oz)
        ex += tx + dx
        ey += ty + dy
        ez += tz + dz
        turned = local if turned is IDENTITY else product(turned, local)
        ox, oy, oz = cx, cy, cz
    dx, dy, dz = shifted(turned, gx - ox, gy - oy, gz - oz)
    return ex + dx, ey + dy, ez + dz, turned


ChainError = Callable[
    [list[Visit], Sequence[float], float, float, float, Nine], tuple[float, float, float, Nine]
]
"""What `walk` visits, the error motions, the nominal functional point and the bed's orientation →
its error, mm, and the turn that the errors give the tool; all in the workpiece's frame."""


def chain_error(tables: FoldedTables, composition: Composition) -> ChainError:
    """The error of the functional point and orientation, as the model composes it."""
    composed = _first_order if composition == "first-order" else _exact
    at_point = [-1, -1, -1]
    for k, error_motion in enumerate(tables.error_motions):
        if error_motion.place == FUNCTIONAL_POINT:
            at_point["XYZ".index(error_motion.component)] = k
    px, py, pz = at_point

    def error(
        visits: list[Visit], v: Sequence[float], gx: float, gy: float, gz: float, bed: Nine
    ) -> tuple[float, float, float, Nine]:
        ex, ey, ez, turned = composed(visits, v, gx, gy, gz)
        hx, hy, hz = v[px], v[py], v[pz]
        if bed is not IDENTITY:
            hx, hy, hz = apply(bed, hx, hy, hz)
        return ex + hx, ey + hy, ez + hz, turned

    return error


def general_step(
    machine: Machine, composition: Composition, tables: FoldedTables, state: SlowState
) -> Step:
    """The step of any machine, with the state's tool and spindle angle."""
    zero = {a: np.zeros(1) for a in machine.structure.axes}
    ux, uy, uz = Chain(machine, state.conditions(zero, {})).tool[0].tolist()
    motions = motions_at(tables)
    stages = stages_of(machine, tables.error_motions)
    error = chain_error(tables, composition)
    axes = [machine.axis(letter).direction for letter in "XYZ"]
    inverse: Nine = tuple(np.linalg.inv(np.array(axes).T).reshape(-1).tolist())
    square = inverse == IDENTITY

    def step(positions: Sequence[float], directions: Sequence[float]) -> Triple:
        v = motions(positions, directions)
        visits, turn, sx, sy, sz, bed, carried = walk(stages, positions)
        gx, gy, gz = (ux, uy, uz) if turn is IDENTITY else apply(turn, ux, uy, uz)
        ex, ey, ez, _ = error(visits, v, sx + gx, sy + gy, sz + gz, bed)
        one, two, three = carried
        if one is two is three:
            if one is not IDENTITY:
                ex, ey, ez = apply(transposed(one), ex, ey, ez)
            return (ex, ey, ez) if square else apply(inverse, ex, ey, ez)
        return solved([apply(t, *axes[i]) for i, t in enumerate(carried)], ex, ey, ez)

    return step
