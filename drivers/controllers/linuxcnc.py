"""LinuxCNC: screw compensation files, one a joint."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from abbe.compcore.errors import InputError
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.tables.capability import Capability, Holds, Spacing
from abbe.compcore.tables.table import Table
from abbe.drivers.controllers.axes import DEGREE, output_of
from abbe.drivers.controllers.base import Confidence, Controller, ControllerOptions, PerAxis, Trust
from abbe.drivers.controllers.text import fixed, increasing, number

_MOST = 256
"""EMCMOT_COMP_SIZE; the 257th line and all after it are ignored."""
_NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|nan|inf)"
_ROW = re.compile(rf"\s*{_NUMBER}\s+{_NUMBER}\s+{_NUMBER}\s*")


class LinuxCNCOptions(ControllerOptions):
    """Options of `LinuxCNC`."""

    type: Literal["0", "1"] = "0"
    """COMP_FILE_TYPE. 0: nominal, actual on the way up, and on the way down; 1: nominal, trims."""
    units: Literal["mm", "inch"] = "mm"
    """LINEAR_UNITS of the joints."""
    joints: PerAxis = Field(default_factory=dict)
    """Axis → joint; none: X Y Z A B C U V W in this order, those that the machine has."""


class LinuxCNC(Controller):
    """Screw compensation: each joint corrected by its own commanded position and direction.

    The parser stops without a word at the first line that is not three numbers, ignores whatever
    comes after 256 lines, and skips a line whose nominal does not increase. None of this can be
    written, and none of it is read without an error.
    """

    name: ClassVar[str] = "linuxcnc"
    title: ClassVar[str] = "LinuxCNC 2.8 and later, COMP_FILE"
    sign: ClassVar[str] = (
        "type 0: the measured actual position, nominal + error; type 1: the trim that is added to "
        "the command, the compensation (−error)"
    )
    source: ClassVar[str] = (
        "LinuxCNC's source (usrmotintf.cc, command.c, control.c) and its manual, INI "
        "configuration; "
        "seen on a running LinuxCNC 2.9"
    )
    trust: ClassVar[Trust] = Trust(Confidence.TRIED, Confidence.TRIED, Confidence.TRIED)
    Options: ClassVar[type[ControllerOptions]] = LinuxCNCOptions
    options: LinuxCNCOptions

    @property
    def capability(self) -> Capability:
        """L-POS and R-POS, two directions, 256 points anywhere."""
        inch = self.options.units == "inch"
        step = 25.4e-7 if inch else 1e-6
        unit = 25.4e-5 if inch else 1e-3
        holds = Holds(
            "axis",
            ("L-POS", "R-POS"),
            points=_MOST,
            spacing=Spacing(least=40.0 * unit, unit=unit),
            rotary_spacing=Spacing(least=0.01 * DEGREE, unit=1e-3 * DEGREE),
            directional=True,
            resolution=step,
            rotary_resolution=1e-7 * DEGREE,
        )
        return Capability((holds,), lookup="command")

    def _unit(self, axis: str) -> tuple[float, int, int]:
        """Size of the file's unit, decimals of nominals and of values."""
        if is_rotary(axis):
            return DEGREE, 3, 7
        return (25.4, 5, 7) if self.options.units == "inch" else (1.0, 3, 6)

    def _format(self, tables: Sequence[Table]) -> dict[str, str]:
        files = {}
        for table in tables:
            (axis,) = table.inputs
            unit, coarse, fine = self._unit(axis)
            lines = []
            for q, up, down in zip(
                table.nodes[0] / unit, table.forward / unit, table.downward / unit, strict=True
            ):
                pair = (q + up, q + down) if self.options.type == "0" else (-up, -down)
                values = " ".join(fixed(v, fine) for v in pair)
                lines.append(f"{fixed(q, coarse)} {values}\n")
            files[f"{axis.lower()}.comp"] = "".join(lines)
        return files

    def _parse(self, files: Mapping[str, str]) -> Sequence[Table]:
        return [self._table(name, text) for name, text in files.items()]

    def _table(self, name: str, text: str) -> Table:
        axis = name.rpartition(".")[0].upper()
        if axis not in self.machine.axes:
            raise InputError(
                "the file's name is not that of an axis",
                file=name,
                expected="one of " + ", ".join(f"{a.lower()}.comp" for a in self.machine.axes),
            )
        unit, _, _ = self._unit(axis)
        rows = []
        lines = text.split("\n")
        if lines[-1] == "":
            lines.pop()
        for i, line in enumerate(lines, start=1):
            match = _ROW.fullmatch(line.rstrip("\r"))
            if match is None:
                raise InputError(
                    "LinuxCNC reads no further than this line and does not say so",
                    file=name,
                    line=i,
                    found=line.strip(),
                    expected="three numbers with blanks between",
                )
            rows.append([number(t, name, i, "value") for t in match.groups()])
            if len(rows) > 1 and rows[-1][0] <= rows[-2][0]:
                raise InputError(
                    "LinuxCNC skips this line: the nominal does not increase",
                    file=name,
                    line=i,
                    found=rows[-1][0],
                    expected=f"more than {rows[-2][0]:g}",
                )
        if len(rows) > _MOST:
            raise InputError(
                "LinuxCNC ignores the lines from here on",
                file=name,
                line=_MOST + 1,
                found=f"{len(rows)} lines",
                expected=f"at most {_MOST}",
            )
        increasing([r[0] for r in rows], name, 1, "nominal")
        table = np.array(rows) * unit
        nodes, up, down = table.T
        if self.options.type == "0":
            up, down = up - nodes, down - nodes
        else:
            up, down = -up, -down
        same = bool(np.abs(up - down).max() < 1e-12)
        return Table(output_of(axis), (axis,), (nodes.copy(),), up, None if same else down)

    def activation(self) -> tuple[str, ...]:
        """INI entries, and a restart."""
        order = [a for a in "XYZABCUVW" if a in self.machine.axes]
        joints = self.options.joints or {a: i for i, a in enumerate(order)}
        entries = [
            f"[JOINT_{joint}] COMP_FILE = {axis.lower()}.comp and COMP_FILE_TYPE = "
            f"{self.options.type}"
            for axis, joint in joints.items()
        ]
        return (
            "Copy the files beside the INI file, and in it set:",
            *entries,
            "A COMP_FILE replaces the joint's BACKLASH.",
            "Restart LinuxCNC: the files are read at start only.",
            "Check with halcmd: joint.N.motor-pos-cmd − joint.N.pos-cmd − joint.N.motor-offset is "
            "the compensation, on the way up and on the way down.",
        )
