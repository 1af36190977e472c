"""Beckhoff TwinCAT CNC and the ISG kernel: volumetric tables (ISG_CSV) or axis lists."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from compcore.channel import Channel, Component
from compcore.errors import InputError
from compcore.structure import is_rotary
from compcore.tables.capability import Capability, Holds, Spacing
from compcore.tables.table import Table, tables_of
from drivers.controllers.axes import (
    DEGREE,
    axis_numbers,
    moved_axis,
    output_of,
    position_unit,
)
from drivers.controllers.base import Confidence, Controller, ControllerOptions, PerAxis, Trust
from drivers.controllers.text import fixed, increasing, number, numbered_lines, whole

_LENGTH = 1e-4
"""A length in an axis list, mm (0.1 µm)."""
_ANGLE = 1e-4 * DEGREE
_ENTRY = re.compile(r"kw\.(ssfk|crosscomp)\.table\[(\d+)\]\.(setpoint|pos|neg|correction)")
_LETTERS: tuple[Component, ...] = ("X", "Y", "Z", "A", "B", "C")


class TwinCatIsgOptions(ControllerOptions):
    """Options of `TwinCatIsg`."""

    form: Literal["volumetric", "axes"] = "volumetric"
    """volumetric: ISG_CSV and its list; axes: a compensation value list (achskw*.lis) an axis."""
    axes: PerAxis = Field(default_factory=dict)
    """Axis → logical axis number; none: X 1, Y 2, Z 3, then as the structure lists them."""
    folder: str = "C:\\vc"
    """Where the files will lie on the controller (volumetric)."""
    records: Annotated[int, Field(ge=10)] = 2000
    """vol_comp[0].max_records of the start-up list: rows in all (volumetric)."""
    filter_steps: Annotated[int, Field(ge=0)] = 20
    points: Annotated[int, Field(ge=2, le=1500)] = 1000
    """Most points of a list (kw.ssfk.max_points, kw.crosscomp.max_points)."""


class TwinCatIsg(Controller):
    """A true volumetric target, and lists for axes: leadscrew error and cross compensation.

    Axis lists: an axis's own table has two directions; as a slave it has one master axis only.
    """

    name: ClassVar[str] = "twincat-isg"
    title: ClassVar[str] = "Beckhoff TwinCAT CNC, ISG kernel: volumetric and axis compensation"
    sign: ClassVar[str] = (
        "error (actual − indicated): volumetric as ISO 230-1 names, mm and rad; axis lists whole "
        "0.1 µm "
        "or 0.0001°"
    )
    source: ClassVar[str] = (
        "ISG kernel documentation (Volumetric compensation; compensation value lists, with a "
        "worked "
        "example of kw.ssfk), Beckhoff TF5280 and TF5200"
    )
    trust: ClassVar[Trust] = Trust(
        Confidence.DOCUMENTED,
        Confidence.UNVERIFIED,
        Confidence.DOCUMENTED,
        "documented: kw.ssfk = actual − setpoint. Taken from it: kw.crosscomp. ISO 230 signs for "
        "the "
        "volumetric file; where an axis's levers begin in the kernel's kinematic model is not said",
    )
    Options: ClassVar[type[ControllerOptions]] = TwinCatIsgOptions
    options: TwinCatIsgOptions

    @property
    def capability(self) -> Capability:
        """L-VOL and R-VOL, or L-POS in two directions and one L-STR for each axis."""
        spacing = Spacing(least=0.1, unit=1e-3)
        turning = Spacing(least=0.01 * DEGREE, unit=1e-3 * DEGREE)
        if self.options.form == "volumetric":
            holds = Holds(
                "motions",
                ("L-VOL", "R-VOL"),
                points=self.options.records // len(self.machine.axes),
                spacing=spacing,
                rotary_spacing=turning,
                resolution=1e-7,
                rotary_resolution=1e-10,
            )
            return Capability((holds,), lookup="command", shared_nodes=True, knows_tool=True)
        axis = Holds(
            "axis",
            ("L-POS", "R-POS"),
            points=self.options.points,
            spacing=spacing,
            rotary_spacing=turning,
            directional=True,
            resolution=_LENGTH,
            rotary_resolution=_ANGLE,
        )
        cross = replace(
            axis, form="cross", types=("L-STR", "R-RAX"), directional=False, per_output=1
        )
        return Capability((axis, cross), lookup="command")

    def _numbers(self) -> dict[str, int]:
        return axis_numbers(self.machine, self.options.axes)

    def _format(self, tables: Sequence[Table]) -> dict[str, str]:
        if self.options.form == "volumetric":
            return {"volcomp1.csv": _isg_csv(tables), "volcomp1.lis": self._list()}
        files = {}
        for axis, index in self._numbers().items():
            lines = [f"kopf.log_achs_nr {index}"]
            own = [t for t in tables if moved_axis(t) == axis and t.inputs[0] == axis]
            cross = [t for t in tables if moved_axis(t) == axis and t.inputs[0] != axis]
            lines += [line for t in own for line in _ssfk(t)]
            lines += [line for t in cross for line in self._cross(t)]
            if own or cross:
                files[f"achskw{index}.lis"] = "\n".join([*lines, ""])
        return files

    def _list(self) -> str:
        numbers = self._numbers()
        rows = [
            ("workpiece_axes", str(len(self.machine.structure.workpiece_side))),
            *((axis, str(i)) for axis, i in numbers.items()),
            ("Interpolation", "GRID"),
            ("enable_splicing", "FALSE"),
            ("filter_steps", str(self.options.filter_steps)),
            ("manual_activation", "FALSE"),
            ("alternative_model", "FALSE"),
            ("associate_to_channel", "FALSE"),
            ("file[0]", f"{self.options.folder}\\volcomp1.csv"),
            ("file_format[0]", "ISG_CSV"),
        ]
        return "".join(f"{key:<24} {value}\n" for key, value in rows)

    def _cross(self, table: Table) -> list[str]:
        axis = moved_axis(table)
        lines = [
            f"kw.crosscomp.last_index {len(table.nodes[0]) - 1}",
            f"kw.crosscomp.master_ax_nr {self._numbers()[table.inputs[0]]}",
            "kw.crosscomp.unit 1",
            "kw.crosscomp.n_cycles 0",
        ]
        for i, (q, v) in enumerate(zip(table.nodes[0], table.forward, strict=True)):
            lines.append(f"kw.crosscomp.table[{i}].setpoint {_count(q, table.inputs[0])}")
            lines.append(f"kw.crosscomp.table[{i}].correction {_count(v, axis)}")
        return lines

    def _parse(self, files: Mapping[str, str]) -> Sequence[Table]:
        found: list[Table] = []
        for name, text in files.items():
            if name.endswith(".csv"):
                found += self._volumetric(name, text)
            elif name.startswith("achskw"):
                found += self._axis_list(name, text)
        return found

    def _volumetric(self, name: str, text: str) -> list[Table]:
        found: list[Table] = []
        head: list[str] = []
        rows: list[list[float]] = []

        def finish(line: int) -> None:
            if not head:
                return
            axis = head[0]
            if axis not in self.machine.axes:
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
                found.append(Table(Channel(axis, component), (axis,), (nodes,), table[:, k].copy()))

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

    def _axis_list(self, name: str, text: str) -> list[Table]:
        axes = {number_: axis for axis, number_ in self._numbers().items()}
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

    def activation(self) -> tuple[str, ...]:
        """Start-up list, reload commands."""
        if self.options.form == "volumetric":
            return (
                f"Copy both files to {self.options.folder}; in the start-up list: "
                "vol_comp[0].file_name "
                f"{self.options.folder}\\volcomp1.lis, vol_comp[0].max_records "
                f"{self.options.records}.",
                "Reload: #VOLCOMP OFF [ID0], #VOLCOMP [ID0 UPDATE], #VOLCOMP ON [ID0]; or over "
                "ADS.",
                "Position only: the tool's orientation is not compensated.",
                "Check one point away from all axes' zeros with an indicator: it shows signs and "
                "levers "
                "at once; `negate` in the list turns single axes round.",
            )
        return (
            "Name the lists in the start-up list; switch on lr_param.ssfk (P-AXIS-00175) and "
            "lr_param.crosscomp (P-AXIS-00047) of each corrected axis.",
            "Lists are read at start-up, or reloaded; X[COMP ON LEAD CROSS] in the NC program "
            "where "
            "manual_activation is set.",
            "A cross list lies with the slave axis; newer kernels want it with the master.",
            "Check one point of a cross list with an indicator: its sign is taken from kw.ssfk.",
        )


def _moved(table: Table) -> str:
    return table.output.component if table.direct else table.output.place


def _listed(
    kind: str,
    columns: Mapping[str, Mapping[int, float]],
    source: str,
    axis: str,
    both: bool,
    file: str,
) -> Table:
    """The table of one compensation list."""
    count = len(columns["setpoint"])
    base, step = (_ANGLE if is_rotary(a) else _LENGTH for a in (source, axis))

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
    return whole(float(value), _ANGLE if is_rotary(axis) else _LENGTH, axis)


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


def _isg_csv(tables: Sequence[Table]) -> str:
    blocks = []
    for axis in dict.fromkeys(t.inputs[0] for t in tables):
        mine = tables_of(tables, axis)
        base = position_unit(axis)
        lines = ["\t".join([axis, *(f"E{t.output.component}{axis}" for t in mine)])]
        for i, q in enumerate(mine[0].nodes[0]):
            values = [fixed(float(t.forward[i]), 10 if t.output.rotation else 7) for t in mine]
            lines.append("\t".join([fixed(float(q) / base, 3), *values]))
        blocks.append("\n".join(lines))
    head = "// component errors (actual - indicated): mm and rad over mm and degrees\n"
    return head + "\n#\n".join(blocks) + "\n"
