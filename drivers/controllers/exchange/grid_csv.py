"""Spatial grids of ISO/TR 16907, 9.3, as CSV: three translations and three rotations a point."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from abbe.compcore.errors import InputError
from abbe.compcore.machine.error_motion import Component
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.tables.capability import Capability, Holds, Spacing
from abbe.compcore.tables.table import Sign, Table, move
from abbe.drivers.controllers.axes import DEGREE, position_unit
from abbe.drivers.controllers.base import Confidence, Controller, ControllerOptions, Trust
from abbe.drivers.controllers.text import fixed, number, numbered_lines

_FORMAT = "abbe-grid/1"
_AXIS = re.compile(r"([XYZUVWRABC][0-9]?) \[(mm|deg)\]")
_LETTERS: tuple[Component, ...] = ("X", "Y", "Z", "A", "B", "C")
_VALUES = [f"d{c} [{'deg' if c in 'ABC' else 'mm'}]" for c in _LETTERS]


class GridCsvOptions(ControllerOptions):
    """Options of `GridCsv`."""

    sign: Sign = Sign.COMPENSATION
    """compensation, as in ISO/TR 16907, tables 2 and 3; or error."""
    decimals: Annotated[int, Field(ge=3, le=9)] = 6
    """Decimals of lengths, mm; angles (degrees) have two more."""


class GridCsv(Controller):
    """One grid over X, Y, Z, and one over the rotary axes, relative to their zero; they add up."""

    name: ClassVar[str] = "grid-csv"
    title: ClassVar[str] = (
        "CSV, spatial grids of ISO/TR 16907: table 2 (linear axes), table 3 (rotary axes)"
    )
    sign: ClassVar[str] = (
        "as the option sign says, in each file's head: compensation (−error) or error; mm, degrees"
    )
    source: ClassVar[str] = "ISO/TR 16907:2015, 9.3; Abbe's own layout, docs/tables.md"
    trust: ClassVar[Trust] = Trust(
        Confidence.DOCUMENTED, Confidence.DOCUMENTED, Confidence.DOCUMENTED
    )
    Options: ClassVar[type[ControllerOptions]] = GridCsvOptions
    options: GridCsvOptions

    @property
    def capability(self) -> Capability:
        """Everything that the model says, at one tool, between points trilinear."""
        holds = Holds(
            "grid",
            ("L-VOL+", "R-VOL+"),
            points=200,
            spacing=Spacing(unit=1e-3),
            rotary_spacing=Spacing(unit=1e-3 * DEGREE),
            resolution=10.0**-self.options.decimals,
            rotary_resolution=10.0 ** -(self.options.decimals + 2) * DEGREE,
        )
        return Capability((holds,), lookup="indicated")

    def _format(self, tables: Sequence[Table]) -> dict[str, str]:
        files = {}
        for axes in dict.fromkeys(t.inputs for t in tables):
            mine = {t.output.component: t.as_sign(self.options.sign) for t in tables
                    if t.inputs == axes}  # fmt: skip
            nodes = mine["X"].nodes
            base = [position_unit(a) for a in axes]
            head = [f"{a} [{'deg' if is_rotary(a) else 'mm'}]" for a in axes]
            meaning = (
                "actual - indicated" if self.options.sign is Sign.ERROR else "indicated - actual"
            )
            lines = [
                f'# format = "{_FORMAT}"',
                f'# sign = "{self.options.sign}"  # {meaning}',
                ",".join([*head, *_VALUES]),
            ]
            texts = [[fixed(float(q) / b, 3) for q in n] for n, b in zip(nodes, base, strict=True)]
            decimals = self.options.decimals
            flat = [
                [
                    fixed(float(v), decimals + (2 if c in "ABC" else 0))
                    for v in mine[c].forward.reshape(-1) / (DEGREE if c in "ABC" else 1.0)
                ]
                for c in _LETTERS
            ]
            lines += [
                ",".join([*where, *values])
                for where, values in zip(
                    itertools.product(*texts), zip(*flat, strict=True), strict=True
                )
            ]
            files[f"grid-{''.join(axes).lower()}.csv"] = "\n".join([*lines, ""])
        return files

    def _parse(self, files: Mapping[str, str]) -> Sequence[Table]:
        return [table for name, text in files.items() for table in self._file(name, text)]

    def _file(self, name: str, text: str) -> list[Table]:
        sign = ""
        head: list[str] = []
        rows: list[list[float]] = []
        for i, line in numbered_lines(text):
            if line.startswith("#"):
                key, _, value = line[1:].partition("=")
                if key.strip() == "sign":
                    sign = value.partition("#")[0].strip().strip('"')
            elif line and not head:
                head = [c.strip() for c in line.split(",")]
            elif line:
                parts = line.split(",")
                if len(parts) != len(head):
                    raise InputError(
                        "wrong number of columns", file=name, line=i, found=len(parts),
                        expected=str(len(head)),
                    )  # fmt: skip
                rows.append([number(p, name, i, "value") for p in parts])
        if sign not in tuple(Sign):
            raise InputError(
                "the file's head does not say what the numbers are", file=name, field="sign",
                found=sign or None, expected="error or compensation",
            )  # fmt: skip
        matches = [_AXIS.fullmatch(h) for h in head[: -len(_VALUES)]]
        if head[-len(_VALUES) :] != _VALUES or not matches or None in matches:
            raise InputError(
                "not the columns of a grid", file=name, found=",".join(head),
                expected="X [mm],…," + ",".join(_VALUES),
            )  # fmt: skip
        axes = tuple(m[1] for m in matches if m is not None)
        for axis in axes:
            self.machine.axis(axis, name)
        table = np.array(rows)
        nodes = [np.unique(table[:, k]) for k in range(len(axes))]
        shape = tuple(len(n) for n in nodes)
        size = math.prod(shape)
        if (
            len(table) != size
            or (
                table[:, : len(axes)]
                != np.stack(np.meshgrid(*nodes, indexing="ij"), axis=-1).reshape(-1, len(axes))
            ).any()
        ):
            raise InputError(
                "the points are not a full grid, the last axis running fastest", file=name,
                found=f"{len(table)} rows", expected=f"{size} rows",
            )  # fmt: skip
        base = [position_unit(a) for a in axes]
        scaled = tuple(n * b for n, b in zip(nodes, base, strict=True))
        return [
            Table(
                move(c),
                axes,
                scaled,
                table[:, len(axes) + k].reshape(shape) * (DEGREE if c in "ABC" else 1.0),
                sign=Sign(sign),
            ).as_sign(Sign.ERROR)
            for k, c in enumerate(_LETTERS)
        ]

    def activation(self) -> tuple[str, ...]:
        """Not a controller."""
        return ("For a converter of your own, or to be read: the sign stands in each file's head.",)
