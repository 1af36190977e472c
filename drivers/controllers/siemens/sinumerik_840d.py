"""Siemens SINUMERIK 840D sl, 828D, 802D sl: ENC_COMP and CEC tables as NC archives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from abbe.compcore.errors import InputError
from abbe.compcore.tables.capability import Capability, Holds, Spacing
from abbe.compcore.tables.table import Table
from abbe.drivers.controllers.axes import DEGREE, F64, moved_axis, output_of, position_unit
from abbe.drivers.controllers.base import (
    Cannot,
    Confidence,
    Controller,
    ControllerOptions,
    NamePerAxis,
    NumberPerAxis,
    Trust,
)
from abbe.drivers.controllers.siemens.archive import (
    DECIMALS,
    POSITION_DECIMALS,
    Cec,
    EncComp,
    framed,
    read_archive,
)
from abbe.drivers.controllers.siemens.products import (
    RESOLUTION,
    TABLES,
    four_tables,
    held,
    read_products,
)


class Siemens840DOptions(ControllerOptions):
    """Options of `Siemens840D`."""

    axes: NamePerAxis = Field(default_factory=dict)
    """Axis → machine axis name; none: X1, Y1, …"""
    pitch: Literal["enc", "cec"] = "enc"
    """An axis's own error: ENC_COMP, one table for both directions; CEC, two where they differ."""
    encoder: Annotated[int, Field(ge=0, le=1)] = 0
    """Measuring system of ENC_COMP."""
    enc_points: Annotated[int, Field(ge=2, le=5000)] = 1000
    """Most points of ENC_COMP (MD38000)."""
    cec_points: Annotated[int, Field(ge=2, le=2000)] = 200
    """Most points of a CEC table (MD18342); 200 on the 828D."""
    cec_tables: Annotated[int, Field(ge=0, le=200)] = 62
    """CEC tables that there are; 8 on the 828D, 2 on the 802D sl."""
    products: Literal["none", "mirrored"] = "none"
    """Products of two axes' positions, for levers: none, or four CEC tables each."""
    first_table: Annotated[int, Field(ge=0, le=199)] = 0
    """Index of the first CEC table that may be used."""
    reference: NumberPerAxis = Field(default_factory=dict)
    """Axis → position of its reference point, mm or degrees; 0 where not given."""


class Siemens840D(Controller):
    """Encoder (leadscrew) compensation and 'sag' compensation, which moves one axis by another.

    ENC_COMP is added to the *actual* value: a positive value moves the axis in the negative
    direction. CEC is an additional *setpoint*. So the two have opposite signs. Products of tables
    (MULT_BY_TABLE) hold levers. Text and example of the manual do not agree on whether the factors
    act by themselves as well; products=mirrored writes each product a second time with both
    factors turned round, so that whatever they do by themselves cancels. It has not been tried:
    the trial in docs/tables.md comes first.
    """

    name: ClassVar[str] = "siemens-840d"
    title: ClassVar[str] = "Siemens SINUMERIK 840D sl / 828D / 802D sl: ENC_COMP, CEC"
    sign: ClassVar[str] = (
        "ENC_COMP: error (actual − indicated), added to the actual value; CEC: compensation "
        "(−error), "
        "added to the setpoint; mm, degrees"
    )
    source: ClassVar[str] = (
        "SINUMERIK Extended Functions 6FC5397-1BP40-3BA1, K3 p. 238-268; 808D diagnostics manual "
        "p. 106; 802D sl function manual p. 215-224"
    )
    trust: ClassVar[Trust] = Trust(
        Confidence.DOCUMENTED,
        Confidence.UNVERIFIED,
        Confidence.DOCUMENTED,
        "the sign of ENC_COMP is documented; that of CEC is derived from 'output as an additional "
        "setpoint' and has not been tried, nor have products (products=mirrored)",
    )
    cannot: ClassVar[tuple[Cannot, ...]] = (
        Cannot(
            "Siemens VCS-A3, VCS-A5, VCS-ROTARY (volumetric compensation)",
            "no public document gives the form of its files; the makers of measuring systems write "
            "them: etalon-exchange holds the same error motions for their programs",
        ),
    )
    Options: ClassVar[type[ControllerOptions]] = Siemens840DOptions
    options: Siemens840DOptions

    @property
    def capability(self) -> Capability:
        """L-POS, L-STR (L-SQU as its slope) and their rotary relatives, equidistant."""
        bidirectional = self.options.pitch == "cec"
        unit = 10.0**-POSITION_DECIMALS
        spacing = Spacing("equidistant", least=0.1, unit=unit)
        turning = Spacing("equidistant", least=0.01 * DEGREE, unit=unit * DEGREE)
        step, turn = 10.0**-DECIMALS, 10.0**-DECIMALS * DEGREE
        axis = Holds(
            "axis",
            ("L-POS", "R-POS"),
            points=self.options.cec_points if bidirectional else self.options.enc_points,
            spacing=spacing,
            rotary_spacing=turning,
            directional=bidirectional,
            resolution=step,
            rotary_resolution=turn,
            zero_at="zero",
            takes=(1, 2) if bidirectional else (0, 0),
        )
        cross = replace(
            axis,
            form="cross",
            types=("L-STR", "L-SQU", "R-RAX"),
            points=self.options.cec_points,
            directional=True,
            takes=(1, 2),
        )
        product = replace(
            cross,
            form="product",
            types=("L-ANG", "R-ANG"),
            directional=False,
            resolution=RESOLUTION,
            zero_at=None,
            takes=(TABLES, TABLES),
        )
        reference = {a: q * position_unit(a) for a, q in self.options.reference.items()}
        return Capability(
            (axis, cross) if self.options.products == "none" else (axis, cross, product),
            lookup="command",
            most_tables=self.options.cec_tables,
            reference=reference,
        )

    def adapted(self, tables: Sequence[Table]) -> tuple[Table, ...]:
        """Products in steps of their own."""
        return tuple(t if t.lever is None else held(t, self.machine) for t in tables)

    @property
    def _names(self) -> dict[str, str]:
        """Axis → machine axis name."""
        return {a: self.options.axes.get(a, f"{a}1") for a in self.machine.axes}

    def _format(self, tables: Sequence[Table]) -> dict[str, str]:
        names = self._names
        enc: list[EncComp] = []
        cec: list[Cec] = []
        for table in tables:
            start, step, values = _grid(table)
            source, moved = names[table.inputs[0]], names[moved_axis(table)]
            index = self.options.first_table + len(cec)
            if table.lever is not None:
                cec += four_tables(table, self.machine, names, index)
            elif source == moved and self.options.pitch == "enc":
                enc.append(EncComp(self.options.encoder, source, start, step, values[0]))
            elif table.directional:
                up, down = (Cec(index + k, source, moved, start, step, -v, 1 - 2 * k)
                            for k, v in enumerate(values))  # fmt: skip
                cec += [up, down]
            else:
                cec.append(Cec(index, source, moved, start, step, -values[0]))
        if len(cec) > self.options.cec_tables:
            raise InputError(
                "the control has no more CEC tables", field="cec_tables", found=len(cec),
                expected=f"at most {self.options.cec_tables}",
            )  # fmt: skip
        files = {}
        if enc:
            lines = [line for one in enc for line in one.lines()]
            files["ax_eec.ini"] = framed("%_N_AX_EEC_INI", lines)
        if cec:
            lines = [line for one in cec for line in one.lines()]
            files["nc_cec.ini"] = framed("%_N_NC_CEC_INI", lines)
        return files

    def _parse(self, files: Mapping[str, str]) -> Sequence[Table]:
        axes = {name: axis for axis, name in self._names.items()}
        found: list[Table] = []
        for name, text in files.items():
            enc, cec = read_archive(name, text)
            for one in enc:
                axis = _axis(one.axis, axes, name)
                found.append(_table(axis, axis, one, 1.0))
            products, plain = read_products(cec, axes, name)
            ways: dict[tuple[str, str], dict[int, Table]] = {}
            for cross in plain:
                source, moved = (_axis(a, axes, name) for a in (cross.source, cross.moved))
                table = _table(source, moved, cross, -1.0)
                if cross.direction == 0:
                    found.append(table)
                else:
                    ways.setdefault((source, moved), {})[cross.direction] = table
            found += [*(_joined(pair, name) for pair in ways.values()), *products]
        return found

    def activation(self) -> tuple[str, ...]:
        """Sizes, files, machine data."""
        names = ", ".join(self._names.values())
        products = () if self.options.products == "none" else _MIRRORED
        return (
            "Save the NC archive first: changing MD38000 or MD18342 re-allocates memory.",
            "Set MD38000 $MA_MM_ENC_COMP_MAX_POINTS and MD18342 $MN_MM_CEC_MAX_POINTS to at least "
            "the points in the files (the 828D has 8 CEC tables of 200).",
            "With MD32700 $MA_ENC_COMP_ENABLE = 0, load ax_eec.ini; with MD32710 $MA_CEC_ENABLE = "
            "0 of every axis, load nc_cec.ini.",
            *products,
            "Set SD41300 $SN_CEC_TABLE_ENABLE[t] = 1 for each table; check MD32720 and MD32730, "
            "the limits of CEC; then MD32700 = 1 for ENC_COMP, MD32710 = 1 for each corrected axis "
            f"({names}).",
            "Power on, and reference: tables act on referenced axes only.",
            "Check one point of a CEC table with an indicator before cutting: its sign is derived.",
        )


_MIRRORED = (
    "Products: make the trial of docs/tables.md once on this control. All tables of an axis belong "
    "together: set SD41300 of all of them, SD41310 $SN_CEC_TABLE_WEIGHT = 1, before MD32710.",
    "Products: set MD32720 $MA_CEC_MAX_SUM to little more than the largest correction; a factor "
    "without its counterpart then raises an alarm and moves the axis no further.",
)


def _grid(table: Table) -> tuple[float, float, tuple[F64, F64]]:
    """Least position and distance, values up and down, all in mm or degrees."""
    q = table.nodes[0] / position_unit(table.inputs[0])
    base = position_unit(moved_axis(table))
    return float(q[0]), float(q[1] - q[0]), (table.forward / base, table.downward / base)


def _axis(name: str, axes: Mapping[str, str], file: str) -> str:
    if name not in axes:
        raise InputError(
            "an axis that the machine does not have", file=file, found=name,
            expected="one of " + ", ".join(axes) + "; see the option axes",
        )  # fmt: skip
    return axes[name]


def _table(source: str, moved: str, held: Cec | EncComp, turn: float) -> Table:
    values = held.values * (turn * position_unit(moved))
    return Table(output_of(moved), (source,), (held.nodes * position_unit(source),), values)


def _joined(ways: Mapping[int, Table], file: str) -> Table:
    """One table from those of the positive and the negative direction."""
    if set(ways) != {1, -1}:
        raise InputError(
            "a table for one direction has no partner for the other",
            file=file,
            field="CEC_DIRECTION",
        )
    up, down = ways[1], ways[-1]
    both = np.union1d(up.nodes[0], down.nodes[0])
    return replace(up.on(both), backward=down.on(both).forward)
