"""A product of two axes' positions in CEC tables, the same for every reading of the manual.

MULT_BY_TABLE makes the control add the product of two tables to the axis. Whether the two factors
act by themselves as well, text and example of the manual do not agree on. So each product is
written twice, the second time with both factors turned round::

    a·b + α·a + β·b  +  (−a)·(−b) + α·(−a) + β·(−b)  =  2·a·b

Whatever part α and β of the factors acts by itself, none or all, it cancels. The factors are kept
small, so that a table that is forgotten moves the axis by tenths of a millimetre, not by a lever.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from abbe.compcore.errors import InputError
from abbe.compcore.machine.machine import Machine
from abbe.compcore.tables.table import Table
from abbe.drivers.controllers.axes import F64, moved_axis, output_of, position_unit
from abbe.drivers.controllers.siemens.archive import DECIMALS, POSITION_DECIMALS, Cec, by_index

FACTOR = 0.1
"""mm: the lever's factor at the ends of its table; it is 0 in the middle."""
TABLES = 4
"""CEC tables that a product takes."""
RESOLUTION = 2.0 * FACTOR * 10.0**-DECIMALS
"""mm: step of a product at the end of its lever."""

_WHY = "products are read as Abbe writes them: twice, the second time with both factors turned"


def held(table: Table, machine: Machine) -> Table:
    """The nearest product that the control can hold: its factor in whole steps."""
    axis, origin = _lever(table)
    step = RESOLUTION / _half(table, machine)
    return replace(
        table,
        forward=np.rint(table.forward / step) * step,
        backward=None,
        lever=(axis, round(origin, POSITION_DECIMALS)),
    )


def four_tables(
    table: Table, machine: Machine, names: Mapping[str, str], index: int
) -> tuple[Cec, ...]:
    """A product of errors as CEC tables.

    Parameters
    ----------
    table
        As `held` gives it: f(x)·(z − z₀), mm/mm.
    machine
        For the lever's travel.
    names
        Axis → name on the control.
    index
        Of the first of the four.
    """
    axis, origin = _lever(table)
    half = _half(table, machine)
    nodes = table.nodes[0] / position_unit(table.inputs[0])
    moved = names[moved_axis(table)]
    angle = -table.forward * half / (2.0 * FACTOR)
    lever = np.array([-FACTOR, 0.0, FACTOR])
    made = []
    for k, turn in ((0, 1.0), (2, -1.0)):
        first, second = index + k, index + k + 1
        made += [
            Cec(
                first, names[table.inputs[0]], moved, float(nodes[0]), float(nodes[1] - nodes[0]),
                turn * angle, multiplied_by=second,
            ),
            Cec(second, names[axis], moved, origin - half, half, turn * lever),
        ]  # fmt: skip
    return tuple(made)


def read_products(
    tables: Sequence[Cec], axes: Mapping[str, str], file: str
) -> tuple[list[Table], list[Cec]]:
    """The products among CEC tables, as errors, and the tables that belong to none.

    Parameters
    ----------
    tables
        Of one file.
    axes
        Name on the control → axis.
    file
        For errors.

    Raises
    ------
    InputError
        For a product that is not written twice, or whose second factor is no lever.
    """
    known = by_index(tables)
    waiting = [t for t in tables if t.multiplied_by is not None]
    used: set[int] = set()
    found = []
    while waiting:
        angle = waiting.pop(0)
        lever = _factor(angle, known, file)
        twin = next((t for t in waiting if _turned(t, angle) and
                     _turned(_factor(t, known, file), lever)), None)  # fmt: skip
        if twin is None:
            raise InputError(
                "a product of tables without its counterpart", file=file,
                field=f"CEC_MULT_BY_TABLE[{angle.index}]", expected=_WHY,
            )  # fmt: skip
        waiting.remove(twin)
        used |= {angle.index, lever.index, twin.index, _factor(twin, known, file).index}
        found.append(_product(angle, lever, axes, file))
    if len(used) != TABLES * len(found):
        raise InputError("a table is a factor of two products", file=file, expected=_WHY)
    return found, [t for t in tables if t.index not in used]


def _lever(table: Table) -> tuple[str, float]:
    if table.lever is None:
        raise ValueError(f"{table.name} is no product")
    return table.lever


def _half(table: Table, machine: Machine) -> float:
    """Half of the lever's table: as far as the travel reaches from the origin, mm."""
    axis, _ = _lever(table)
    unit = 10.0**-POSITION_DECIMALS
    reach = table.reach(machine.axis(axis).travel)
    return round(float(np.ceil(reach / unit - 1e-6)) * unit, POSITION_DECIMALS)


def _factor(table: Cec, known: Mapping[int, Cec], file: str) -> Cec:
    by = known.get(-1 if table.multiplied_by is None else table.multiplied_by)
    one = by is not None and by.multiplied_by is None and by.moved == table.moved
    if by is None or not one or table.direction or by.direction or not _is_lever(by.values):
        raise InputError(
            "a table is multiplied by one that is no lever of the same axis, both ways", file=file,
            field=f"CEC_MULT_BY_TABLE[{table.index}]", expected=_WHY,
        )  # fmt: skip
    return by


def _is_lever(values: F64) -> bool:
    return len(values) == 3 and values[1] == 0.0 and values[0] == -values[2] != 0.0


def _turned(one: Cec, other: Cec) -> bool:
    """Whether a table is another with all values turned round."""
    same = (one.source, one.moved, one.start, one.step) == (
        other.source, other.moved, other.start, other.step,
    )  # fmt: skip
    return same and np.array_equal(one.values, -other.values)


def _product(angle: Cec, lever: Cec, axes: Mapping[str, str], file: str) -> Table:
    for name in (angle.source, angle.moved, lever.source):
        if name not in axes:
            raise InputError(
                "an axis that the machine does not have", file=file, found=name,
                expected="one of " + ", ".join(axes) + "; see the option axes",
            )  # fmt: skip
    source = axes[angle.source]
    values = angle.values * (-2.0 * float(lever.values[2]) / lever.step)
    origin = round(lever.start + lever.step, POSITION_DECIMALS)
    return Table(
        output_of(axes[angle.moved]),
        (source,),
        (angle.nodes * position_unit(source),),
        values,
        lever=(axes[lever.source], origin),
    )
