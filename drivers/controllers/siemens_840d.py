"""Siemens SINUMERIK 840D sl, 828D, 802D sl: ENC_COMP and CEC tables as NC archives."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from compcore.errors import InputError
from compcore.tables.capability import Capability, Holds, Spacing
from compcore.tables.table import Table
from drivers.controllers.axes import (
    DEGREE,
    F64,
    equidistant,
    moved_axis,
    output_of,
    position_unit,
)
from drivers.controllers.base import (
    Confidence,
    Controller,
    ControllerOptions,
    NamePerAxis,
    NumberPerAxis,
    Trust,
)
from drivers.controllers.text import fixed, number, numbered_lines

_DECIMALS = 6
_ASSIGNED = re.compile(r"\$A([AN])_([A-Z_]+)\s*\[([^\]]*)\]\s*=\s*([^;]+?)\s*(?:;.*)?")
_FRAME = ("CHANDATA(1)", "M17")


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
    """CEC tables that there are; 8 on the 828D."""
    first_table: Annotated[int, Field(ge=0, le=199)] = 0
    """Index of the first CEC table that may be used."""
    reference: NumberPerAxis = Field(default_factory=dict)
    """Axis → position of its reference point, mm or degrees; 0 where not given."""


class Siemens840D(Controller):
    """Encoder (leadscrew) compensation and 'sag' compensation, which moves one axis by another.

    ENC_COMP is added to the *actual* value: a positive value moves the axis in the negative
    direction. CEC is an additional *setpoint*. So the two have opposite signs. Products of tables
    (MULT_BY_TABLE), which could hold levers, are not written: text and example of the manuals do
    not agree on whether the factors act by themselves as well, and that would be millimetres.
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
        "p. 106; 802D sl function manual p. 222-224"
    )
    trust: ClassVar[Trust] = Trust(
        Confidence.DOCUMENTED,
        Confidence.UNVERIFIED,
        Confidence.DOCUMENTED,
        "the sign of ENC_COMP is documented; that of CEC is derived from 'output as an additional "
        "setpoint' and has not been tried",
    )
    Options: ClassVar[type[ControllerOptions]] = Siemens840DOptions
    options: Siemens840DOptions

    @property
    def capability(self) -> Capability:
        """L-POS, L-STR (L-SQU as its slope) and their rotary relatives, equidistant."""
        bidirectional = self.options.pitch == "cec"
        spacing = Spacing("equidistant", least=0.1, unit=1e-3)
        turning = Spacing("equidistant", least=0.01 * DEGREE, unit=1e-3 * DEGREE)
        step, turn = 10.0**-_DECIMALS, 10.0**-_DECIMALS * DEGREE
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
        )
        cross = replace(
            axis,
            form="cross",
            types=("L-STR", "L-SQU", "R-RAX"),
            points=self.options.cec_points,
            directional=True,
        )
        reference = {a: q * position_unit(a) for a, q in self.options.reference.items()}
        return Capability((axis, cross), lookup="command", reference=reference)

    def _name(self, axis: str) -> str:
        return self.options.axes.get(axis, f"{axis}1")

    def _format(self, tables: Sequence[Table]) -> dict[str, str]:
        enc: list[Table] = []
        cec: list[Table] = []
        for table in tables:
            own = moved_axis(table) == table.inputs[0]
            (enc if own and self.options.pitch == "enc" else cec).append(table)
        files = {}
        if enc:
            lines = [line for table in enc for line in self._enc(table)]
            files["ax_eec.ini"] = _framed("%_N_AX_EEC_INI", lines)
        if cec:
            lines = []
            index = self.options.first_table
            for table in cec:
                ways = ((table.forward, 1), (table.downward, -1))
                for values, direction in ways if table.directional else ((table.forward, 0),):
                    lines += self._cec(table, values, direction, index)
                    index += 1
            if index > self.options.first_table + self.options.cec_tables:
                raise InputError(
                    "the control has no more CEC tables", field="cec_tables",
                    found=index - self.options.first_table,
                    expected=f"at most {self.options.cec_tables}",
                )  # fmt: skip
            files["nc_cec.ini"] = _framed("%_N_NC_CEC_INI", lines)
        return files

    def _grid(self, table: Table) -> tuple[str, str, str]:
        """Least position, greatest, distance."""
        q = table.nodes[0] / position_unit(table.inputs[0])
        return fixed(float(q[0]), 3), fixed(float(q[-1]), 3), fixed(float(q[1] - q[0]), 3)

    def _enc(self, table: Table) -> list[str]:
        axis = self._name(table.inputs[0])
        encoder = self.options.encoder
        base = position_unit(moved_axis(table))
        low, high, step = self._grid(table)
        lines = [
            f"$AA_ENC_COMP[{encoder},{i},{axis}]={fixed(float(v) / base, _DECIMALS)}"
            for i, v in enumerate(table.forward)
        ]
        where = f"[{encoder},{axis}]"
        return [
            *lines,
            f"$AA_ENC_COMP_STEP{where}={step}",
            f"$AA_ENC_COMP_MIN{where}={low}",
            f"$AA_ENC_COMP_MAX{where}={high}",
            f"$AA_ENC_COMP_IS_MODULO{where}=0",
        ]

    def _cec(self, table: Table, values: F64, direction: int, index: int) -> list[str]:
        base = position_unit(moved_axis(table))
        low, high, step = self._grid(table)
        lines = [
            f"$AN_CEC[{index},{i}]={fixed(-float(v) / base, _DECIMALS)}"
            for i, v in enumerate(values)
        ]
        told = {
            "INPUT_AXIS": f"({self._name(table.inputs[0])})",
            "OUTPUT_AXIS": f"({self._name(moved_axis(table))})",
            "STEP": step,
            "MIN": low,
            "MAX": high,
            "DIRECTION": str(direction),
            "MULT_BY_TABLE": "0",
            "IS_MODULO": "0",
        }
        return [*lines, *(f"$AN_CEC_{key}[{index}]={value}" for key, value in told.items())]

    def _parse(self, files: Mapping[str, str]) -> Sequence[Table]:
        found: list[Table] = []
        for name, text in files.items():
            values: dict[str, dict[int, float]] = {}
            keys: dict[tuple[str, str], str] = {}
            for i, line in numbered_lines(text):
                if not line or line.startswith((";", "%")) or line in _FRAME:
                    continue
                match = _ASSIGNED.fullmatch(line)
                if match is None:
                    raise InputError(
                        "not an assignment of a compensation table", file=name, line=i, found=line,
                        expected="$AA_ENC_COMP[…]=… or $AN_CEC[…]=…",
                    )  # fmt: skip
                kind, variable, inside, value = match.groups()
                index = [p.strip() for p in inside.split(",")]
                if (kind, variable) == ("A", "ENC_COMP"):
                    table = f"A{index[2]}"
                    values.setdefault(table, {})[int(index[1])] = number(value, name, i, variable)
                elif (kind, variable) == ("N", "CEC"):
                    table = f"N{index[0]}"
                    values.setdefault(table, {})[int(index[1])] = number(value, name, i, variable)
                else:
                    keys[f"{kind}{index[-1]}", variable] = value
            found += self._tables(name, values, keys)
        return found

    def _tables(
        self,
        name: str,
        values: Mapping[str, Mapping[int, float]],
        keys: Mapping[tuple[str, str], str],
    ) -> list[Table]:
        machine = {self._name(a): a for a in self.machine.axes}

        def key(table: str, variable: str) -> str:
            if (table, variable) not in keys:
                raise InputError(
                    "a table's variable is missing", file=name, field=f"{variable} of {table[1:]}"
                )
            return keys[table, variable]

        def axis_of(text: str) -> str:
            if text.strip('()" ') not in machine:
                raise InputError(
                    "an axis that the machine does not have", file=name, found=text,
                    expected="one of " + ", ".join(machine) + "; see the option axes",
                )  # fmt: skip
            return machine[text.strip('()" ')]

        found: list[Table] = []
        ways: dict[tuple[str, str], dict[int, Table]] = {}
        for table, entries in values.items():
            prefix = "ENC_COMP_" if table[0] == "A" else "CEC_"
            if key(table, f"{prefix}IS_MODULO") != "0":
                raise InputError(
                    "modulo tables are not read", file=name, field=f"{prefix}IS_MODULO"
                )
            low, high, step = (float(key(table, prefix + k)) for k in ("MIN", "MAX", "STEP"))
            count = round((high - low) / step) + 1
            if sorted(entries) != list(range(count)):
                raise InputError(
                    "a table's points are not complete", file=name, field=table[1:],
                    found=len(entries), expected=f"points 0 to {count - 1}",
                )  # fmt: skip
            if table[0] == "A":
                source = moved = axis_of(table[1:])
                turn = 1.0
            else:
                source, moved = (axis_of(key(table, f"CEC_{k}_AXIS")) for k in ("INPUT", "OUTPUT"))
                turn = -1.0
                if key(table, "CEC_MULT_BY_TABLE") != "0":
                    raise InputError(
                        "multiplied tables are not read", file=name, field="CEC_MULT_BY_TABLE"
                    )
            nodes = equidistant(low, step, count) * position_unit(source)
            numbers = np.array([entries[i] for i in range(count)]) * (turn * position_unit(moved))
            one = Table(output_of(moved), (source,), (nodes,), numbers)
            direction = int(keys.get((table, "CEC_DIRECTION"), "0"))
            if direction == 0:
                found.append(one)
            else:
                ways.setdefault((source, moved), {})[direction] = one
        return [*found, *(_joined(pair, name) for pair in ways.values())]

    def activation(self) -> tuple[str, ...]:
        """Sizes, files, machine data."""
        names = ", ".join(self._name(a) for a in self.machine.axes)
        return (
            "Save the NC archive first: changing MD38000 or MD18342 re-allocates memory.",
            "Set MD38000 $MA_MM_ENC_COMP_MAX_POINTS and MD18342 $MN_MM_CEC_MAX_POINTS to at least "
            "the "
            "points in the files (the 828D has 8 CEC tables of 200).",
            "With MD32700 $MA_ENC_COMP_ENABLE = 0, load ax_eec.ini; load nc_cec.ini.",
            f"Set MD32700 = 1 for ENC_COMP; MD32710 $MA_CEC_ENABLE = 1 for each corrected axis "
            f"({names}) "
            "and SD41300 $SN_CEC_TABLE_ENABLE[t] = 1 for each table; check MD32720 and MD32730, "
            "the "
            "limits of CEC.",
            "Power on, and reference: tables act on referenced axes only.",
            "Check one point of a CEC table with an indicator before cutting: its sign is derived.",
        )


def _framed(name: str, lines: Sequence[str]) -> str:
    return "\n".join([name, _FRAME[0], *lines, _FRAME[1], ""])


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
