"""The ISG kernel's volumetric file (ISG_CSV): component errors over one axis a block, both ways."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from abbe.compcore.errors import InputError
from abbe.compcore.machine.error_motion import Component, ErrorMotion
from abbe.compcore.machine.machine import Machine
from abbe.compcore.tables.table import Table, tables_of
from abbe.drivers.controllers.axes import position_unit
from abbe.drivers.controllers.text import fixed, increasing, number, numbered_lines

_LETTERS: tuple[Component, ...] = ("X", "Y", "Z", "A", "B", "C")
_DECIMALS = {False: 7, True: 10}
"""Of a length in mm; of an angle in rad."""


def isg_csv(tables: Sequence[Table]) -> str:
    """The file for tables of error motions."""
    blocks = []
    for axis in dict.fromkeys(t.inputs[0] for t in tables):
        mine = tables_of(tables, axis)
        base = position_unit(axis)
        lines = ["\t".join([axis, *(f"E{t.output.component}{axis}" for t in mine)])]
        for i, q in enumerate(mine[0].nodes[0]):
            values = [fixed(float(t.forward[i]), _DECIMALS[t.output.rotation]) for t in mine]
            lines.append("\t".join([fixed(float(q) / base, 3), *values]))
        blocks.append("\n".join(lines))
    head = "// component errors (actual - indicated): mm and rad over mm and degrees\n"
    return head + "\n#\n".join(blocks) + "\n"


def read_isg_csv(name: str, text: str, machine: Machine) -> list[Table]:
    """The tables of error motions of a file.

    Raises
    ------
    InputError
        With the file's name and line.
    """
    found: list[Table] = []
    head: list[str] = []
    rows: list[list[float]] = []

    def finish(line: int) -> None:
        if not head:
            return
        axis = head[0]
        if axis not in machine.axes:
            raise InputError(
                "a block that is not over one axis of this machine", file=name, line=line,
                found=" ".join(head), expected="an axis, then its component errors",
            )  # fmt: skip
        table = np.array(rows).reshape(-1, len(head))
        nodes = increasing(list(table[:, 0]), name, line, axis)
        nodes = nodes * position_unit(axis)
        for k, column in enumerate(head[1:], start=1):
            if len(column) < 3 or column[0] != "E" or column[2:] != axis:
                raise InputError(
                    "not a component error of the block's axis", file=name, line=line,
                    found=column, expected=", ".join(f"E{c}{axis}" for c in _LETTERS),
                )  # fmt: skip
            component: Component = column[1]  # type: ignore[assignment]
            found.append(Table(ErrorMotion(axis, component), (axis,), (nodes,), table[:, k].copy()))

    last = 0
    for last, raw in numbered_lines(text):
        line = raw.partition("//")[0].strip()
        if line == "#":
            finish(last)
            head, rows = [], []
        elif line and not head:
            head = line.split()
        elif line:
            parts = line.split()
            if len(parts) != len(head):
                raise InputError(
                    "wrong number of columns", file=name, line=last, found=len(parts),
                    expected=f"{len(head)}: {' '.join(head)}",
                )  # fmt: skip
            rows.append([number(p, name, last, "value") for p in parts])
    finish(last)
    return found
