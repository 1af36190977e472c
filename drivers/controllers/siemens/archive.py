"""SINUMERIK compensation tables in NC archives: the lines of ENC_COMP and CEC, both ways."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from abbe.compcore.errors import InputError
from abbe.drivers.controllers.axes import F64, equidistant
from abbe.drivers.controllers.text import fixed, number, numbered_lines

DECIMALS = 6
"""Of a value, mm or degrees."""
POSITION_DECIMALS = 3
"""Of a position, mm or degrees."""

_ASSIGNED = re.compile(r"\$A([AN])_([A-Z_]+)\s*\[([^\]]*)\]\s*=\s*([^;]+?)\s*(?:;.*)?")
_INDEX = re.compile(r"[0-9]{1,6}")
_FRAME = ("CHANDATA(1)", "M17")


def framed(name: str, lines: Sequence[str]) -> str:
    """An archive of one block."""
    return "\n".join([name, _FRAME[0], *lines, _FRAME[1], ""])


@dataclass(frozen=True, eq=False)
class Cec:
    """A CEC table as the control holds it: compensations, mm or degrees.

    Attributes
    ----------
    index
        From 0; the control's number in MULT_BY_TABLE is one more.
    source, moved
        Names of the base axis and of the compensation axis.
    start, step
        First position and distance, mm or degrees.
    values
        (n,).
    direction
        0: both; 1, −1: one of them.
    multiplied_by
        Index of the table that this one is multiplied by; None: by none.
    """

    index: int
    source: str
    moved: str
    start: float
    step: float
    values: F64
    direction: int = 0
    multiplied_by: int | None = None

    @property
    def nodes(self) -> F64:
        """Positions, (n,), mm or degrees."""
        return equidistant(self.start, self.step, len(self.values))

    def lines(self) -> list[str]:
        """Its assignments."""
        stated = {
            "INPUT_AXIS": f"({self.source})",
            "OUTPUT_AXIS": f"({self.moved})",
            "STEP": fixed(self.step, POSITION_DECIMALS),
            "MIN": fixed(self.start, POSITION_DECIMALS),
            "MAX": fixed(float(self.nodes[-1]), POSITION_DECIMALS),
            "DIRECTION": str(self.direction),
            "MULT_BY_TABLE": str(0 if self.multiplied_by is None else self.multiplied_by + 1),
            "IS_MODULO": "0",
        }
        return [
            *(
                f"$AN_CEC[{self.index},{i}]={fixed(float(v), DECIMALS)}"
                for i, v in enumerate(self.values)
            ),
            *(f"$AN_CEC_{key}[{self.index}]={value}" for key, value in stated.items()),
        ]


@dataclass(frozen=True, eq=False)
class EncComp:
    """An ENC_COMP table as the control holds it: errors, mm or degrees.

    Attributes
    ----------
    encoder
        Measuring system.
    axis
        Name of the axis.
    start, step, values
        As of `Cec`.
    """

    encoder: int
    axis: str
    start: float
    step: float
    values: F64

    @property
    def nodes(self) -> F64:
        """Positions, (n,), mm or degrees."""
        return equidistant(self.start, self.step, len(self.values))

    def lines(self) -> list[str]:
        """Its assignments."""
        stated = {
            "STEP": fixed(self.step, POSITION_DECIMALS),
            "MIN": fixed(self.start, POSITION_DECIMALS),
            "MAX": fixed(float(self.nodes[-1]), POSITION_DECIMALS),
            "IS_MODULO": "0",
        }
        where = f"[{self.encoder},{self.axis}]"
        return [
            *(
                f"$AA_ENC_COMP[{self.encoder},{i},{self.axis}]={fixed(float(v), DECIMALS)}"
                for i, v in enumerate(self.values)
            ),
            *(f"$AA_ENC_COMP_{key}{where}={value}" for key, value in stated.items()),
        ]


_Family = Literal["ENC_COMP", "CEC"]


@dataclass(frozen=True, eq=False)
class _Raw:
    """What a file assigns to one table."""

    file: str
    family: _Family
    entries: dict[int, float]
    variables: dict[str, tuple[str, int]]
    """Name → value and line."""

    def variable(self, key: str, name: str) -> tuple[str, int]:
        if name not in self.variables:
            raise InputError(
                "a table's variable is missing", file=self.file, field=f"{name} of {key}"
            )
        return self.variables[name]

    def whole(self, key: str, name: str) -> int:
        text, line = self.variable(key, name)
        try:
            return int(text)
        except ValueError:
            raise InputError(
                "not a whole number", file=self.file, line=line, field=f"{name} of {key}",
                found=text,
            ) from None  # fmt: skip

    def axis(self, key: str, name: str) -> str:
        return self.variable(key, name)[0].strip('()" ')

    def real(self, key: str, name: str) -> float:
        variable = f"{self.family}_{name}"
        text, line = self.variable(key, variable)
        return number(text, self.file, line, f"{variable} of {key}")

    def values(self, key: str) -> F64:
        if self.whole(key, f"{self.family}_IS_MODULO") != 0:
            raise InputError(
                "modulo tables are not read", file=self.file, field=f"{self.family}_IS_MODULO"
            )
        low, high, step = (self.real(key, k) for k in ("MIN", "MAX", "STEP"))
        if not step > 0.0 or not high > low or not math.isfinite((high - low) / step):
            raise InputError(
                "not a range with a distance", file=self.file, field=f"{self.family} {key}",
                found=f"{low:g} to {high:g} by {step:g}",
            )  # fmt: skip
        count = round((high - low) / step) + 1
        if len(self.entries) != count or set(self.entries) != set(range(count)):
            raise InputError(
                "a table's points are not complete", file=self.file, field=key,
                found=len(self.entries), expected=f"points 0 to {count - 1}",
            )  # fmt: skip
        return np.array([self.entries[i] for i in range(count)])


def read_archive(name: str, text: str) -> tuple[list[EncComp], list[Cec]]:
    """The tables of a file.

    Raises
    ------
    InputError
        For a line that is no assignment of a table, a table that is not complete, or a modulo one.
    """
    raw: dict[tuple[_Family, str], _Raw] = {}
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
        family: _Family = "ENC_COMP" if kind == "A" else "CEC"
        if not _INDEX.fullmatch(index[0]):
            raise InputError("not the number of a table", file=name, line=i, found=line)
        table = raw.setdefault(
            (family, index[-1 if kind == "A" else 0]), _Raw(name, family, {}, {})
        )
        if variable == family:
            point = index[1] if len(index) == (3 if kind == "A" else 2) else ""
            if not _INDEX.fullmatch(point):
                raise InputError("not a point of a table", file=name, line=i, found=line)
            table.entries[int(point)] = number(value, name, i, variable)
        else:
            table.variables[variable] = (value, i)
        if kind == "A":
            table.variables["encoder"] = (index[0], i)
    encs, cecs = [], []
    for (family, key), table in raw.items():
        if not table.entries:
            raise InputError("a table without points", file=name, field=key)
        values, start, step = table.values(key), table.real(key, "MIN"), table.real(key, "STEP")
        if family == "ENC_COMP":
            encs.append(EncComp(table.whole(key, "encoder"), key, start, step, values))
            continue
        multiplied = table.whole(key, "CEC_MULT_BY_TABLE")
        cecs.append(
            Cec(
                int(key),
                table.axis(key, "CEC_INPUT_AXIS"),
                table.axis(key, "CEC_OUTPUT_AXIS"),
                start,
                step,
                values,
                table.whole(key, "CEC_DIRECTION") if "CEC_DIRECTION" in table.variables else 0,
                multiplied - 1 if multiplied else None,
            )
        )
    return encs, cecs


def by_index(tables: Sequence[Cec]) -> Mapping[int, Cec]:
    """Index → table."""
    return {t.index: t for t in tables}
