"""Etalon exchange format, variant 'Vendor', which TwinCAT CNC and the ISG kernel read."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from abbe.compcore.errors import InputError
from abbe.compcore.machine.error_motion import Component, ErrorMotion
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.tables.capability import Capability, Holds, Spacing
from abbe.compcore.tables.table import Table, superposed
from abbe.drivers.controllers.axes import DEGREE, position_unit
from abbe.drivers.controllers.base import Confidence, Controller, Trust
from abbe.drivers.controllers.text import fixed, increasing, number, numbered_lines, only_file

_DECIMALS = 12
_SECTION = re.compile(r"\[\s*([A-Z0-9]+)\s*\]")
_MOTION = re.compile(r"E([XYZABC])([XYZUVWRABC][0-9]?)")
_CONSTANT = re.compile(r"([XYZABC])0([XYZABC])")


class EtalonExchange(Controller):
    """Six component errors of each axis, a section each; the controller knows the levers."""

    name: ClassVar[str] = "etalon-exchange"
    title: ClassVar[str] = "Etalon exchange format (Vendor), for TwinCAT CNC and ISG kernel"
    sign: ClassVar[str] = "error (actual − indicated) of ISO 230-1 names, mm and rad"
    source: ClassVar[str] = (
        "ISG kernel documentation, Volumetric compensation: Etalon Exchange Format, units of "
        "measure "
        "(also Beckhoff TF5280)"
    )
    trust: ClassVar[Trust] = Trust(
        Confidence.DOCUMENTED,
        Confidence.UNVERIFIED,
        Confidence.DOCUMENTED,
        "signs are those of ISO 230; where an axis's levers begin in the kernel's kinematic model "
        "is "
        "not said",
    )

    @property
    def capability(self) -> Capability:
        """L-VOL and R-VOL: all six error motions of every axis."""
        holds = Holds(
            "motions",
            ("L-VOL", "R-VOL"),
            points=1000,
            spacing=Spacing(least=0.1, unit=1e-3),
            rotary_spacing=Spacing(least=0.01 * DEGREE, unit=1e-3 * DEGREE),
            resolution=1e-7,
            rotary_resolution=1e-10,
        )
        return Capability((holds,), lookup="command", knows_tool=True)

    def _format(self, tables: Sequence[Table]) -> dict[str, str]:
        lines = ["// component errors: mm and rad over mm and degrees"]
        for table in tables:
            name = f"E{table.output.component}{table.output.place}"
            base = position_unit(table.inputs[0])
            lines += [f"[{name}]", "Gridpoints = {"]
            lines += [
                f"   {fixed(float(q) / base, 3)} {fixed(float(v), _DECIMALS)}"
                for q, v in zip(table.nodes[0], table.forward, strict=True)
            ]
            lines.append(f"}}  // end of {name}")
        return {"volcomp.txt": "\n".join([*lines, ""])}

    def _parse(self, files: Mapping[str, str]) -> Sequence[Table]:
        name, text = only_file(files)
        found: list[Table] = []
        section = ""
        rows: list[list[float]] | None = None
        for i, raw in numbered_lines(text):
            line = raw.partition("//")[0].strip()
            if not line:
                continue
            if rows is None and (heading := _SECTION.fullmatch(line)):
                section = heading[1]
            elif line.startswith("VALUE"):
                value = number(line.partition("=")[2].strip(), name, i, section)
                found.append(self._constant(section, value, name, i))
            elif line.replace(" ", "") == "Gridpoints={":
                rows = []
            elif line == "}":
                found.append(self._motion(section, rows or [], name, i))
                rows = None
            elif rows is not None and len(line.split()) == 2:
                rows.append([number(t, name, i, section) for t in line.split()])
            else:
                raise InputError(
                    "not a line of this format", file=name, line=i, found=line,
                    expected="[NAME], VALUE = …, Gridpoints = {, two numbers, }",
                )  # fmt: skip
        if rows is not None:
            raise InputError("a section does not end", file=name, field=section, expected="}")
        return list(superposed(found, ()))  # constants beside error motions

    def _motion(self, section: str, rows: Sequence[Sequence[float]], file: str, line: int) -> Table:
        match = _MOTION.fullmatch(section)
        if match is None or match[2] not in self.machine.axes:
            raise InputError(
                "not a component error of this machine", file=file, line=line, found=section
            )
        component: Component = match[1]  # type: ignore[assignment]
        axis = match[2]
        positions = increasing([r[0] for r in rows], file, line, section)
        nodes = positions * position_unit(axis)
        return Table(
            ErrorMotion(axis, component), (axis,), (nodes,), np.array([r[1] for r in rows])
        )

    def _constant(self, section: str, value: float, file: str, line: int) -> Table:
        match = _CONSTANT.fullmatch(section)
        if match is None or match[2] not in self.machine.axes:
            raise InputError(
                "not a position error of this machine", file=file, line=line, found=section
            )
        if not is_rotary(match[2]):
            raise InputError(
                "position errors of linear axes depend on the choice of axes and are not read",
                file=file, line=line, found=section,
                expected="squareness in the component errors",
            )  # fmt: skip
        component: Component = match[1]  # type: ignore[assignment]
        return Table(
            ErrorMotion(match[2], component), (match[2],), (np.zeros(1),), np.array([value])
        )

    def activation(self) -> tuple[str, ...]:
        """Named in the volumetric compensation's list."""
        return (
            "In the volumetric compensation list: file[0] volcomp.txt, file_format[0] "
            "ETALON_EXCHANGE "
            "(see `--controller twincat-isg` for the list itself).",
            "#VOLCOMP OFF [ID0], #VOLCOMP [ID0 UPDATE], #VOLCOMP ON [ID0].",
            "Check one point away from all axes' zeros with an indicator: it shows signs and "
            "levers at "
            "once.",
        )
