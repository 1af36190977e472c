"""Heidenhain ND 720 and ND 760 read-outs: compensation-value tables over RS-232."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from abbe.compcore.errors import InputError
from abbe.compcore.tables.capability import Capability, Form, Holds, Spacing
from abbe.compcore.tables.table import Table, move
from abbe.drivers.controllers.axes import equidistant
from abbe.drivers.controllers.base import Confidence, Controller, ControllerOptions, PerAxis, Trust
from abbe.drivers.controllers.text import fixed, number, whole_number

_POINTS = 64
_MOST_SPACING = 30
"""2^30 µm is a kilometre."""
_UNSET = "----------"
_LINE = re.compile(r"(?P<key>.*?)\s*=\s*(?P<value>.*)")


class HeidenhainNDOptions(ControllerOptions):
    """Options of `HeidenhainND`."""

    model: Literal["ND-720", "ND-760"] = "ND-760"
    axes: PerAxis = Field(default_factory=dict)
    """Axis → number on the read-out; none: X 0, Y 1, Z 2."""
    decimals: Annotated[int, Field(ge=1, le=4)] = 3
    """Decimals of the display, mm."""
    spacing_um: Annotated[float, Field(gt=0.0)] = 1.0
    """Unit of the spacing, µm: the distance is this times 2 to the power of SPACING."""


class HeidenhainND(Controller):
    """One table of 64 points for each axis, looked up by that axis or by one other."""

    name: ClassVar[str] = "heidenhain-nd"
    title: ClassVar[str] = "Heidenhain ND 720 / ND 760 digital read-outs"
    sign: ClassVar[str] = "error (actual − indicated), mm: what is added to the display"
    source: ClassVar[str] = (
        "ND 720 manual p. 62-64 (layout); ND 287 manual p. 80 and PT 855 manual p. 98 for the "
        "sign: a "
        "positive factor where the true length is greater than the displayed one"
    )
    trust: ClassVar[Trust] = Trust(
        Confidence.DOCUMENTED,
        Confidence.UNVERIFIED,
        Confidence.DOCUMENTED,
        "the sign is that of the linear compensation of sister models; that SPACING counts powers "
        "of "
        "two in µm is from memory",
    )
    Options: ClassVar[type[ControllerOptions]] = HeidenhainNDOptions
    options: HeidenhainNDOptions

    @property
    def capability(self) -> Capability:
        """L-POS or one straightness for each axis, 64 points at a power of two."""
        linear = tuple(a for a in self.machine.structure.linear if a in self._numbers())
        spacing = Spacing("power of two", unit=self.options.spacing_um * 1e-3, powers=(6, 23))
        step = 10.0**-self.options.decimals
        forms: tuple[tuple[Form, tuple[str, ...]], ...] = (
            ("axis", ("L-POS",)),
            ("cross", ("L-STR",)),
        )
        holds = tuple(
            Holds(
                form,
                types,
                points=_POINTS,
                spacing=spacing,
                resolution=step,
                zero_at="start",
                inputs=linear,
                outputs=linear,
            )
            for form, types in forms
        )
        return Capability(holds, lookup="indicated", per_output=1)

    def _numbers(self) -> dict[str, int]:
        given = self.options.axes or {"X": 0, "Y": 1, "Z": 2}
        return {a: n for a, n in given.items() if a in self.machine.axes}

    def _format(self, tables: Sequence[Table]) -> dict[str, str]:
        numbers = self._numbers()
        files = {}
        for table in tables:
            axis, source = table.output.component, table.inputs[0]
            nodes = table.nodes[0]
            distance = float(nodes[1] - nodes[0]) * 1e3 / self.options.spacing_um
            lines = [
                "*",
                f"{self.options.model:<13}{'MM':<5}",
                f"{'AXIS ' + axis:<13} = {numbers[axis]:>6}",
                f"{axis + ' FCT. ' + source:<13} = {numbers[source]:>6}",
                f"{'SPACING ' + axis:<13} = {round(np.log2(distance)):>6}",
                f"{'DATUM ' + axis:<13} = {self._number(float(nodes[0]))}",
            ]
            for i in range(_POINTS):
                value = self._number(table.forward[i]) if i < len(nodes) else f"{_UNSET:>13}"
                lines.append(f"{f'{axis} NR. {i:02d}':<13} = {value}")
            files[f"nd-{axis.lower()}.txt"] = "".join(f"{line}\r\n" for line in [*lines, "*"])
        return files

    def _number(self, value: float) -> str:
        """Sign, then the digits to the right: 13 characters."""
        text = fixed(value, self.options.decimals)
        return f"{'-' if text.startswith('-') else '+'}{text.lstrip('-'):>12}"

    def _parse(self, files: Mapping[str, str]) -> Sequence[Table]:
        return [self._table(name, text) for name, text in files.items()]

    def _table(self, name: str, text: str) -> Table:
        names = {n: a for a, n in self._numbers().items()}
        rows = list(_rows(text, name))
        keys = {key: (value, line) for line, key, value in rows}

        def found(start: str) -> tuple[str, int]:
            for key, item in keys.items():
                if key.startswith(start):
                    return item
            raise InputError("a line is missing", file=name, field=start.strip())

        value, line = found("AXIS ")
        axis = names.get(int(number(value, name, line, "AXIS")))
        cause, line = found(f"{axis} FCT.") if axis is not None else ("-1", line)
        source = names.get(int(number(cause, name, line, "FCT.")))
        if axis is None or source is None:
            raise InputError(
                "an axis number that the machine has no axis for", file=name, line=line,
                expected="one of " + ", ".join(f"{n} ({a})" for n, a in names.items()),
            )  # fmt: skip
        power, line = found("SPACING")
        exponent = whole_number(power, name, line, "SPACING")
        if not 0 <= exponent <= _MOST_SPACING:
            raise InputError(
                "a spacing that no unit has", file=name, line=line, field="SPACING", found=exponent,
                expected=f"0 to {_MOST_SPACING}",
            )  # fmt: skip
        distance = self.options.spacing_um * 1e-3 * 2.0**exponent
        datum, line = found("DATUM")
        start = number(datum.replace(" ", ""), name, line, "DATUM")
        values: list[float] = []
        for line, key, value in rows:
            if " NR. " not in key or value == _UNSET:
                continue
            if whole_number(key.rpartition(" ")[2], name, line, key) != len(values):
                raise InputError("a point is missing", file=name, line=line, found=key)
            values.append(number(value.replace(" ", ""), name, line, key))
        if not values or values[0] != 0.0:
            raise InputError("the first value is always 0", file=name, field="NR. 00")
        nodes = equidistant(start, distance, len(values))
        return Table(move(axis), (source,), (nodes,), np.array(values))

    def activation(self) -> tuple[str, ...]:
        """Send each file, switch it on."""
        return (
            "Cross the reference marks first: the datum point counts from them.",
            "Send each file over RS-232 in the table menu of the installation parameters (code "
            "number "
            "105 296).",
            "Switch on the non-linear axis error compensation of each axis.",
            "Check one point against a standard: the sign has not been tried.",
        )


def _rows(text: str, file: str) -> Iterator[tuple[int, str, str]]:
    """Line, key and value of all lines between the two asterisks."""
    lines = [line.rstrip() for line in text.replace("\r\n", "\n").split("\n")]
    while lines and not lines[-1]:
        lines.pop()
    if len(lines) < 3 or lines[0] != "*" or lines[-1] != "*":
        raise InputError("the table does not begin and end with *", file=file, expected="*")
    if not lines[1].endswith("MM"):
        raise InputError("not in mm", file=file, line=2, found=lines[1], expected="… MM")
    for i, line in enumerate(lines[2:-1], start=3):
        match = _LINE.fullmatch(line)
        if match is None:
            raise InputError("not a line of a table", file=file, line=i, found=line)
        yield i, match["key"].strip(), match["value"].strip()
