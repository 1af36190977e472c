"""Aerotech A3200 and Automation1: two-dimensional calibration tables, ``.cal``."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from abbe.compcore.errors import InputError
from abbe.compcore.machine.machine import Machine
from abbe.compcore.tables.capability import Capability, Holds, Spacing
from abbe.compcore.tables.table import Table, move
from abbe.drivers.controllers.axes import axis_numbers, equidistant
from abbe.drivers.controllers.base import (
    AxisNames,
    Confidence,
    Controller,
    ControllerOptions,
    PerAxis,
    Trust,
)
from abbe.drivers.controllers.text import (
    above_zero,
    fixed,
    number,
    numbered_lines,
    only_file,
    whole_number,
)

_DECIMALS = 3
"""Of values in µm."""
_KEY = re.compile(r"([A-Z0-9]+)\s*=\s*(\S+)")


class Aerotech2DOptions(ControllerOptions):
    """Options of `Aerotech2D`."""

    axes: PerAxis = Field(default_factory=dict)
    """Axis → number, from 1; none: X 1, Y 2, Z 3, then as the structure lists them."""
    row: str = "Y"
    """Axis that selects the row."""
    column: str = "X"
    """Axis that selects the column."""
    outputs: AxisNames = ("X", "Y")
    """Axes that are corrected: two, or three."""
    points: Annotated[int, Field(ge=2, le=2000)] = 101
    """Most points along each axis."""


class Aerotech2D(Controller):
    """A table over two axes whose entries correct two or three; additive, bilinear, ends held."""

    name: ClassVar[str] = "aerotech-2d"
    title: ClassVar[str] = "Aerotech A3200, Automation1: 2D calibration"
    sign: ClassVar[str] = (
        "compensation (−error), µm (CORUNIT=PRIMARY/1000); no NEGCOR, which would turn it round"
    )
    source: ClassVar[str] = (
        "Aerotech Automation1 help, Axis Calibration (interpolation, one-based axes, no "
        "direction); "
        "keywords, offsets and sign from three independent programs that write such files"
    )
    trust: ClassVar[Trust] = Trust(
        Confidence.UNVERIFIED,
        Confidence.UNVERIFIED,
        Confidence.DOCUMENTED,
        "OFFSETROW and OFFSETCOL as minus the first position, and the sign, are from third "
        "parties' "
        "programs; positions and corrections follow the encoder's sign",
    )
    Options: ClassVar[type[ControllerOptions]] = Aerotech2DOptions
    options: Aerotech2DOptions

    def __init__(self, machine: Machine, options: ControllerOptions | None = None) -> None:
        super().__init__(machine, options)
        chosen = self.options
        for axis in (chosen.row, chosen.column, *chosen.outputs):
            machine.axis(axis, "option of aerotech-2d")
            if axis not in self._numbers():
                raise InputError("an axis without a number", field="axes", found=axis)
        if len(chosen.outputs) not in (2, 3):
            raise InputError(
                "two or three axes are corrected", field="outputs", found=",".join(chosen.outputs)
            )

    def _numbers(self) -> dict[str, int]:
        return axis_numbers(self.machine, self.options.axes)

    @property
    def capability(self) -> Capability:
        """L-POS and L-STR of two axes at once, in their plane."""
        holds = Holds(
            "plane",
            ("L-POS", "L-STR", "L-SQU"),
            points=self.options.points,
            spacing=Spacing("equidistant", least=0.1, unit=1e-3),
            resolution=10.0 ** -(_DECIMALS + 3),
            inputs=(self.options.row, self.options.column),
            outputs=self.options.outputs,
        )
        return Capability((holds,), lookup="command")

    def _format(self, tables: Sequence[Table]) -> dict[str, str]:
        by_output = {t.output.component: t for t in tables}
        ordered = [by_output[a] for a in self.options.outputs]  # type: ignore[index]
        rows, columns = ordered[0].nodes
        numbers = self._numbers()
        outputs = [numbers[a] for a in self.options.outputs]
        third = f"OUTAXIS3={outputs[2]} " if len(outputs) == 3 else ""
        steps = [fixed(float(n[1] - n[0]), 3) for n in (rows, columns)]
        lines = [
            "' RowAxis ColumnAxis OutputAxis1 OutputAxis2 SampDistRow SampDistCol NumCols",
            f":START2D {numbers[self.options.row]} {numbers[self.options.column]} "
            f"{outputs[0]} {outputs[1]} {steps[0]} {steps[1]} {len(columns)}",
            f":START2D {third}POSUNIT=PRIMARY CORUNIT=PRIMARY/1000 "
            f"OFFSETROW = {fixed(-float(rows[0]), 3)} OFFSETCOL = {fixed(-float(columns[0]), 3)}",
            "",
        ]
        for i in range(len(rows)):
            groups = (
                "\t".join(fixed(-1e3 * float(t.forward[i, j]), _DECIMALS) for t in ordered)
                for j in range(len(columns))
            )
            lines.append("\t".join(groups))
        return {"calibration.cal": "\n".join([*lines, ":END", ""])}

    def _parse(self, files: Mapping[str, str]) -> Sequence[Table]:
        name, text = only_file(files)
        heads: list[str] = []
        values: list[list[float]] = []
        ended = False
        for i, line in numbered_lines(text):
            if not line or line[0] in "';":
                continue
            if line.upper() == ":END":
                ended = True
            elif ended:
                raise InputError("a second table", file=name, line=i, expected="one table")
            elif line.upper().startswith(":START2D"):
                heads.append(line[8:].strip())
            else:
                values.append([number(t, name, i, "correction") for t in line.split()])
        if len(heads) < 2 or not ended:
            raise InputError(
                "not a complete table", file=name, expected=":START2D twice, rows, :END"
            )
        return self._tables(name, heads, values)

    def _tables(
        self, name: str, heads: Sequence[str], values: Sequence[Sequence[float]]
    ) -> list[Table]:
        stated = heads[0].split()
        if len(stated) != 7:
            raise InputError(
                "not the head of a table", file=name, line=2, found=heads[0],
                expected="four axis numbers, two distances, the number of columns",
            )  # fmt: skip
        row, column, first, second, *rest = stated
        keys = dict(_KEY.findall(" ".join(heads[1:]).upper()))
        letters = {str(n): a for a, n in self._numbers().items()}
        outputs = [first, second, *([keys["OUTAXIS3"]] if "OUTAXIS3" in keys else [])]
        for key in (row, column, *outputs):
            if key not in letters:
                raise InputError(
                    "an axis number that the machine has no axis for", file=name, line=2, found=key,
                    expected=", ".join(f"{n} ({a})" for n, a in letters.items()),
                )  # fmt: skip
        if keys.get("POSUNIT") != "PRIMARY" or keys.get("CORUNIT") not in (
            "PRIMARY", "PRIMARY/1000",
        ):  # fmt: skip
            raise InputError(
                "units that are not read", file=name, line=3,
                found=f"{keys.get('POSUNIT')}, {keys.get('CORUNIT')}",
                expected="POSUNIT=PRIMARY, CORUNIT=PRIMARY or PRIMARY/1000",
            )  # fmt: skip
        factor = 1e-3 if keys["CORUNIT"].endswith("/1000") else 1.0
        factor *= 1.0 if "NEGCOR" in " ".join(heads).upper().split() else -1.0
        step_row, step_column = (
            above_zero(number(v, name, 2, k), name, 2, k)
            for v, k in zip(rest, ("SampDistRow", "SampDistCol"), strict=False)
        )
        count = whole_number(rest[2], name, 2, "NumCols")
        if not values or count < 1:
            raise InputError(
                "a table without points", file=name, found=f"{len(values)} rows of {count}",
                expected="one at least",
            )  # fmt: skip
        for i, line in enumerate(values, start=1):
            if len(line) != count * len(outputs):
                raise InputError(
                    "a row of the wrong length", file=name, field=f"row {i}", found=len(line),
                    expected=f"{count} columns of {len(outputs)}",
                )  # fmt: skip
        table = np.array(values).reshape(len(values), count, len(outputs)) * factor
        start_row, start_column = (
            -number(keys.get(k, "0"), name, 3, k) for k in ("OFFSETROW", "OFFSETCOL")
        )
        rows = equidistant(start_row, step_row, len(values))
        columns = equidistant(start_column, step_column, count)
        return [
            Table(
                move(letters[out]),
                (letters[row], letters[column]),
                (rows, columns),
                np.ascontiguousarray(table[:, :, k]),
            )
            for k, out in enumerate(outputs)
        ]

    def activation(self) -> tuple[str, ...]:
        """Load, enable."""
        return (
            'A3200: LOADCALFILE "calibration.cal", 2D_CAL, then CALENABLE 2D (CALDISABLE 2D: '
            "off); Automation1: Calibration in the configuration workspace, or CalibrationLoad().",
            "Home first. Positions and corrections follow the encoder's sign.",
            "Check one point with an indicator before use: offsets and sign have not been tried.",
        )
