"""Weihong NK200 and NcStudio: screw error compensation, ``axeserr.dat``."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal

import numpy as np

from abbe.compcore.errors import InputError
from abbe.compcore.tables.capability import Capability, Holds, Spacing
from abbe.compcore.tables.table import Table, move
from abbe.drivers.controllers.base import Confidence, Controller, ControllerOptions, Trust
from abbe.drivers.controllers.text import fixed, increasing, number, numbered_lines, only_file

_DECIMALS = 4
_UNIT = re.compile(r";?\s*unit\s*=\s*(\S+)", re.IGNORECASE)
_AXIS = re.compile(r"\[\s*([XYZxyz])\s*\]")


class WeihongOptions(ControllerOptions):
    """Options of `Weihong`."""

    unit_line: Literal[";unit=mm", "unit = mm"] = ";unit=mm"
    """First line: the NK200 manual's example has the first form, the NcStudio manual the second."""


class Weihong(Controller):
    """Each linear axis corrected by its own position, with an error for each direction."""

    name: ClassVar[str] = "weihong"
    title: ClassVar[str] = "Weihong NK200, NcStudio: axeserr.dat"
    sign: ClassVar[str] = "error (actual − nominal) on the way up and on the way down, mm"
    source: ClassVar[str] = (
        "Weihong NK200 manual p. 64-65, NcStudio (EasyRoute) manufacturer's manual p. 68; the sign "
        "from their example, where a backlash of 0.03 mm is a backward error of +0.030"
    )
    trust: ClassVar[Trust] = Trust(
        Confidence.DOCUMENTED,
        Confidence.UNVERIFIED,
        Confidence.DOCUMENTED,
        "the manuals say 'error' without its sign; it is taken from their backlash example",
    )
    Options: ClassVar[type[ControllerOptions]] = WeihongOptions
    options: WeihongOptions

    @property
    def capability(self) -> Capability:
        """L-POS in two directions; the manuals name no limit of points."""
        holds = Holds(
            "axis",
            ("L-POS",),
            points=500,
            spacing=Spacing(least=0.1, unit=1e-3),
            directional=True,
            resolution=1e-4,
            inputs=tuple(a for a in self.machine.structure.linear if a in ("X", "Y", "Z")),
        )
        return Capability((holds,), lookup="command")

    def _format(self, tables: Sequence[Table]) -> dict[str, str]:
        lines: list[str] = [self.options.unit_line]
        for table in tables:
            lines.append(f"[{table.inputs[0]}]")
            for q, up, down in zip(table.nodes[0], table.forward, table.downward, strict=True):
                lines.append(f"{fixed(q, 3)}, {fixed(up, _DECIMALS)}, {fixed(down, _DECIMALS)}")
        return {"axeserr.dat": "\n".join([*lines, ""])}

    def _parse(self, files: Mapping[str, str]) -> Sequence[Table]:
        name, text = only_file(files)
        rows: dict[str, list[tuple[float, float, float]]] = {}
        axis = None
        unit = False
        for i, line in numbered_lines(text):
            if found := _UNIT.fullmatch(line):
                if found[1].lower() != "mm":
                    raise InputError(
                        "only mm is supported", file=name, line=i, found=line, expected="unit = mm"
                    )
                unit = True
            elif not line or line.startswith(";"):
                continue
            elif heading := _AXIS.fullmatch(line):
                axis = heading[1].upper()
                rows[axis] = []
            else:
                parts = [p.strip() for p in line.split(",")]
                if axis is None or len(parts) != 3:
                    raise InputError(
                        "not a row of an axis",
                        file=name,
                        line=i,
                        found=line,
                        expected="[AXIS], then rows: nominal, forward error, backward error",
                    )
                q, up, down = (number(p, name, i, "value") for p in parts)
                rows[axis].append((q, up, down))
                increasing([r[0] for r in rows[axis][-2:]], name, i, "nominal")
        if not unit:
            raise InputError("no unit line", file=name, line=1, expected=self.options.unit_line)
        found_tables = []
        for axis, values in rows.items():
            nodes = increasing([row[0] for row in values], name, 1, f"[{axis}]")
            forward = np.array([row[1] for row in values])
            backward = np.array([row[2] for row in values])
            same = np.array_equal(forward, backward)
            found_tables.append(
                Table(move(axis), (axis,), (nodes,), forward, None if same else backward)
            )
        return found_tables

    def activation(self) -> tuple[str, ...]:
        """Copy and switch on."""
        return (
            "NK200: copy axeserr.dat to the root of a USB disk and load it; NcStudio: to its "
            "folder, "
            "and restart.",
            "Set 'Screw error compensation' to 2 (both directions), or to 1 with backlash apart.",
            "Positions must lie inside the stroke, or the compensation is invalid.",
        )
