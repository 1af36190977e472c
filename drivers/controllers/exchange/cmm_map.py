"""A CMM's compensation map: six errors of each axis in a plain text (docs/maps.md)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from abbe.compcore.files.map_file import format_map, parse_map
from abbe.compcore.machine.error_motion import Component, ErrorMotion
from abbe.compcore.maps.convention import parse_signs
from abbe.compcore.maps.table import COMPONENTS, AxisTable, CompensationMap
from abbe.compcore.tables.capability import Capability, Holds, Spacing
from abbe.compcore.tables.table import Table, tables_of
from abbe.drivers.controllers.axes import F64
from abbe.drivers.controllers.base import (
    AxisNames,
    Cannot,
    Confidence,
    Controller,
    ControllerOptions,
    Trust,
)
from abbe.drivers.controllers.text import fixed, only_file


class CmmMapOptions(ControllerOptions):
    """Options of `CmmMap`."""

    decimals: Annotated[int, Field(ge=3, le=9)] = 4
    """Decimals of mm and of mm/m."""
    signs: AxisNames = ()
    """Columns of the vendor that have the other sign, as for `abbe import-map`: R=-1, Z.L=-1, …"""


class CmmMap(Controller):
    """Tables of Lx Ly Lz Rx Ry Rz over each axis; the CMM adds them up through its levers."""

    name: ClassVar[str] = "cmm-map"
    title: ClassVar[str] = "CMM compensation map, plain text"
    sign: ClassVar[str] = (
        "error (actual − indicated), mm and mm/m, rotations right-handed: what is added to a "
        "reading; "
        "vendors differ, see the option signs"
    )
    source: ClassVar[str] = "the practitioner's article that docs/maps.md is built on"
    trust: ClassVar[Trust] = Trust(
        Confidence.DOCUMENTED,
        Confidence.DOCUMENTED,
        Confidence.UNVERIFIED,
        "vendors differ in signs and in the rotation point; how to find out which is in "
        "docs/maps.md",
    )
    cannot: ClassVar[tuple[Cannot, ...]] = (
        Cannot(
            "CMM controllers' own files (Renishaw UCC, Zeiss CAA, Hexagon compens.dat)",
            "their content is not public; the vendor's program takes the numbers of the map",
        ),
    )
    Options: ClassVar[type[ControllerOptions]] = CmmMapOptions
    options: CmmMapOptions

    @property
    def capability(self) -> Capability:
        """L-VOL: all six error motions of each linear axis."""
        step = 10.0**-self.options.decimals
        holds = Holds(
            "motions",
            ("L-VOL",),
            points=2000,
            spacing=Spacing(least=0.1, unit=1e-3),
            resolution=step,
            rotary_resolution=step * 1e-3,
            inputs=self.machine.structure.linear,
        )
        return Capability((holds,), lookup="indicated", shared_nodes=True, knows_tool=True)

    def _signs(self) -> dict[tuple[str, str], float]:
        axes = self.machine.structure.linear
        reversed_ = parse_signs(self.options.signs, axes)
        return {(a, c): -1.0 if (a, c) in reversed_ else 1.0 for a in axes for c in COMPONENTS}

    def _format(self, tables: Sequence[Table]) -> dict[str, str]:
        signs = self._signs()
        found = {}
        for axis in dict.fromkeys(t.inputs[0] for t in tables):
            mine = tables_of(tables, axis)
            columns = {
                t.output.component: t.forward * signs[axis, t.output.component] for t in mine
            }
            nodes = mine[0].nodes[0]
            zero = np.zeros(len(nodes))
            values = np.stack(
                [self._rounded(columns.get(c, zero), c) for c in COMPONENTS],  # type: ignore[call-overload]
                axis=1,
            )
            positions = tuple(round(float(q), 9) for q in nodes)
            empty = ((0.0,) * 6,) * len(nodes)
            found[axis] = AxisTable(axis, positions, empty).with_array(values)
        return {"map.txt": format_map(CompensationMap(found))}

    def _rounded(self, values: F64, component: str) -> F64:
        """The very numbers that the file's decimals read back as."""
        unit = 1e-3 if component in "ABC" else 1.0
        return np.array([float(fixed(v / unit, self.options.decimals)) * unit for v in values])

    def _parse(self, files: Mapping[str, str]) -> Sequence[Table]:
        name, text = only_file(files)
        signs = self._signs()
        found = []
        for axis, table in parse_map(text, name).tables.items():
            self.machine.axis(axis, f"{name}: {axis} Axis")
            rising = table.rising()
            nodes = np.array(rising.positions)
            for k, letter in enumerate(COMPONENTS):
                component: Component = letter  # type: ignore[assignment]
                values = rising.array()[:, k] * signs[axis, letter]
                found.append(Table(ErrorMotion(axis, component), (axis,), (nodes,), values))
        return found

    def activation(self) -> tuple[str, ...]:
        """The vendor's own way."""
        return (
            "Load the map with the vendor's own program; keep the map that was active.",
            "Rotation point and kinematic chain of the controller must be those of the model; if "
            "they "
            "are not known, find them with `abbe identify-convention` (docs/maps.md).",
            "Measure a few points with the map off and on: the differences must be what "
            "`abbe correct` predicts.",
        )
