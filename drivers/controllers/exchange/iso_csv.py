"""Tables of ISO/TR 16907, 9.2, as CSV: one file an axis, the sign in each file's head."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from abbe.compcore.errors import InputError
from abbe.compcore.machine.error_motion import Component, ErrorMotion
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.tables.capability import Capability, Holds, Spacing
from abbe.compcore.tables.form import (
    Entries,
    Reversal,
    accumulated,
    from_reversal,
    increments,
    reversal_columns,
    to_single,
)
from abbe.compcore.tables.table import Sign, Table, move, tables_of
from abbe.drivers.controllers.axes import DEGREE, F64
from abbe.drivers.controllers.base import Confidence, Controller, ControllerOptions, Trust
from abbe.drivers.controllers.text import fixed, increasing, number, numbered_lines

_FORMAT = "abbe-table/1"
_SECOND: dict[Reversal, str] = {
    "columns": "(-)",
    "difference": "(-)-(+)",
    "single": "half reversal",
}
_FIRST: dict[Reversal, str] = {"columns": "(+)", "difference": "(+)", "single": "mean"}
_COLUMN = re.compile(r"E_([XYZABC])([XYZUVWRABC][0-9]?)(?: ([^\[]+?))? \[(mm|rad)\]")
_POSITION = re.compile(r"([XYZUVWRABC][0-9]?) \[(mm|deg)\]")


class IsoCsvOptions(ControllerOptions):
    """Options of `IsoCsv`."""

    holds: Literal["motions", "moves"] = "motions"
    """motions: the six error motions of each axis; moves: what moves X, Y and Z directly (L-POS and
    L-STR), the best without levers."""
    sign: Sign = Sign.ERROR
    """error, or compensation."""
    entries: Entries = "absolute"
    """absolute values, or incremental: steps outwards from the point nearest to zero."""
    reversal: Reversal = "columns"
    """columns: up and down; difference: up, down minus up; single: mean and half the reversal."""
    decimals: Annotated[int, Field(ge=3, le=9)] = 6
    """Decimals of lengths, mm; angles (rad) have three more."""
    points: Annotated[int, Field(ge=2, le=10_000)] = 1000


class IsoCsv(Controller):
    """Plain tables with ISO 230-1 names, for people, spreadsheets and converters."""

    name: ClassVar[str] = "csv"
    title: ClassVar[str] = (
        "CSV, one column an error motion, with reversal as in table 1 of ISO/TR 16907"
    )
    sign: ClassVar[str] = (
        "as the option sign says, in each file's head: error or compensation; mm, rad"
    )
    source: ClassVar[str] = "ISO/TR 16907:2015, 9.2; Abbe's own layout, docs/tables.md"
    trust: ClassVar[Trust] = Trust(
        Confidence.DOCUMENTED, Confidence.DOCUMENTED, Confidence.DOCUMENTED
    )
    Options: ClassVar[type[ControllerOptions]] = IsoCsvOptions
    options: IsoCsvOptions

    @property
    def capability(self) -> Capability:
        """Whatever tables over single axes can hold."""
        spacing = Spacing(least=0.01, unit=1e-3)
        turning = Spacing(least=0.001 * DEGREE, unit=1e-3 * DEGREE)
        axis = Holds(
            "motions",
            ("L-VOL", "R-VOL"),
            points=self.options.points,
            spacing=spacing,
            rotary_spacing=turning,
            directional=True,
            resolution=10.0**-self.options.decimals,
            rotary_resolution=10.0 ** -(self.options.decimals + 3),
        )
        if self.options.holds == "motions":
            return Capability((axis,), lookup="indicated", shared_nodes=True, knows_tool=True)
        own = replace(axis, form="axis", types=("L-POS", "R-POS"))
        # E_CB is the turn about Z that B errs by: no name is left for what C is turned by at B
        cross = replace(
            axis, form="cross", types=("L-STR", "L-SQU", "R-RAX"), outputs=("X", "Y", "Z")
        )
        return Capability((own, cross), lookup="indicated", shared_nodes=True)

    def adapted(self, tables: Sequence[Table]) -> tuple[Table, ...]:
        """With ``single`` reversal one value for the whole axis."""
        if self.options.reversal != "single":
            return tuple(tables)
        found = []
        for table in tables:
            step = 10.0 ** -(self.options.decimals + (3 if table.output.rotation else 0))
            mean, half = reversal_columns(to_single(table), "single")
            mean, half = np.rint(mean / step) * step, np.rint(half / step) * step
            found.append(from_reversal(replace(table, forward=mean, backward=None), half, "single"))
        return tuple(found)

    def _format(self, tables: Sequence[Table]) -> dict[str, str]:
        files = {}
        for axis in dict.fromkeys(t.inputs[0] for t in tables):
            mine = tables_of(tables, axis)
            nodes = mine[0].nodes[0]
            base, unit = (DEGREE, "deg") if is_rotary(axis) else (1.0, "mm")
            origin = float(nodes[np.abs(nodes).argmin()])
            head = [f"{axis} [{unit}]"]
            columns = []
            for table in mine:
                signed = table.as_sign(self.options.sign)
                name = f"E_{table.output.component}{axis}"
                angle = "rad" if table.output.rotation else "mm"
                decimals = self.options.decimals + (3 if table.output.rotation else 0)
                first, second = reversal_columns(signed, self.options.reversal)
                parts = [(first, _FIRST[self.options.reversal])]
                if table.directional:
                    parts.append((second, _SECOND[self.options.reversal]))
                for values, what in parts:
                    if self.options.entries == "incremental" and what != _SECOND["single"]:
                        values = increments(values, nodes, origin)
                    stated = f" {what}" if table.directional else ""
                    head.append(f"{name}{stated} [{angle}]")
                    columns.append([fixed(float(v), decimals) for v in values])
            lines = self._head(axis, origin / base, unit)
            lines.append(",".join(head))
            for i, q in enumerate(nodes):
                lines.append(",".join([fixed(float(q) / base, 3), *(c[i] for c in columns)]))
            files[f"{axis.lower()}.csv"] = "\n".join([*lines, ""])
        return files

    def _head(self, axis: str, origin: float, unit: str) -> list[str]:
        sign = self.options.sign
        meaning = "actual - indicated" if sign is Sign.ERROR else "indicated - actual"
        lines = [
            f'# format = "{_FORMAT}"',
            f'# axis = "{axis}"',
            f'# sign = "{sign}"  # {meaning}',
            f'# holds = "{self.options.holds}"',
            f'# entries = "{self.options.entries}"',
            f'# reversal = "{self.options.reversal}"',
        ]
        if self.options.entries == "incremental":
            lines.append(f"# origin = {fixed(origin, 3)}  # {unit}; steps count outwards from here")
        return lines

    def _parse(self, files: Mapping[str, str]) -> Sequence[Table]:
        return [table for name, text in files.items() for table in self._file(name, text)]

    def _file(self, name: str, text: str) -> list[Table]:
        stated: dict[str, str] = {}
        head: list[str] = []
        rows: list[list[float]] = []
        for i, line in numbered_lines(text):
            if line.startswith("#"):
                key, _, value = line[1:].partition("=")
                stated[key.strip()] = value.partition("#")[0].strip().strip('"')
            elif line and not head:
                head = [c.strip() for c in line.split(",")]
            elif line:
                parts = line.split(",")
                if len(parts) != len(head):
                    raise InputError(
                        "wrong number of columns", file=name, line=i, found=len(parts),
                        expected=str(len(head)),
                    )  # fmt: skip
                rows.append([number(p, name, i, h) for p, h in zip(parts, head, strict=True)])
        self._check_head(stated, name)
        position = _POSITION.fullmatch(head[0]) if head else None
        if position is None or position[1] not in self.machine.axes:
            raise InputError(
                "the first column is not an axis's position", file=name,
                found=head[0] if head else None, expected="X [mm]",
            )  # fmt: skip
        axis = position[1]
        table = np.array(rows).reshape(-1, len(head))
        base = DEGREE if position[2] == "deg" else 1.0
        nodes = increasing(list(table[:, 0]), name, 1, head[0]) * base
        origin = number(stated.get("origin", "0"), name, None, "origin") * base
        parts_of: dict[Component, dict[str, F64]] = {}
        for k, column in enumerate(head[1:], start=1):
            match = _COLUMN.fullmatch(column)
            if match is None or match[2] != axis:
                raise InputError(
                    "not a column of this axis", file=name, field=column, expected=f"E_X{axis} [mm]"
                )
            values = table[:, k].copy()
            what = match[3] or ""
            if stated["entries"] == "incremental" and what != _SECOND["single"]:
                values = accumulated(values, nodes, origin)
            component: Component = match[1]  # type: ignore[assignment]
            parts_of.setdefault(component, {})[what] = values
        reversal: Reversal = stated["reversal"]  # type: ignore[assignment]
        found = []
        for component, columns in parts_of.items():
            values = columns.get("", columns.get(_FIRST[reversal], np.zeros(len(nodes))))
            direct = stated["holds"] == "moves" and not (is_rotary(axis) and component in "ABC")
            output = move(component) if direct else ErrorMotion(axis, component)
            one = Table(output, (axis,), (nodes,), values, sign=Sign(stated["sign"]))
            if _SECOND[reversal] in columns:
                one = from_reversal(one, columns[_SECOND[reversal]], reversal)
            found.append(one.as_sign(Sign.ERROR))
        return found

    def _check_head(self, stated: Mapping[str, str], name: str) -> None:
        allowed = {
            "format": (_FORMAT,),
            "sign": tuple(Sign),
            "holds": ("motions", "moves"),
            "entries": ("absolute", "incremental"),
            "reversal": tuple(_SECOND),
        }
        for key, values in allowed.items():
            if stated.get(key) not in values:
                raise InputError(
                    "the file's head does not say what the numbers are", file=name, field=key,
                    found=stated.get(key), expected="one of " + ", ".join(values),
                )  # fmt: skip

    def activation(self) -> tuple[str, ...]:
        """Not a controller."""
        return ("For a converter of your own, or to be read: the sign stands in each file's head.",)
