"""The ISG kernel's compensation value lists (achskw*.lis): an axis's own and its cross tables."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from abbe.compcore.errors import InputError
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.tables.table import Table
from abbe.drivers.controllers.axes import DEGREE, moved_axis, output_of
from abbe.drivers.controllers.text import increasing, number, numbered_lines, whole

LENGTH = 1e-4
"""A length in a list, mm (0.1 µm)."""
ANGLE = 1e-4 * DEGREE
"""An angle in a list, rad (0.0001°)."""

_ENTRY = re.compile(r"kw\.(ssfk|crosscomp)\.table\[(\d+)\]\.(setpoint|pos|neg|correction)")


def axis_list(axis: str, tables: Sequence[Table], numbers: Mapping[str, int]) -> str:
    """The list of an axis, with its own tables and those of its masters; empty where it has none.

    Parameters
    ----------
    axis
        The axis that is corrected.
    tables
        All of the machine.
    numbers
        Axis → logical axis number.
    """
    own = [t for t in tables if moved_axis(t) == axis and t.inputs[0] == axis]
    cross = [t for t in tables if moved_axis(t) == axis and t.inputs[0] != axis]
    lines = [f"kopf.log_achs_nr {numbers[axis]}"]
    lines += [line for t in own for line in _ssfk(t)]
    lines += [line for t in cross for line in _cross(t, numbers)]
    return "\n".join([*lines, ""]) if own or cross else ""


def read_axis_list(name: str, text: str, numbers: Mapping[str, int]) -> list[Table]:
    """The tables of a list.

    Raises
    ------
    InputError
        With the file's name and line.
    """
    axes = {index: axis for axis, index in numbers.items()}
    keys: dict[str, str] = {}
    tables: dict[str, dict[str, dict[int, float]]] = {}
    for i, raw in numbered_lines(text):
        line = raw.partition("#")[0].strip()
        if not line:
            continue
        key, _, value = line.partition(" ")
        if match := _ENTRY.fullmatch(key):
            part = tables.setdefault(match[1], {}).setdefault(match[3], {})
            part[int(match[2])] = number(value.strip(), name, i, key)
        else:
            keys[key] = value.strip()

    def axis_of(key: str) -> str:
        index = keys.get(key, "")
        if not index.isdigit() or int(index) not in axes:
            raise InputError(
                "not the number of an axis", file=name, field=key, found=index or None,
                expected="one of " + ", ".join(f"{n} ({a})" for n, a in axes.items()),
            )  # fmt: skip
        return axes[int(index)]

    axis = axis_of("kopf.log_achs_nr")
    found = []
    for kind, columns in tables.items():
        if keys.get(f"kw.{kind}.unit") != "1":
            raise InputError(
                "only metric lists are read", file=name, field=f"kw.{kind}.unit", expected="1"
            )
        source = axis if kind == "ssfk" else axis_of("kw.crosscomp.master_ax_nr")
        both = keys.get("kw.ssfk.bilateral") == "1"
        found.append(_listed(kind, columns, source, axis, both, name))
    return found


def _cross(table: Table, numbers: Mapping[str, int]) -> list[str]:
    axis = moved_axis(table)
    lines = [
        f"kw.crosscomp.last_index {len(table.nodes[0]) - 1}",
        f"kw.crosscomp.master_ax_nr {numbers[table.inputs[0]]}",
        "kw.crosscomp.unit 1",
        "kw.crosscomp.n_cycles 0",
    ]
    for i, (q, v) in enumerate(zip(table.nodes[0], table.forward, strict=True)):
        lines.append(f"kw.crosscomp.table[{i}].setpoint {_count(q, table.inputs[0])}")
        lines.append(f"kw.crosscomp.table[{i}].correction {_count(v, axis)}")
    return lines


def _listed(
    kind: str,
    columns: Mapping[str, Mapping[int, float]],
    source: str,
    axis: str,
    both: bool,
    file: str,
) -> Table:
    """The table of one compensation list."""
    count = len(columns.get("setpoint", {}))
    base, step = (ANGLE if is_rotary(a) else LENGTH for a in (source, axis))

    def column(which: str) -> list[float]:
        entries = columns.get(which, {})
        if sorted(entries) != list(range(count)):
            raise InputError(
                "a table's points are not complete", file=file, field=which,
                found=len(entries), expected=f"0 to {count - 1}",
            )  # fmt: skip
        return [entries[i] for i in range(count)]

    nodes = increasing(column("setpoint"), file, 1, f"kw.{kind}") * base
    if kind == "crosscomp":
        values, backward = np.array(column("correction")) * step, None
    else:
        values = np.array(column("pos")) * step
        backward = np.array(column("neg")) * step if both else None
    return Table(output_of(axis), (source,), (nodes,), values, backward)


def _count(value: float, axis: str) -> int:
    return whole(float(value), ANGLE if is_rotary(axis) else LENGTH, axis)


def _ssfk(table: Table) -> list[str]:
    axis = table.inputs[0]
    nodes = [_count(q, axis) for q in table.nodes[0]]
    lines = [
        "kw.ssfk.unit 1",
        "kw.ssfk.interval 0",
        f"kw.ssfk.kw_startpos {nodes[0]}",
        f"kw.ssfk.kw_nr_max {len(nodes)}",
        f"kw.ssfk.bilateral {int(table.directional)}",
    ]
    for i, q in enumerate(nodes):
        lines.append(f"kw.ssfk.table[{i}].setpoint {q}")
        lines.append(f"kw.ssfk.table[{i}].pos {_count(table.forward[i], axis)}")
        if table.directional:
            lines.append(f"kw.ssfk.table[{i}].neg {_count(table.downward[i], axis)}")
    return lines
